// The camera's point spread along rows.

@group(1) @binding(0) var surface: texture_2d<f32>;
@group(1) @binding(1) var change: texture_2d<f32>;

@vertex
fn spread_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return look_corner(v, look.reach.z);
}

@fragment
fn spread(@builtin(position) position: vec4f) -> Layers {
    return spread_along(surface, change, vec2i(position.xy), vec2i(1, 0), look.across, look.soft_across);
}
