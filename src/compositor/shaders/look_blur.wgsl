// Motion blur and defocus of both layers: the mean over the path of a point during the exposure and
// over its circle of confusion.

@group(1) @binding(0) var surface: texture_2d<f32>;
@group(1) @binding(1) var change: texture_2d<f32>;
@group(1) @binding(2) var smooth_sampler: sampler;
// Motion over the exposure and radius of the circle of confusion, pixels, by cell.
@group(1) @binding(3) var field: texture_2d<f32>;

@vertex
fn blur_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return look_corner(v, look.reach.y);
}

fn field_at(pixel: vec2f) -> vec3f {
    let at = (pixel + vec2f(0.5)) / f32(CELL) - vec2f(0.5);
    let corner = floor(at);
    let part = at - corner;
    let last = vec2i(textureDimensions(field)) - vec2i(1);
    var sum = vec3f(0.0);
    for (var k = 0; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let weights = mix(vec2f(1.0) - part, part, vec2f(o));
        let q = clamp(vec2i(corner) + o, vec2i(0), last);
        sum += textureLoad(field, q, 0).xyz * (weights.x * weights.y);
    }
    return sum;
}

// Interleaved gradient noise (Jimenez 2014): breaks up the copies that few samples leave.
fn jitter(pixel: vec2f) -> f32 {
    return fract(52.9829189 * fract(dot(pixel, vec2f(0.06711056, 0.00583715))));
}

@fragment
fn blur(@builtin(position) position: vec4f) -> Layers {
    let blur = field_at(position.xy - vec2f(0.5));
    let shift = (jitter(position.xy) - 0.5) / f32(TAPS);
    var sum = Layers(vec4f(0.0), vec4f(0.0));
    for (var k = 0; k < TAPS; k++) {
        let tap = look.taps[k].xyz;
        let at = (position.xy + blur.xy * (tap.x + shift) + blur.z * tap.yz) * look.size.zw;
        sum.surface += textureSampleLevel(surface, smooth_sampler, at, 0.0);
        sum.change += textureSampleLevel(change, smooth_sampler, at, 0.0);
    }
    return Layers(sum.surface / f32(TAPS), sum.change / f32(TAPS));
}
