// Rectangular lamps. Twins: `reference::area`.

// Screen pictures of the lamps, one per layer: 64² texels of mean luminance 1, with all mip levels.
@group(0) @binding(10) var lamp_screens: texture_2d_array<f32>;

// Mip level at which a screen has 4² texels.
const PATCH_LEVEL = 4;
const PATCHES = 4u;
// Look-ups for the shadow of one cell.
const AREA_TAPS = min(SOFT, 4);

fn unit(v: vec3f) -> vec3f {
    return v * inverseSqrt(max(dot(v, v), 1e-30));
}

struct Rectangle {
    centre: vec3f,
    right: vec3f,
    up: vec3f,
    normal: vec3f,
    // Square metres.
    size: f32,
}

fn rectangle_of(k: u32) -> Rectangle {
    let r = lamps.each[k].half_right.xyz;
    let u = lamps.each[k].half_up.xyz;
    return Rectangle(lamps.each[k].position.xyz, r, u, lamps.each[k].direction.xyz, 4.0 * length(r) * length(u));
}

// Contribution of the arc between unit vectors `a` and `b` to Lambert's sum (1760): θ / (2π sin θ)
// times their cross product, where θ is the angle between them. The quotient is Hill's fit as a
// function of cos θ (Heitz, Hill 2017), maximum error 1e-4.
fn arc(a: vec3f, b: vec3f) -> vec3f {
    let x = dot(a, b);
    let y = abs(x);
    let fit = (0.8543985 + (0.4965155 + 0.0145206 * y) * y) / (3.4175940 + (4.1616724 + y) * y);
    let obtuse = 0.5 * inverseSqrt(max(1.0 - x * x, 1e-7)) - fit;
    return cross(a, b) * select(obtuse, fit, x > 0.0);
}

// The part of the polygon's boundary above the horizon, summed so far.
struct Clipped {
    sum: f32,
    // Where the boundary crosses the horizon downwards and upwards; zero if it has not yet.
    down: vec3f,
    up: vec3f,
}

fn clipped(so_far: Clipped, a: vec3f, b: vec3f, n: vec3f) -> Clipped {
    let ha = dot(n, a);
    let hb = dot(n, b);
    let crossing = unit(mix(a, b, clamp(ha / select(ha - hb, 1.0, ha == hb), 0.0, 1.0)));
    let from_ = select(crossing, unit(a), ha > 0.0);
    let to = select(crossing, unit(b), hb > 0.0);
    let part = select(0.0, dot(arc(from_, to), n), ha > 0.0 || hb > 0.0);
    return Clipped(
        so_far.sum + part,
        select(so_far.down, crossing, ha > 0.0 && hb <= 0.0),
        select(so_far.up, crossing, ha <= 0.0 && hb > 0.0),
    );
}

// Fraction of the cosine-weighted hemisphere about `n` that a convex quadrilateral fills: Lambert's
// formula over its part above the horizon. Corners relative to the point, in either orientation.
fn form_factor(a: vec3f, b: vec3f, c: vec3f, d: vec3f, n: vec3f) -> f32 {
    var s = Clipped(0.0, vec3f(0.0), vec3f(0.0));
    s = clipped(s, a, b, n);
    s = clipped(s, b, c, n);
    s = clipped(s, c, d, n);
    s = clipped(s, d, a, n);
    // Close the boundary along the horizon, from the downward to the upward crossing.
    return abs(s.sum + dot(arc(s.down, s.up), n));
}

// Whether the lamp emits to the side on which a point lies.
fn shines_towards(k: u32, off: vec3f) -> bool {
    return dot(off, lamps.each[k].direction.xyz) > 0.0 || lamps.each[k].half_up.w > 0.5;
}

// Approximate form factor of a small patch, approximated as a disc of the same area, at `to` from
// the point, up to a factor that all patches of a lamp share.
fn patch_weight(to: vec3f, n: vec3f, r: Rectangle, size: f32) -> f32 {
    let r2 = dot(to, to);
    let cosines = max(dot(n, to), 0.0) * abs(dot(r.normal, to));
    return cosines / (r2 * (r2 + size * (1.0 / 3.14159265)) + 1e-12) + 1e-12;
}

// View position on the lamp of the shadow map of cell (x, y) of `across` × `across`, from the upper
// left. Twin of `lamp_coverage::eyes`.
fn area_eye(r: Rectangle, x: u32, y: u32, across: f32) -> vec3f {
    let cell = vec2f(f32(x), f32(y));
    let at = (cell + (cell.yx + 0.5) / across) * (2.0 / across) - 1.0;
    return r.centre + r.right * at.x - r.up * at.y;
}

