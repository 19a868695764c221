// Which of the camera's codes are clipped, and the table of sums that says what is around them.
// Twin of `exposure::gpu_data`.

struct Exposure {
    // x: factor on linear light. y: blocks that a region reaches beyond its middle one, each
    // way; z: the share of the next ring of blocks that counts, too. w: how much of the estimate
    // of clipped light counts.
    change: vec4f,
    // x: blocks of what is close by, each way. y: 1 where every pixel's factor rises with the mean of
    // its region, as in the paper.
    near: vec4f,
    // By the camera's code: linear light in the exposure, as half floats keep it, and its code.
    linear: array<vec4f, 64>,
    codes: array<vec4f, 64>,
}

// Side of a block, pixels, as a power of two.
const BLOCK_LOG = 2u;

// 0 where a channel's code tells the light, 1 where it may stand for any light from white up.
// Noise and compression leave codes below the highest in clipped areas.
fn clipped(code: vec3f) -> vec3f {
    return clamp((code * 255.0 - CLIPPED_FROM) / (CLIPPED_TO - CLIPPED_FROM), vec3f(0.0), vec3f(1.0));
}

fn luminance(linear: vec3f) -> f32 {
    return dot(linear, vec3f(0.2126, 0.7152, 0.0722));
}

fn blocks_of(camera_size: vec2u) -> vec2u {
    return (camera_size + vec2u((1u << BLOCK_LOG) - 1u)) >> vec2u(BLOCK_LOG);
}
