// Determines for each tile of the picture which dome lights may be blocked for some surface, by
// testing the bounding box of the tile's surface points against the rectangle that each shadow map
// covers; and which lamps may light one.

@group(1) @binding(0) var phantom_normal: texture_2d<f32>;
@group(1) @binding(1) var phantom_depth: texture_depth_2d;
@group(1) @binding(2) var virtual_shape: VIRTUAL_TEXTURE;
@group(1) @binding(3) var virtual_depth: VIRTUAL_DEPTH;

struct Bounds {
    low: vec3f,
    high: vec3f,
    normal_low: vec3f,
    normal_high: vec3f,
}

fn nothing() -> Bounds {
    return Bounds(vec3f(1e9), vec3f(-1e9), vec3f(1.0), vec3f(-1.0));
}

fn with_point(b: Bounds, p: vec3f, n: vec3f) -> Bounds {
    return Bounds(min(b.low, p), max(b.high, p), min(b.normal_low, n), max(b.normal_high, n));
}

// Whether a shadow map covers any of the points within `extent` of `centre`, or their penumbrae.
fn reaches(i: u32, fit: vec4f, depth: vec2f, centre: vec3f, extent: vec3f) -> bool {
    let at = in_light_space(i, centre);
    let by = vec2f(dot(abs(lights[i].right.xyz), extent), dot(abs(lights[i].up.xyz), extent));
    let along = dot(abs(lights[i].direction.xyz), extent);
    let more = lights[i].place.w * along;
    // The box may reach behind a near light.
    let behind = at.w - more < 0.05;
    let widest = 1.0 / max(at.w - more, 0.05);
    let least = 1.0 / max(at.w + more, 0.05);
    let low = min((at.xy - by) * widest, (at.xy - by) * least);
    let high = max((at.xy + by) * widest, (at.xy + by) * least);
    let deepest = (at.z + along) * least * depth.x + depth.y;
    // Penumbrae extend beyond the map.
    let spread = select(0.0, lights[i].more.w, SOFT > 1);
    let wider = spread * max(deepest, 0.0) / max(depth.x, 1e-9) * fit.xy;
    let inside = all(high * fit.xy + fit.zw + wider > vec2f(0.0)) && all(low * fit.xy + fit.zw - wider < vec2f(1.0));
    return depth.x > 0.0 && (behind || (inside && deepest > 0.0));
}

fn faces(i: u32, b: Bounds) -> bool {
    let centre = 0.5 * (b.normal_low + b.normal_high);
    let extent = 0.5 * (b.normal_high - b.normal_low);
    let v = towards_light(i, 0.5 * (b.low + b.high));
    let around = lights[i].place.w * 0.5 * (b.high - b.low);
    return dot(v, centre) + dot(abs(v), extent) + dot(around, abs(centre) + extent) > 0.0;
}

// The bit of a light in a mask; lights are iterated in order.
struct LightBit {
    bit: vec2u,
    // Remaining lights that share the bit.
    left: u32,
}

fn next_bit(p: LightBit) -> LightBit {
    if p.left > 0u {
        return LightBit(p.bit, p.left - 1u);
    }
    // The first call sets the first bit; the low word's last bit carries to the high word's first.
    let carry = p.bit.x >> 31u;
    let first = select(0u, 1u, all(p.bit == vec2u(0u)));
    return LightBit(vec2u((p.bit.x << 1u) | first, (p.bit.y << 1u) | carry), frame.tiling.x - 1u);
}

fn all_lights(count: u32) -> vec4u {
    var masks = vec4u(0u);
    var position = LightBit(vec2u(0u), 0u);
    for (var i = 0u; i < count; i++) {
        position = next_bit(position);
        masks |= vec4u(position.bit, position.bit);
    }
    return masks;
}

// x, y: lights that virtual casters may block; z, w: lights that phantoms may block.
fn blockable(b: Bounds, count: u32) -> vec4u {
    var masks = vec4u(0u);
    if any(b.low > b.high) {
        return masks;
    }
    let centre = 0.5 * (b.low + b.high);
    var position = LightBit(vec2u(0u), 0u);
    for (var i = 0u; i < count; i++) {
        position = next_bit(position);
        let word = position.bit;
        let dark = all(lights[i].irradiance.rgb == vec3f(0.0));
        if dark | !faces(i, b) {
            continue;
        }
        // Shading lifts points off their surface by up to two texels.
        let extent = 0.5 * (b.high - b.low);
        let near = extent + vec3f(2.0 * lights[i].more.y);
        let far = extent + vec3f(2.0 * lights[i].more.z);
        if reaches(i, lights[i].virtual_fit, lights[i].depths.xy, centre, near) {
            masks |= vec4u(word, 0u, 0u);
        }
        if reaches(i, lights[i].phantom_fit, lights[i].depths.zw, centre, far) {
            masks |= vec4u(0u, 0u, word);
        }
    }
    return masks;
}

// Indirect light from virtual objects also reaches surfaces without virtual shadows.
fn is_near(b: Bounds) -> bool {
    let margin = vec3f(0.02);
    return (frame.indirect_low.w != 0.0) & all(b.high > frame.indirect_low.xyz - margin)
        & all(b.low < frame.indirect_high.xyz + margin);
}

