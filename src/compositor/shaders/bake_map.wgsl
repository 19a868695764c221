// Depth map of the casters from one direction of light, in parallel projection.

struct Map {
    // Rows of an affine map from the world: texture coordinates u, v and depth.
    u: vec4f,
    v: vec4f,
    depth: vec4f,
}

@group(0) @binding(0) var<uniform> map: Map;

@vertex
fn caster_vertex(@location(0) world: vec3f) -> @builtin(position) vec4f {
    let p = vec4f(world, 1.0);
    // Texture v runs down, clip y runs up.
    return vec4f(dot(map.u, p) * 2.0 - 1.0, 1.0 - dot(map.v, p) * 2.0, dot(map.depth, p), 1.0);
}
