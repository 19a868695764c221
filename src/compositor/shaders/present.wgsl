// The finished picture on a window's surface, scaled to fit, with black borders.

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var smooth_sampler: sampler;
// Scale and offset from window coordinates (0..1) to picture coordinates; z of `more` is 1 if the
// surface encodes sRGB itself, so that the codes must be decoded first.
struct Placement {
    scale_offset: vec4f,
    more: vec4f,
}
@group(0) @binding(2) var<uniform> placement: Placement;

fn linear_from_srgb(c: vec3f) -> vec3f {
    return select(pow((c + 0.055) / 1.055, vec3f(2.4)), c / 12.92, c <= vec3f(0.04045));
}

@fragment
fn present(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let uv = (at.xy / placement.more.xy) * placement.scale_offset.xy + placement.scale_offset.zw;
    let code = textureSampleLevel(picture, smooth_sampler, uv, 0.0).rgb;
    let shown = select(code, linear_from_srgb(code), placement.more.z > 0.5);
    let inside = all(uv >= vec2f(0.0)) && all(uv <= vec2f(1.0));
    return vec4f(select(vec3f(0.0), shown, inside), 1.0);
}