// Shadowing planes do not distinguish lights: everything that they cover may be in shadow.
fn is_on_planes(b: Bounds) -> bool {
    return (frame.planes_low.w != 0.0) & all(b.high > frame.planes_low.xyz)
        & all(b.low < frame.planes_high.xyz);
}

// Whether some surface in the box may face something within `radius` of `position`.
fn may_face(b: Bounds, position: vec3f, radius: f32) -> bool {
    let near = position - b.high - vec3f(radius);
    let far = position - b.low + vec3f(radius);
    let max_dot = max(max(b.normal_low * near, b.normal_low * far), max(b.normal_high * near, b.normal_high * far));
    return max_dot.x + max_dot.y + max_dot.z > 0.0;
}

// Lamps, one bit each, that may light anything in the box.
fn lamps_on(b: Bounds) -> u32 {
    if !LAMPED || any(b.low > b.high) {
        return 0u;
    }
    var mask = 0u;
    let count = non_uniform(lamps.count.x, b.low.x);
    for (var k = 0u; k < count; k++) {
        let shines = may_face(b, lamps.each[k].position.xyz, lamp_radius(k)) && lamp_reaches(k, b.low, b.high);
        mask |= select(0u, 1u << k, shines);
    }
    return mask;
}

fn all_lamps() -> u32 {
    // Shifting by all 32 bits is undefined.
    return select(0u, 0xffffffffu >> (32u - max(lamps.count.x, 1u)), lamps.count.x > 0u);
}

// The box with the points between the sampled pixels, `step` pixels apart: a spot's edge is drawn at
// the picture's resolution.
fn widened_by(b: Bounds, step: f32) -> Bounds {
    let between = 0.1 * (b.high - b.low) + vec3f(step * distance(frame.eye.xyz, b.low) / frame.intrinsics.x);
    return Bounds(b.low - between, b.high + between, b.normal_low, b.normal_high);
}

fn widened(b: Bounds) -> Bounds {
    if !CACHED {
        return b;
    }
    let normals = vec3f(0.1);
    return widened_by(Bounds(b.low, b.high, b.normal_low - normals, b.normal_high + normals), 4.0);
}

struct Classes {
    // Lights that virtual casters (x, y) and phantoms (z, w) may block.
    @location(0) lights: vec4u,
    @location(1) lamps: u32,
}

// With the surface cache only lamps depend on the tile, and every fourth pixel tells which light it.
const REAL_STEP = select(1, 4, CACHED);

@fragment
fn classify_real(@builtin(position) at: vec4f) -> Classes {
    let side = i32(non_uniform(frame.tiling.y, at.w));
    let corner = vec2i(at.xy) * side;
    let last = vec2i(frame.size.xy) - vec2i(1);
    var real = nothing();
    for (var y = 0; y < side; y += REAL_STEP) {
        for (var x = 0; x < side; x += REAL_STEP) {
            let pixel = min(corner + vec2i(x, y), last);
            let surface = textureLoad(phantom_normal, pixel, 0);
            if surface.z == 1.0 {
                let depth = textureLoad(phantom_depth, pixel, 0);
                let n = normal_from_octahedron(surface.xy);
                real = with_point(real, world_at(vec2f(pixel), depth), n);
            }
        }
    }
    var masks = blockable(real, non_uniform(frame.counts.x, at.w));
    // A surface may lie between the pixels that were looked at, or be seen by none of them.
    let missed = CACHED && any(real.low > real.high);
    let lit = select(lamps_on(widened(real)), all_lamps(), missed);
    // Any light's bit causes the tile to be drawn.
    masks.x |= select(0u, 1u, is_near(real) | is_on_planes(real) | (lit != 0u) | CACHED);
    return Classes(masks, lit);
}

// The same for virtual surfaces, from every other pixel. Where those miss all surfaces (a wire),
// any light may be blocked.
@fragment
fn classify_virtual(@builtin(position) at: vec4f) -> Classes {
    let side = i32(non_uniform(frame.tiling.y, at.w));
    let corner = vec2i(at.xy) * side;
    let last = vec2i(frame.size.xy) - vec2i(1);
    var bounds = nothing();
    for (var y = 0; y < side; y += 2) {
        for (var x = 0; x < side; x += 2) {
            let pixel = min(corner + vec2i(x, y), last);
            let shape = textureLoad(virtual_shape, pixel, 0);
            if is_surface(shape) {
                let depth = textureLoad(virtual_depth, pixel, 0);
                let n = normal_from_octahedron(octahedron(shape));
                bounds = with_point(bounds, world_at(sample_position(pixel, 0), depth), n);
            }
        }
    }
    if any(bounds.low > bounds.high) {
        return Classes(all_lights(non_uniform(frame.counts.x, at.w)), all_lamps());
    }
    // Between the sampled pixels, normals may vary a little further.
    bounds.normal_low -= vec3f(0.1);
    bounds.normal_high += vec3f(0.1);
    let masks = blockable(bounds, non_uniform(frame.counts.x, at.w));
    return Classes(masks, lamps_on(widened_by(bounds, 2.0)));
}
