// Divides the composed picture into virtual surfaces and the change of the real picture.

@group(1) @binding(0) var camera: texture_2d<f32>;
@group(1) @binding(2) var composed: texture_2d<f32>;
@group(1) @binding(3) var virtual_shape: VIRTUAL_TEXTURE;

// Without distortion the depth buffer holds the kind of each pixel, as the composite wrote it; a
// draw for one kind uses a depth between that and the next.
const OUTLINE = 0.0;
const NOTHING_VIRTUAL = 0.5;
const INTERIOR = 1.0;

fn corner_at(v: u32, depth: f32) -> vec4f {
    let corner = look_corner(v, look.reach.x);
    return vec4f(corner.xy, depth, 1.0);
}

@vertex
fn open_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return corner_at(v, NOTHING_VIRTUAL);
}

@vertex
fn inside_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return corner_at(v, 0.5 * (NOTHING_VIRTUAL + INTERIOR));
}

@vertex
fn layers_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    return corner_at(v, 0.5 * (OUTLINE + NOTHING_VIRTUAL));
}

// Pixels without virtual surfaces.
@fragment
fn open(@builtin(position) position: vec4f) -> Layers {
    let pixel = vec2i(position.xy);
    let change = change_at(textureLoad(composed, pixel, 0).rgb, textureLoad(camera, pixel, 0).rgb);
    return Layers(vec4f(0.0), vec4f(change.rgb * change.a, change.a));
}

// Pixels that virtual surfaces cover.
@fragment
fn inside(@builtin(position) position: vec4f) -> Layers {
    let code = textureLoad(composed, vec2i(position.xy), 0);
    return Layers(vec4f(linear_from_code(code.rgb), 1.0), vec4f(0.0));
}

// Share of a pixel that virtual surfaces cover. The distorted picture holds 1 - share as alpha.
fn coverage(pixel: vec2i, composed_alpha: f32) -> f32 {
    if DISTORTED {
        return 1.0 - composed_alpha;
    }
    var covered = 0;
    for (var s = 0; s < SAMPLES; s++) {
        covered += select(0, 1, is_surface(textureLoad(virtual_shape, pixel, s)));
    }
    return f32(covered) / f32(SAMPLES);
}

// Ratio of the composed to the real picture at a pixel, and the weight of the pixel. Exactly 1 where
// nothing is changed.
fn change_at(code: vec3f, texel: vec3f) -> vec4f {
    let shown = linear_from_code(code);
    let real = real_light(texel);
    let same = is_unchanged(code, texel);
    let ratio = select((shown + DARK) / (real + DARK), vec3f(1.0), same);
    return vec4f(ratio, dot(real, vec3f(1.0 / 3.0)) + DARK);
}

// Change of the real picture behind an outline: that of its neighbours without virtual surfaces.
fn change_beside(pixel: vec2i, is_outline: bool) -> vec4f {
    let last = vec2i(textureDimensions(composed)) - vec2i(1);
    var sum = vec4f(0.0);
    var k = 0;
    // The condition is at the end, for software drivers.
    loop {
        let around = vec2i(k % 3 - 1, k / 3 - 1);
        let q = clamp(pixel + around, vec2i(0), last);
        let code = textureLoad(composed, q, 0);
        let change = change_at(code.rgb, textureLoad(camera, q, 0).rgb);
        let weight = select(0.0, change.a, coverage(q, code.a) == 0.0);
        sum += vec4f(change.rgb, 1.0) * weight;
        k += 1;
        continuing {
            break if !is_outline || k == 9;
        }
    }
    return select(vec4f(1.0, 1.0, 1.0, 0.0), vec4f(sum.rgb / max(sum.a, 1e-6), 1.0), sum.a > 0.0);
}

// Any pixel.
@fragment
fn layers(@builtin(position) position: vec4f) -> Layers {
    let pixel = vec2i(position.xy);
    let code = textureLoad(composed, pixel, 0);
    let texel = textureLoad(camera, pixel, 0).rgb;
    let covered = coverage(pixel, code.a);
    let own = change_at(code.rgb, texel);
    let is_outline = (covered > 0.0) & (covered < 1.0);
    let beside = change_beside(pixel, is_outline);
    let ratio = select(own.rgb, beside.rgb, covered > 0.0);
    let weight = own.a * select(1.0, (1.0 - covered) * beside.a, covered > 0.0);
    let behind = max((real_light(texel) + DARK) * ratio - DARK, vec3f(0.0)) * (1.0 - covered);
    let surface = max(linear_from_code(code.rgb) - behind, vec3f(0.0));
    return Layers(
        select(vec4f(0.0), vec4f(surface, covered), covered > 0.0),
        // Equal products, so that the sums of unchanged pixels are equal.
        vec4f(ratio * weight, weight),
    );
}
