// Virtual lamps. Twin of `gpu_data::LampUniform`.

struct Lamp {
    // w = number of its shadow maps: none, one, or the six faces of a cube.
    position: vec4f,
    // Axis of a spot; w = half angle outside which it is dark.
    direction: vec4f,
    // RGB; w = rate of its fall-off within that angle, 1 / radians; for an area, the number of
    // cells per axis into which it is divided for its shadow.
    intensity: vec4f,
    // Axes of a single map; w = its first layer, tangent of half its width, width of a texel at one
    // metre.
    right: vec4f,
    up: vec4f,
    forward: vec4f,
    // For an area, vectors from its centre to its edges; w = layer of its screen (0: plain), 1 if
    // it emits to both sides.
    half_right: vec4f,
    half_up: vec4f,
}

struct Lamps {
    // x: number of lamps; y: bit mask of the area lamps.
    count: vec4u,
    each: array<Lamp, MAX_LAMPS>,
}

@group(0) @binding(7) var<uniform> lamps: Lamps;
@group(0) @binding(8) var lamp_maps: texture_depth_2d_array;
@group(0) @binding(9) var lamp_compare: sampler_comparison;

// Light below this does not change an 8-bit picture: it is π times the radiance at which white
// shows less than half a code in the dark.
const LAMP_FAINT = 5e-4;
// Depth in a lamp's map is this, metres, over the distance.
const LAMP_NEAR = 1e-3;

// Towards lamp `k` from a point: unit vector, and the unshadowed irradiance facing the lamp.
struct LampRay {
    to: vec3f,
    facing: vec3f,
}

fn lamp_ray(k: u32, world: vec3f) -> LampRay {
    let off = lamps.each[k].position.xyz - world;
    let r2 = max(dot(off, off), 1e-8);
    let to = off * inverseSqrt(r2);
    let angle = acos(clamp(-dot(lamps.each[k].direction.xyz, to), -1.0, 1.0));
    let share = clamp((lamps.each[k].direction.w - angle) * lamps.each[k].intensity.w, 0.0, 1.0);
    return LampRay(to, lamps.each[k].intensity.rgb * (share / r2));
}

// Position of a point in the maps of a lamp.
struct OnMap {
    // −1 to 1 from the left and from below.
    q: vec2f,
    // Metres along the view.
    depth: f32,
    layer: u32,
    mapped: bool,
    // The surface's normal in the view's axes right, up and forward, and its plane's distance.
    normal: vec3f,
    plane: f32,
}

// Maps the point `off`, relative to the viewpoint of lamp `k`, after lifting it off the surface by
// `lift` texels.
fn on_map(k: u32, off: vec3f, n: vec3f, lift: f32) -> OnMap {
    let a = abs(off);
    let cube = lamps.each[k].position.w > 1.5;
    let major = max(a.x, max(a.y, a.z));
    let z = select(dot(off, lamps.each[k].forward.xyz), major, cube);
    let p = off + n * (lamps.each[k].forward.w * max(z, 0.0) * lift);
    // Faces +X −X +Y −Y +Z −Z, each with the next two axes as right and up.
    let axis = select(select(2u, 1u, a.y >= a.z), 0u, a.x >= a.y && a.x >= a.z);
    let along = select(select(p.z, p.y, axis == 1u), p.x, axis == 0u);
    let next = select(select(p.xy, p.zx, axis == 1u), p.yz, axis == 0u);
    let n_along = select(select(n.z, n.y, axis == 1u), n.x, axis == 0u) * select(1.0, -1.0, along < 0.0);
    let n_next = select(select(n.xy, n.zx, axis == 1u), n.yz, axis == 0u);
    let right = lamps.each[k].right.xyz;
    let up = lamps.each[k].up.xyz;
    let forward = lamps.each[k].forward.xyz;
    let depth = select(dot(p, forward), abs(along), cube);
    let face = select(0u, 2u * axis + select(0u, 1u, along < 0.0), cube);
    let across = select(vec2f(dot(p, right), dot(p, up)), next, cube);
    let q = across / (max(depth, LAMP_NEAR) * lamps.each[k].up.w);
    let mapped = lamps.each[k].position.w > 0.5 && depth > LAMP_NEAR && all(abs(q) < vec2f(1.0));
    let normal = select(vec3f(dot(n, right), dot(n, up), dot(n, forward)), vec3f(n_next, n_along), cube);
    return OnMap(q, depth, u32(lamps.each[k].right.w) + face, mapped, normal, dot(n, p));
}

// 1 where lamp `k` sees the point of a surface with normal `n`, 0 behind a caster, a value between
// along the shadow's edge.
fn lamp_visibility(k: u32, world: vec3f, n: vec3f) -> f32 {
    let there = on_map(k, world - lamps.each[k].position.xyz, n, 0.0);
    let seen = lamp_seen(there, depth_on_map(there, k));
    return select(1.0, seen, there.mapped);
}

