// The camera's picture with the shadows of virtual objects: the background of virtual surfaces.

// A shadow-buffer texel is a point sample whose few look-ups per light are rotated from texel to
// texel, while a camera pixel is an area. So the eight neighbours on the same side of all real
// edges are averaged in.
fn smooth_shadow_at(pixel: vec2i) -> vec3f {
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let own = textureLoad(shadow, pixel, 0);
    var sum = 4.0 * own.rgb;
    var weight = 4.0;
    for (var k = 0; k < 8; k++) {
        let q = clamp(pixel + vec2i(round(around(k))), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let w = select(select(1.0, 2.0, (k & 1) == 0), 0.0, real_edge(own.a, there.a));
        sum += there.rgb * w;
        weight += w;
    }
    return sum / weight;
}

// Light from the surface cache is filtered already.
fn shadow_at(pixel: vec2i) -> vec3f {
    if CACHED {
        return textureLoad(shadow, pixel, 0).rgb;
    }
    return smooth_shadow_at(pixel);
}

fn shadowed(code: vec3f, factor: vec3f, pixel: vec2i) -> vec3f {
    let linear = linear_of(code);
    let lacking = in_exposure(factor) * brightness_at(vec2f(pixel));
    return select(linear * factor, max(linear - lacking, vec3f(0.0)), frame.counts.y == 1u);
}

// A real edge near a pixel.
struct Across {
    // Key of the surface across it, or the pixel's own key at the rim of a real shadow; -1 without an
    // edge, or if the edge makes no difference.
    key: f32,
    // The light share, as a level, that separates the two sides of a rim.
    middle: f32,
}

fn across_real_edge(pixel: vec2i, own: vec4f, last: vec2i) -> Across {
    var other = -1.0;
    var levels = vec2f(share_level(own.a));
    for (var k = 0; k < 16; k++) {
        let r = EDGE_ERROR * select(1.0, 0.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let differs = any(abs(there.rgb - own.rgb) > vec3f(EDGE_CONTRAST));
        other = select(other, key_of(there.a), differs & real_edge(own.a, there.a));
        let level = share_level(there.a);
        let counts = (level > 0.0) & (key_of(there.a) == key_of(own.a));
        levels = select(levels, vec2f(min(levels.x, level), max(levels.y, level)), counts);
    }
    return Across(other, 0.5 * (levels.x + levels.y));
}

fn is_certain(q: vec2i, there: vec4f, last: vec2i) -> bool {
    var certain = true;
    for (var k = 0; k < 8; k += 2) {
        let beside = clamp(q + vec2i(round(around(k) * 2.0)), vec2i(0), last);
        certain &= !real_edge(there.a, textureLoad(shadow, beside, 0).a);
    }
    return certain;
}

// One side of a real edge: sums over pixels that certainly lie there.
struct Side {
    // Linear light of the picture, its square, and the factor on it.
    light: vec3f,
    square: f32,
    factor: vec3f,
    count: f32,
}

fn with_pixel(s: Side, light: vec3f, factor: vec3f, counts: bool) -> Side {
    let w = select(0.0, 1.0, counts);
    return Side(s.light + light * w, s.square + dot(light, light) * w, s.factor + factor * w, s.count + w);
}

// Variance of the light on a side whose mean is `mean`.
fn variance_of(s: Side, mean: vec3f) -> f32 {
    return max(s.square / max(s.count, 1.0) - dot(mean, mean), 0.0);
}

// The shadowed picture near a real edge.
struct AtEdge {
    light: vec3f,
    found: bool,
}

// The picture's light at a pixel, divided between both sides of a real edge near it, each part with
// its side's factor. The camera mixed both sides there: `linear` = a A + (1 - a) B, with A and B the
// light of pixels that certainly lie on either side, and fA = `own_factor`, so that the factor of the
// whole is
//
//   f = (a fA A + (1 - a) fB B) / (a A + (1 - a) B)
//
// At the rim of a real shadow the factor changes as fast as the light: there it is that of pixels
// which certainly lie on the same side. What `a` is shows as far as A differs from B, and texture on
// both sides is weak; otherwise the pixel belongs to its own surface, and at a rim, where a pixel
// that is darkened twice shows more than one that is not darkened enough, the larger factor counts.
// The result is limited to the range of both sides.
fn divided_at_edge(pixel: vec2i, linear: vec3f, own_factor: vec3f) -> AtEdge {
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let own = textureLoad(shadow, pixel, 0);
    let edge = across_real_edge(pixel, own, last);
    let other = edge.key;
    if other < 0.0 {
        return AtEdge(vec3f(0.0), false);
    }
    let is_rim = other == key_of(own.a);
    let is_lit = share_level(own.a) > edge.middle;
    let is_own_certain = !is_rim || is_certain(pixel, own, last);
    let nothing = Side(vec3f(0.0), 0.0, vec3f(0.0), 0.0);
    var here = nothing;
    var across = nothing;
    var low = vec3f(1e9);
    var high = vec3f(-1e9);
    for (var k = 0; k < 16; k++) {
        let r = EDGE_ERROR * select(1.5, 2.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let key = key_of(there.a);
        let counts = ((key == key_of(own.a)) | (key == other)) && is_certain(q, there, last);
        let light = linear_of(textureLoad(camera, q, 0).rgb);
        // The rim of a real shadow lies within one surface.
        let is_here = select(key == key_of(own.a), (share_level(there.a) > edge.middle) == is_lit, is_rim);
        let same = is_own_certain & !real_edge(own.a, there.a);
        here = with_pixel(here, light, there.rgb, counts & is_here);
        across = with_pixel(across, light, there.rgb, counts & !is_here);
        // On the pixel's own side its own factor counts too: the shadow of a thin object, or in a
        // corner, may lie between the sampled texels.
        let lowest = select(there.rgb, min(there.rgb, own.rgb), same);
        let highest = select(there.rgb, max(there.rgb, own.rgb), same);
        low = select(low, min(low, light * lowest), counts);
        high = select(high, max(high, light * highest), counts);
    }
    let two_sides = here.count > 0.0 && across.count > 0.0;
    if !two_sides && (!is_rim || low.r > high.r) {
        return AtEdge(vec3f(0.0), false);
    }
    let a_light = here.light / max(here.count, 1.0);
    let b_light = across.light / max(across.count, 1.0);
    let a_factor = select(here.factor / max(here.count, 1.0), own_factor, is_own_certain | (here.count == 0.0));
    let b_factor = across.factor / max(across.count, 1.0);
    let apart = a_light - b_light;
    let contrast = length(apart) / max(length(a_light) + length(b_light), 1e-6);
    let a = clamp(dot(linear - b_light, apart) / max(dot(apart, apart), 1e-9), 0.0, 1.0);
    let mixed = mix(b_light, a_light, a);
    let factor = mix(b_light * b_factor, a_light * a_factor, a) / max(mixed, vec3f(1e-6));
    let spread = variance_of(here, a_light) + variance_of(across, b_light);
    let beside = linear - mixed;
    let texture = sqrt((dot(beside, beside) + spread) / max(dot(apart, apart), 1e-9));
    let differs = select(0.0, 1.0, two_sides) * smoothstep(EDGE_KNOWN.x, EDGE_KNOWN.y, contrast);
    let known = differs * (1.0 - smoothstep(EDGE_TEXTURE.x, EDGE_TEXTURE.y, texture));
    let divided = clamp(linear * mix(own_factor, factor, known), low, high);
    let lightest = max(linear * own_factor, min(linear * factor, high));
    let textured = mix(linear * own_factor, lightest, differs);
    let at_rim = mix(textured, clamp(linear * factor, low, high), known);
    return AtEdge(select(divided, at_rim, is_rim), true);
}

// The picture's light with what a real mirror shows of virtual objects; see `in_real_mirror`.
fn with_reflections(linear: vec3f, mirrored: vec4f, pixel: vec2i) -> vec3f {
    return linear * mirrored.a + in_exposure(mirrored.rgb) * brightness_at(vec2f(pixel));
}

// `near_edge`: whether a real edge may be near; `covered`: in a covered tile, in which alone mirrors are
// known.
fn background_at(pixel: vec2i, near_edge: bool, covered: bool) -> vec4f {
    let code = textureLoad(camera, pixel, 0);
    let factor = shadow_at(pixel);
    let added = added_at(pixel);
    var at_edge = AtEdge(vec3f(0.0), false);
    if near_edge && frame.counts.y == 0u {
        at_edge = divided_at_edge(pixel, linear_of(code.rgb), factor);
    }
    let unshadowed = all(factor == vec3f(select(1.0, 0.0, frame.counts.y == 1u)));
    var mirrored = NO_REFLECTION;
    if NEARBY && covered {
        mirrored = in_real_mirror(pixel);
    }
    let reflects = any(mirrored != NO_REFLECTION);
    if !at_edge.found && unshadowed && !reflects && all(added == vec3f(0.0)) {
        if EXPOSED {
            return encoded(code.rgb);
        }
        return code;
    }
    let linear = select(shadowed(code.rgb, factor, pixel), at_edge.light, at_edge.found);
    return encoded(with_reflections(linear, mirrored, pixel) + in_exposure(added));
}
