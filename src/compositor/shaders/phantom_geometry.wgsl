// Depth and normal of the real scene's proxies as the scene camera sees them.
// The part is the instance.

struct PhantomPart {
    world_from_part: mat4x4f,
    normal_from_part: mat4x4f,
    // x: 1 receives shadows, 2 mirrors.
    kind: vec4f,
}

@group(1) @binding(0) var<storage, read> parts: array<PhantomPart>;

struct Varying {
    @builtin(position) position: vec4f,
    @location(0) normal: vec3f,
    @location(1) @interpolate(flat) kind: f32,
}

@vertex
fn phantom_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @builtin(instance_index) i: u32,
) -> Varying {
    let world = parts[i].world_from_part * vec4f(position, 1.0);
    let n = (parts[i].normal_from_part * vec4f(normal, 0.0)).xyz;
    return Varying(frame.clip_from_world * world, n, parts[i].kind.x);
}

@fragment
fn phantom_fragment(in: Varying) -> @location(0) vec4f {
    return vec4f(octahedron_from_normal(normalize(in.normal)), in.kind, 1.0);
}