// Depth in a map at a point of a surface, and its change by the position on the map. It is affine on
// a plane.
struct DepthOnMap {
    depth: f32,
    slope: vec2f,
}

fn depth_on_map(there: OnMap, k: u32) -> DepthOnMap {
    let depth = LAMP_NEAR / max(there.depth, LAMP_NEAR);
    let steep = select(max(there.plane, 1e-4), min(there.plane, -1e-4), there.plane < 0.0);
    let slope = there.normal.xy * (LAMP_NEAR * lamps.each[k].up.w / steep);
    return DepthOnMap(depth, clamp(slope, vec2f(-4.0 * depth), vec2f(4.0 * depth)));
}

// Averages four look-ups at half a texel, which doubles the width of a texel's own blur: with one
// look-up the edge of a shadow shows stairs.
// Each is compared with the depth of the surface's own plane there, raised by what the plane
// changes within the texels that the look-up blends: unlike a lift off the surface, that moves no
// edge.
fn lamp_seen(there: OnMap, on_plane: DepthOnMap) -> f32 {
    // Half a texel in view coordinates (−1 to 1).
    let half = 1.0 / f32(textureDimensions(lamp_maps).x);
    let raised = on_plane.depth * 1.0005 + dot(abs(on_plane.slope), vec2f(2.0 * half));
    let uv = vec2f(0.5 + 0.5 * there.q.x, 0.5 - 0.5 * there.q.y);
    var sum = 0.0;
    for (var i = 0; i < 4; i++) {
        let o = vec2f(vec2i(i & 1, i >> 1u) * 2 - 1) * half;
        let at = uv + vec2f(0.5, -0.5) * o;
        sum += textureSampleCompareLevel(lamp_maps, lamp_compare, at, there.layer, raised + dot(on_plane.slope, o));
    }
    return sum * 0.25;
}

// Irradiance from one lamp, with its shadow at the frame's shadow strength.
fn irradiance_of_lamp(k: u32, world: vec3f, n: vec3f) -> vec3f {
    let ray = lamp_ray(k, world);
    let n_dot_l = max(dot(n, ray.to), 0.0);
    let seen = lamp_visibility(k, world, n);
    return ray.facing * (n_dot_l * mix(1.0, seen, frame.params.x));
}

// Irradiance from the lamps of a tile's mask. The loop tests its condition at the end, because
// software drivers would otherwise run its body once more; an empty mask runs it once with weight
// 0.
fn lamp_irradiance(mask: u32, world: vec3f, n: vec3f) -> vec3f {
    if !LAMPED {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    var left = mask & ~lamps.count.y;
    loop {
        let weight = select(0.0, 1.0, left != 0u);
        sum += irradiance_of_lamp(first_lamp(left), world, n) * weight;
        left &= left - 1u;
        continuing {
            break if left == 0u;
        }
    }
    if !AREAS {
        return sum;
    }
    left = mask & lamps.count.y;
    loop {
        let weight = select(0.0, 1.0, left != 0u);
        sum += irradiance_of_area(first_lamp(left), world, n) * weight;
        left &= left - 1u;
        continuing {
            break if left == 0u;
        }
    }
    return sum;
}

// Index of the lowest set bit; 0 if no bit is set.
fn first_lamp(mask: u32) -> u32 {
    return select(0u, firstTrailingBit(mask), mask != 0u);
}

// The lamp mask of the tile that contains a pixel of the picture.
fn lamps_at(tiles: texture_2d<u32>, pixel: vec2i) -> u32 {
    if !LAMPED {
        return 0u;
    }
    return textureLoad(tiles, vec2u(pixel) >> vec2u(frame.tiling.w), 0).x;
}

// Bound on half the diagonal of an area; 0 for other lamps.
fn lamp_radius(k: u32) -> f32 {
    return length(lamps.each[k].half_right.xyz) + length(lamps.each[k].half_up.xyz);
}

// Whether lamp `k` may light anything in a box: by distance and by a spot's cone.
fn lamp_reaches(k: u32, low: vec3f, high: vec3f) -> bool {
    let centre = 0.5 * (low + high);
    let radius = 0.5 * distance(low, high);
    let eye = lamps.each[k].position.xyz;
    let beside = eye - clamp(eye, low, high);
    let nearest = beside * max(0.0, 1.0 - lamp_radius(k) / max(length(beside), 1e-6));
    let i = lamps.each[k].intensity.rgb;
    let bright = max(i.x, max(i.y, i.z)) > LAMP_FAINT * dot(nearest, nearest);
    let off = centre - eye;
    let away = length(off);
    let angle = acos(clamp(dot(off, lamps.each[k].direction.xyz) / max(away, 1e-6), -1.0, 1.0));
    let wide = asin(min(radius / max(away, 1e-6), 1.0));
    return bright && (away <= radius || angle - wide < lamps.each[k].direction.w);
}
