// Clipping of the camera's codes, and the table of sums for the means of regions. Twin of
// `exposure::gpu_data`.

struct Exposure {
    // x: factor on linear light. y: blocks from the region's middle block to its border, per axis;
    // z: weight of the next ring of blocks. w: weight of the estimate of clipped light.
    change: vec4f,
    // x: blocks of the small neighbourhood, per axis. y: 1 where every pixel's factor rises with
    // the mean of its region, as in the paper.
    near: vec4f,
    // By the camera's code: linear light in the new exposure, at half-float precision, and its
    // code.
    linear: array<vec4f, 64>,
    codes: array<vec4f, 64>,
}

// Side of a block, pixels, as a power of two.
const BLOCK_LOG = 2u;

// 0 where a channel's code determines the light, 1 where it may stand for any light from white up.
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
