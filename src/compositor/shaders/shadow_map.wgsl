// Orthographic depth map of the casters from one dome light. The instance index holds the light in
// its lowest twelve bits, and above them the caster's number.

@group(1) @binding(0) var<storage, read> caster_places: array<mat4x4f>;

struct Out {
    @builtin(position) position: vec4f,
}

fn projected(u: vec4f, v: vec4f, d: vec4f, world: vec3f) -> Out {
    let p = vec4f(world, 1.0);
    let uv = vec2f(dot(u, p), dot(v, p));
    // Texture v runs down, clip y runs up.
    return Out(vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, dot(d, p), 1.0));
}

// Static casters are in world coordinates; their placement is exactly the identity.
@vertex
fn virtual_caster(@location(0) own: vec3f, @builtin(instance_index) instance: u32) -> Out {
    let i = instance & 0xfffu;
    let world = (caster_places[instance >> 12u] * vec4f(own, 1.0)).xyz;
    return projected(lights[i].virtual_u, lights[i].virtual_v, lights[i].virtual_d, world);
}

@vertex
fn phantom_caster(@location(0) world: vec3f, @builtin(instance_index) i: u32) -> Out {
    return projected(lights[i].phantom_u, lights[i].phantom_v, lights[i].phantom_d, world);
}
