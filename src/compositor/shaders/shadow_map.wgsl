// Depth of the casters seen from one dome light, orthographic. The instance is the light, and
// above its lowest twelve bits the caster's number.

@group(1) @binding(0) var<storage, read> caster_places: array<mat4x4f>;

struct Out {
    @builtin(position) position: vec4f,
}

fn place(u: vec4f, v: vec4f, d: vec4f, world: vec3f) -> Out {
    let p = vec4f(world, 1.0);
    let uv = vec2f(dot(u, p), dot(v, p));
    // Texture v runs down, clip y runs up.
    return Out(vec4f(uv.x * 2.0 - 1.0, 1.0 - uv.y * 2.0, dot(d, p), 1.0));
}

// What stands still has the world's coordinates; its place is the identity, exactly.
@vertex
fn virtual_caster(@location(0) own: vec3f, @builtin(instance_index) instance: u32) -> Out {
    let i = instance & 0xfffu;
    let world = (caster_places[instance >> 12u] * vec4f(own, 1.0)).xyz;
    return place(lights[i].virtual_u, lights[i].virtual_v, lights[i].virtual_d, world);
}

@vertex
fn phantom_caster(@location(0) world: vec3f, @builtin(instance_index) i: u32) -> Out {
    return place(lights[i].phantom_u, lights[i].phantom_v, lights[i].phantom_d, world);
}
