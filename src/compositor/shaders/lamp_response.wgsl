// Light that lamps add to the picture of real surfaces by the paper's response: drawn on the
// proxies' triangles, as in the paper, with the video projected onto them. Linear, in the scene
// camera's units and exposure.

struct PhantomPart {
    world_from_part: mat4x4f,
    normal_from_part: mat4x4f,
    // x: 1 receives shadows, 2 mirrors; yzw: diffuse reflectance.
    kind: vec4f,
}

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(2) @binding(0) var<storage, read> parts: array<PhantomPart>;

struct Varying {
    @builtin(position) @invariant position: vec4f,
    @location(0) normal: vec3f,
    @location(1) world: vec3f,
    @location(2) @interpolate(flat) kind: vec4f,
}

@vertex
fn phantom_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @builtin(instance_index) i: u32,
) -> Varying {
    let world = parts[i].world_from_part * vec4f(position, 1.0);
    let n = (parts[i].normal_from_part * vec4f(normal, 0.0)).xyz;
    return Varying(clip_of(world), n, world.xyz, parts[i].kind);
}

// Irradiance facing a lamp's centre, with shadows.
fn arriving_from(k: u32, world: vec3f, n: vec3f) -> vec3f {
    let ray = lamp_ray(k, world);
    if AREAS && (lamps.count.y >> k & 1u) == 1u {
        return irradiance_of_area(k, world, ray.to);
    }
    let seen = lamp_visibility(k, world, n);
    return ray.facing * mix(1.0, seen, frame.params.x);
}

@fragment
fn respond(in: Varying) -> @location(0) vec4f {
    let n = normalize(in.normal);
    let video = linear_from_code(textureLoad(camera, vec2i(in.position.xy), 0).rgb);
    let intensity = dot(video, vec3f(0.2126, 0.7152, 0.0722));
    var sum = vec3f(0.0);
    let count = non_uniform(lamps.count.x, in.world.x);
    for (var k = 0u; k < count; k++) {
        sum += arriving_from(k, in.world, n) * lamp_response(lamp_ray(k, in.world).to, n, intensity);
    }
    let receives = select(0.0, 1.0, in.kind.x == 1.0);
    // A white surface shows an irradiance of π as 1.
    return vec4f(in.kind.yzw * sum * (receives / 3.14159265), 1.0);
}
