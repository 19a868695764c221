// Brightness of the camera's picture, and the light that virtual objects add to and remove from it.

struct Meter {
    // x: 1 where shadows are subtracted. z: 1 where the light of lamps is separate from the shadow
    // buffer.
    how: vec4u,
}

@group(0) @binding(0) var<uniform> meter: Meter;
// By workgroup: sums of the camera's luminance, light added by lamps, light lost to shadows; number
// of points.
@group(0) @binding(1) var<storage, read_write> partial: array<vec4f>;
@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var shadow: texture_2d<f32>;
@group(1) @binding(3) var response: texture_2d<f32>;

const LANES = 64u;
// Sampling distance along each axis, pixels, as a power of two.
const SPACING_LOG = 2u;

var<workgroup> sums: array<vec4f, LANES>;

fn measured_at(pixel: vec2u) -> vec4f {
    let linear = linear_from_code(textureLoad(camera, pixel, 0).rgb);
    let s = textureLoad(shadow, pixel, 0).rgb;
    let change = select(linear * (s - vec3f(1.0)), max(-s, -linear), meter.how.x == 1u);
    let y = luminance(change);
    let apart = select(0.0, luminance(textureLoad(response, pixel, 0).rgb), meter.how.z == 1u);
    return vec4f(luminance(linear), max(y, 0.0) + apart, max(-y, 0.0), 1.0);
}

// Always in the same order, so that a replay reproduces the exposures.
@compute @workgroup_size(LANES)
fn measure(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let size = textureDimensions(camera);
    let half = (1u << SPACING_LOG) >> 1u;
    var sum = vec4f(0.0);
    for (var y = group.x; (y << SPACING_LOG) + half < size.y; y += METER_GROUPS) {
        for (var x = lane; (x << SPACING_LOG) + half < size.x; x += LANES) {
            sum += measured_at((vec2u(x, y) << vec2u(SPACING_LOG)) + vec2u(half));
        }
    }
    sums[lane] = sum;
    workgroupBarrier();
    for (var half_of = LANES / 2u; half_of > 0u; half_of /= 2u) {
        if lane < half_of {
            sums[lane] += sums[lane + half_of];
        }
        workgroupBarrier();
    }
    if lane == 0u {
        partial[group.x] = sums[0];
    }
}
