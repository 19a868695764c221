// Positions of the samples of a pixel. Light and shadow are computed there and not at the pixel's
// centre: the depth of a slanted surface belongs to its sample; moved to the centre, it is a point
// under the surface, in its own shadow.

// WebGPU's standard positions: eighths of a pixel, (−1, −3), (3, −1), (−3, 1), (1, 3).
fn sample_position(pixel: vec2i, s: i32) -> vec2f {
    if SAMPLES == 1 {
        return vec2f(pixel);
    }
    let eighths = vec2i(4 * (s & 1) - 2 * (s >> 1u) - 1, 2 * s - 3);
    return vec2f(pixel) + vec2f(eighths) / 8.0;
}
