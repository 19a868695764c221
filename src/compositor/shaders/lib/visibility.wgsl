// How much of a dome light reaches a point.

@group(1) @binding(0) var virtual_maps: texture_depth_2d_array;
@group(1) @binding(1) var phantom_maps: texture_depth_2d_array;
@group(1) @binding(2) var compare: sampler_comparison;

fn inside(uv: vec2f) -> bool {
    return all(abs(uv - vec2f(0.5)) < vec2f(0.5));
}

// A point is lifted off its surface along the normal by the texel it might share with its
// own caster; otherwise surfaces shadow themselves in stripes.
fn lifted(world: vec3f, n: vec3f, n_dot_l: f32, texel: f32) -> vec4f {
    let slope = sqrt(max(1.0 - n_dot_l * n_dot_l, 0.0));
    return vec4f(world + n * (texel * (0.5 + 1.5 * slope)), 1.0);
}

fn virtual_visibility(i: u32, world: vec3f, n: vec3f, n_dot_l: f32) -> f32 {
    let p = lifted(world, n, n_dot_l, lights[i].scale.x);
    let uv = vec2f(dot(lights[i].virtual_u, p), dot(lights[i].virtual_v, p));
    if !inside(uv) {
        return 1.0;
    }
    let d = clamp(dot(lights[i].virtual_d, p), 0.0, 1.0);
    return textureSampleCompareLevel(virtual_maps, compare, uv, i, d);
}

fn phantom_visibility(i: u32, world: vec3f, n: vec3f, n_dot_l: f32) -> f32 {
    let p = lifted(world, n, n_dot_l, lights[i].scale.y);
    let uv = vec2f(dot(lights[i].phantom_u, p), dot(lights[i].phantom_v, p));
    if !inside(uv) {
        return 1.0;
    }
    let d = clamp(dot(lights[i].phantom_d, p), 0.0, 1.0);
    return textureSampleCompareLevel(phantom_maps, compare, uv, i, d);
}
