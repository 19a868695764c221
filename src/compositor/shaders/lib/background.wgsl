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

// Range of the values shown on both sides of a real edge near `pixel`; empty (low > high) without
// such an edge. Only texels without an edge near them count.
struct Range {
    low: vec3f,
    high: vec3f,
}

// Key of the surface across a real edge near `pixel`, or the pixel's own key at the rim of a real
// shadow; -1 without an edge, or if the edge makes no difference.
fn across_real_edge(pixel: vec2i, own: vec4f, last: vec2i) -> f32 {
    var other = -1.0;
    for (var k = 0; k < 16; k++) {
        let r = EDGE_ERROR * select(1.0, 0.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let differs = any(abs(there.rgb - own.rgb) > vec3f(EDGE_CONTRAST));
        other = select(other, key_of(there.a), differs & real_edge(own.a, there.a));
    }
    return other;
}

fn is_certain(q: vec2i, there: vec4f, last: vec2i) -> bool {
    var certain = true;
    for (var k = 0; k < 8; k += 2) {
        let beside = clamp(q + vec2i(round(around(k) * 2.0)), vec2i(0), last);
        certain &= !real_edge(there.a, textureLoad(shadow, beside, 0).a);
    }
    return certain;
}

fn beside_edge(pixel: vec2i) -> Range {
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let own = textureLoad(shadow, pixel, 0);
    let other = across_real_edge(pixel, own, last);
    var range = Range(vec3f(1e9), vec3f(-1e9));
    if other < 0.0 {
        return range;
    }
    var on_own = false;
    var across = false;
    for (var k = 0; k < 16; k++) {
        let r = EDGE_ERROR * select(1.5, 2.5, k >= 8);
        let q = clamp(pixel + vec2i(round(around(k) * r)), vec2i(0), last);
        let there = textureLoad(shadow, q, 0);
        let key = key_of(there.a);
        let counts = ((key == key_of(own.a)) | (key == other)) && is_certain(q, there, last);
        let linear = linear_of(textureLoad(camera, q, 0).rgb);
        // On the pixel's own side its own factor counts too: the shadow of a thin object, or in a
        // corner, may lie between the sampled texels.
        let same = !real_edge(own.a, there.a);
        let lowest = select(there.rgb, min(there.rgb, own.rgb), same);
        let highest = select(there.rgb, max(there.rgb, own.rgb), same);
        range.low = select(range.low, min(range.low, linear * lowest), counts);
        range.high = select(range.high, max(range.high, linear * highest), counts);
        on_own |= counts & (key == key_of(own.a));
        across |= counts & (key == other);
    }
    if !(on_own & across) {
        return Range(vec3f(1e9), vec3f(-1e9));
    }
    return range;
}

// `near_edge`: whether a real edge may be near.
fn background_at(pixel: vec2i, near_edge: bool) -> vec4f {
    let code = textureLoad(camera, pixel, 0);
    let factor = shadow_at(pixel);
    let added = added_at(pixel);
    var range = Range(vec3f(1.0), vec3f(0.0));
    if near_edge && frame.counts.y == 0u {
        range = beside_edge(pixel);
    }
    let free = range.low.r > range.high.r;
    let unshadowed = all(factor == vec3f(select(1.0, 0.0, frame.counts.y == 1u)));
    if free && unshadowed && all(added == vec3f(0.0)) {
        if EXPOSED {
            return encoded(code.rgb);
        }
        return code;
    }
    let linear = shadowed(code.rgb, factor, pixel);
    return encoded(select(clamp(linear, range.low, range.high), linear, free) + in_exposure(added));
}
