// What glossy surfaces mirror of their neighbourhood, by rays that the processor has traced. Twin of
// `reflections::stage`.

// Light with a common exponent; open and seen as half floats; the place in the picture; the length as
// a share of the distance there, and the distance along the camera's axis, negative on a real mirror, 0
// without a glossy surface, as half floats.
@group(3) @binding(6) var nearby: texture_2d<u32>;

struct Nearby {
    // Radiance of what the picture does not show.
    light: vec3f,
    // Share of the lobe that meets nothing close by.
    open: f32,
    // Share that meets what the picture shows.
    seen: f32,
    // The mean of where that is in the picture, in its width and height, and of the foreshortened length of the way
    // to it as a share of its distance along the camera's axis.
    place: vec3f,
}

// Twin of `with_common_exponent`.
fn light_of(texel: vec4u) -> vec3f {
    let numbers = vec3u(texel.x, texel.x >> 9u, texel.x >> 18u) & vec3u(511u);
    return vec3f(numbers) * exp2(f32(texel.x >> 27u) - 24.0);
}

// Difference of distance, as a share of it, from which two points belong to different surfaces.
const SAME_DISTANCE: f32 = 0.01;

// At a place in the picture that shows a surface `z` metres along the view.
fn nearby_at(at: vec2f, z: f32) -> Nearby {
    let last = vec2i(textureDimensions(nearby)) - vec2i(1);
    let corner = floor(at);
    let part = at - corner;
    var light = vec3f(0.0);
    var shares = vec2f(0.0);
    var place = vec3f(0.0);
    var weight = 0.0;
    for (var k = 0; k < 4; k++) {
        let o = vec2i(k & 1, k >> 1u);
        let texel = textureLoad(nearby, clamp(vec2i(corner) + o, vec2i(0), last), 0);
        let length_there = unpack2x16float(texel.w);
        let there = length_there.y;
        let across = select(vec2f(1.0) - part, part, o == vec2i(1));
        let apart = (there - z) / (SAME_DISTANCE * z);
        let square = apart * apart;
        let w = select(0.0, (across.x * across.y + 1e-4) / (1.0 + square * square), there > 0.0);
        let open_seen = unpack2x16float(texel.y);
        light += light_of(texel) * w;
        shares += open_seen * w;
        place += vec3f(unpack2x16unorm(texel.z), length_there.x) * (w * open_seen.y);
        weight += w;
    }
    let scale = 1.0 / max(weight, 1e-12);
    let found = weight > 1e-9;
    let open = select(1.0, shares.x * scale, found);
    let seen = select(0.0, shares.y * scale, found);
    return Nearby(light * scale, open, seen, place / max(shares.y, 1e-9));
}

// Nothing virtual in a real mirror.
const NO_REFLECTION = vec4f(0.0, 0.0, 0.0, 1.0);

// What a real mirror shows of virtual objects: light, and the share that remains of its picture.
fn in_real_mirror(pixel: vec2i) -> vec4f {
    let last = vec2i(textureDimensions(nearby)) - vec2i(1);
    let texel = textureLoad(nearby, min(pixel, last), 0);
    let open = unpack2x16float(texel.y).x;
    return select(NO_REFLECTION, vec4f(light_of(texel), open), unpack2x16float(texel.w).y < 0.0);
}
