// The real picture as virtual objects reflect it: linear, corrected for vignetting, with the
// virtual shadows, and its mip levels. In alpha, the share of a texel that shows the ground, or
// nothing that is known.

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var shadow: texture_2d<f32>;
@group(1) @binding(3) var response: texture_2d<f32>;
@group(1) @binding(4) var phantom_depth: texture_depth_2d;
@group(2) @binding(0) var finer: texture_2d<f32>;

fn linear_at(pixel: vec2i) -> vec3f {
    let last = vec2i(frame.size.xy) - vec2i(1);
    let at = min(pixel, last);
    var linear = linear_of(textureLoad(camera, at, 0).rgb);
    if EXPOSED {
        // In the camera's exposure, like all light that shades virtual surfaces: their appearance
        // must not depend on the exposure.
        linear = min(linear / frame.ground.w, vec3f(1.0));
    }
    let s = textureLoad(shadow, at, 0).rgb;
    let brightness = brightness_at(vec2f(at));
    let behind = select(linear * s, max(linear - s * brightness, vec3f(0.0)), frame.counts.y == 1u);
    return (behind + added_at(at)) / brightness;
}

// Height above the ground, metres, up to which a phantom counts as the ground.
const ON_GROUND = 0.003;

fn shows_ground(pixel: vec2i) -> f32 {
    let depth = textureLoad(phantom_depth, pixel, 0);
    let height = world_at(vec2f(pixel), max(depth, 1e-9)).z - frame.params.y;
    return select(0.0, 1.0, (depth == 0.0) | (height < ON_GROUND));
}

@fragment
fn gather(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let corner = vec2i(at.xy) * 2;
    let sum = linear_at(corner) + linear_at(corner + vec2i(1, 0))
        + linear_at(corner + vec2i(0, 1)) + linear_at(corner + vec2i(1, 1));
    return vec4f(sum * 0.25, shows_ground(corner));
}

@fragment
fn halve(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let last = vec2i(textureDimensions(finer)) - vec2i(1);
    let corner = vec2i(at.xy) * 2;
    let a = textureLoad(finer, min(corner, last), 0);
    let b = textureLoad(finer, min(corner + vec2i(1, 0), last), 0);
    let c = textureLoad(finer, min(corner + vec2i(0, 1), last), 0);
    let d = textureLoad(finer, min(corner + vec2i(1, 1), last), 0);
    return (a + b + c + d) * 0.25;
}