// Fraction of a cell of the lamp that a point sees: hard with one look-up; with more,
// percentage-closer soft shadows whose filter width is that of the cell (Fernando 2005). Depth in a
// map is affine on a plane, so each look-up is compared with the depth of the surface's own plane
// there.
fn cell_seen(k: u32, r: Rectangle, x: u32, y: u32, across: f32, world: vec3f, n: vec3f) -> f32 {
    let off = world - area_eye(r, x, y, across);
    let n_dot_l = dot(n, unit(off));
    // As in `lifted`: off the surface by the texel that it may share with its own caster.
    let there = on_map(k, off, n, 1.0 + 2.0 * sqrt(max(1.0 - n_dot_l * n_dot_l, 0.0)));
    let size = f32(textureDimensions(lamp_maps).x);
    // Width of a texel in view coordinates (−1 to 1).
    let texel = 2.0 * across / size;
    let corner = vec2f(f32(x), f32(y)) / across;
    let on_plane = depth_on_map(there, k);
    let depth = on_plane.depth;
    let slope = on_plane.slope;
    var seen = 0.0;
    if SOFT == 1 {
        seen = textureSampleCompareLevel(lamp_maps, lamp_compare, tile_uv(there.q, corner, across, texel), there.layer, depth);
    } else {
        let tangent = lamps.each[k].up.w;
        // Half the width of the cell, projected from the surface.
        let cell = 0.5 * sqrt(r.size) / across;
        let search = clamp(cell / (max(there.depth, LAMP_NEAR) * tangent), texel, 0.5);
        let rotation = area_rotation(world, f32(k) + 4.0 * f32(x) + f32(y));
        var blockers = 0.0;
        var sum = 0.0;
        for (var i = 0; i < AREA_TAPS; i++) {
            let o = area_disc(i, rotation) * search;
            let uv = tile_uv(there.q + o, corner, across, texel);
            let z = textureLoad(lamp_maps, vec2i(uv * size), there.layer, 0);
            let blocks = z > (depth + dot(slope, o)) * 1.002;
            blockers += select(0.0, 1.0, blocks);
            sum += select(0.0, z, blocks);
        }
        let nearer = sum / max(blockers, 1.0) - depth;
        let width = clamp(cell * nearer / (LAMP_NEAR * tangent), 0.7 * texel, 0.5);
        for (var i = 0; i < AREA_TAPS; i++) {
            let o = area_disc(i, rotation) * width;
            let uv = tile_uv(there.q + o, corner, across, texel);
            seen += textureSampleCompareLevel(lamp_maps, lamp_compare, uv, there.layer, depth + dot(slope, o));
        }
        seen = select(seen / f32(AREA_TAPS), 1.0, blockers == 0.0);
    }
    // The form factor already excludes the part of the lamp below the surface's own horizon.
    return select(1.0, seen, there.mapped && dot(n, off) < 0.0);
}

// Texture coordinates in a view's own tile of the map, kept away from neighbouring tiles.
fn tile_uv(q: vec2f, corner: vec2f, across: f32, texel: f32) -> vec2f {
    let inside = clamp(q, vec2f(texel * 0.5 - 1.0), vec2f(1.0 - texel * 0.5));
    return corner + vec2f(0.5 + 0.5 * inside.x, 0.5 - 0.5 * inside.y) / across;
}

// Point `i` of a disc (Vogel 1979), rotated by the angle of cosine and sine `rotation`.
fn area_disc(i: i32, rotation: vec2f) -> vec2f {
    let angle = 2.39996323 * f32(i);
    let p = sqrt((f32(i) + 0.5) / f32(AREA_TAPS)) * vec2f(cos(angle), sin(angle));
    return vec2f(p.x * rotation.x - p.y * rotation.y, p.x * rotation.y + p.y * rotation.x);
}

// A rotation that differs between pixels and is the same in every frame.
fn area_rotation(world: vec3f, i: f32) -> vec2f {
    let place = dot(pixel_of(world).xy, vec2f(0.06711056, 0.00583715));
    let angle = 6.2831853 * fract(52.9829189 * fract(place) + 0.618034 * i);
    return vec2f(cos(angle), sin(angle));
}

// Irradiance from one rectangular lamp, with its shadow at the frame's shadow strength. The form
// factor of the entire area is exact; small discs approximate how it divides among the cells, each
// with a shadow of its own, and the parts of its picture.
fn irradiance_of_area(k: u32, world: vec3f, n: vec3f) -> vec3f {
    let r = rectangle_of(k);
    let to = r.centre - world;
    let total = form_factor(to - r.right - r.up, to + r.right - r.up, to + r.right + r.up, to - r.right + r.up, n);
    let layer = i32(lamps.each[k].half_right.w);
    let across = u32(lamps.each[k].intensity.w);
    // Parts of the picture in each cell, per axis.
    let parts = select(1u, PATCHES / across, layer > 0);
    let step = 2.0 / f32(across * parts);
    let size = 0.25 * r.size * step * step;
    var colour = vec3f(0.0);
    var weights = 0.0;
    var cell = 0u;
    loop {
        let x = cell % across;
        let y = cell / across;
        let seen = mix(1.0, cell_seen(k, r, x, y, f32(across), world, n), frame.params.x);
        var part = 0u;
        loop {
            let place = vec2u(x * parts + part % parts, y * parts + part / parts);
            let at = (vec2f(place) + 0.5) * step - 1.0;
            let w = patch_weight(to + r.right * at.x - r.up * at.y, n, r, size);
            colour += textureLoad(lamp_screens, place, layer, PATCH_LEVEL).rgb * (w * seen);
            weights += w;
            continuing {
                part += 1u;
                break if part >= parts * parts;
            }
        }
        continuing {
            cell += 1u;
            break if cell >= across * across;
        }
    }
    let radiance = lamps.each[k].intensity.rgb * (colour / (weights * r.size));
    return select(vec3f(0.0), radiance * (3.14159265 * total), shines_towards(k, -to));
}

// Fraction of the lamp that a point sees, from four of its cells; for specular reflection.
fn area_seen(k: u32, r: Rectangle, world: vec3f, n: vec3f) -> f32 {
    let across = u32(lamps.each[k].intensity.w);
    let last = across - 1u;
    let a = f32(across);
    let near = across / 3u;
    return 0.25 * (cell_seen(k, r, near, near, a, world, n) + cell_seen(k, r, last - near, near, a, world, n)
        + cell_seen(k, r, near, last - near, a, world, n) + cell_seen(k, r, last - near, last - near, a, world, n));
}
