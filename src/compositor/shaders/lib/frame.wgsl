// Values of the frame that all passes share. Twin of `gpu_data::FrameUniform` and
// `gpu_data::LightUniform`.

// A near light: v(p) = place.xyz - place.w p leads to it from a point p, in units of its distance from
// the point for which its irradiance is stated.
struct NearLight {
    place: vec4f,
    irradiance: vec4f,
}

struct Frame {
    // Columns of world_from_camera's rotation; w of the last is unused.
    right: vec4f,
    down: vec4f,
    forward: vec4f,
    // Camera centre in the world; w = near plane, metres.
    eye: vec4f,
    // Focal lengths and principal point, pixels.
    intrinsics: vec4f,
    // Width, height, and their reciprocals.
    size: vec4f,
    clip_from_world: mat4x4f,
    // Irradiance polynomial of the environment without its compact sources.
    harmonics: array<vec4f, 9>,
    // Number of lights, shadow mode, number of near lights, highest mip of the radiance map.
    counts: vec4u,
    // Shadow strength, ground height (metres), 1 where there is a ground, highest mip of the
    // surroundings.
    params: vec4f,
    // Radiance of the ground where the picture does not show it; w = factor of the exposure, 1 for
    // the camera's own.
    ground: vec4f,
    // Lights per bit of a tile's mask, side of a tile in picture pixels, 0, logarithm of the side:
    // software drivers divide integers lane by lane, so code that runs per pixel or per light shifts
    // instead.
    tiling: vec4u,
    // Region around the virtual objects, world; w of the first = 1 if it has indirect light.
    indirect_low: vec4f,
    indirect_high: vec4f,
    // The part of it about the objects, where the ground's grid is finer: lower and upper corner, as
    // shares of its size.
    indirect_objects: vec4f,
    // Bounds of the grid with the irradiance on virtual surfaces, world; w of the first = 1 if there
    // is one.
    on_virtual_low: vec4f,
    on_virtual_high: vec4f,
    // The same of the grid with that on phantoms.
    on_real_low: vec4f,
    on_real_high: vec4f,
    // Bounds of the shadowing planes of the real layer, world; w of the first = 1 if shadowing
    // planes are the technique.
    planes_low: vec4f,
    planes_high: vec4f,
    // Direction to the brightest light of the real scene, times its dominance; w = 1 where real
    // surfaces respond to lamps as in the paper.
    brightest: vec4f,
    // A rolling shutter: rotation vector of the camera between successive rows of its own picture,
    // in its own axes; w = the row at which the pose holds.
    rotation_per_row: vec4f,
    // The camera's translation between successive rows, likewise, metres.
    translation_per_row: vec4f,
    // Lens distortion of the camera's own picture, to find the row: k1, k2, k3, p1.
    distortion: vec4f,
    // p2, focal length and principal point along y, pixels of that picture, and the squared tangent
    // up to which the distortion polynomial is valid.
    rows: vec4f,
    // Vignetting of the camera's own picture: k1, k2, k3 about a centre; w = 1 / radius².
    vignetting: vec4f,
    // Focal lengths of that picture, and its principal point relative to that centre, pixels.
    vignetting_intrinsics: vec4f,
    // The near lights where nothing blocks them; their number is counts.z.
    near_lights: array<NearLight, MAX_NEAR_LIGHTS>,
}

// A light of the dome, and how its shadow maps lie in its own space; see `in_light_space`.
struct Light {
    // Axes across its direction; w = minus the coordinate of its reference.
    right: vec4f,
    up: vec4f,
    // Direction to the light, to a near one from its reference; w = angular radius, radians.
    direction: vec4f,
    // RGB irradiance on a surface facing it; w = 1 for a compact source, 0 for a cell.
    irradiance: vec4f,
    // Leads to it from a point, as in `NearLight`; w = 0 for a distant light, whose direction it is.
    place: vec4f,
    // Scale and offset from its space to texture coordinates in the virtual casters' map, and in the
    // phantoms' map.
    virtual_fit: vec4f,
    phantom_fit: vec4f,
    // Scale and offset to depth in both maps.
    depths: vec4f,
    // Minus the coordinate of its reference along the direction, texel sizes of both maps (metres),
    // tangent of the angular radius.
    more: vec4f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
// A uniform rather than a storage buffer: every pixel of a wave reads the same light, and software
// drivers load uniforms once for all of them. Every device supports 64 KiB.
@group(0) @binding(1) var<uniform> lights: array<Light, MAX_LIGHTS>;
// Unshadowed irradiance by normal (octahedral): of all lights, and of the compact ones.
@group(0) @binding(2) var irradiance_of_lights: texture_2d<f32>;
@group(0) @binding(3) var irradiance_of_compact: texture_2d<f32>;
@group(0) @binding(4) var table_sampler: sampler;
// Indirect irradiance on the ground, and on surfaces in the air that face the six axes: the change
// by virtual objects, and beside it along x the light from phantoms without and with them.
@group(0) @binding(5) var indirect_ground: texture_2d<f32>;
@group(0) @binding(6) var indirect_volume: texture_3d<f32>;
// The same on virtual surfaces alone, times a weight, and that weight.
@group(0) @binding(14) var on_surfaces: texture_3d<f32>;

// Returns `x`, in a form that no compiler recognises as uniform. Mesa's software driver compiles
// the values of uniforms that alone decide a branch or a loop into the shader, and recompiles it
// whenever their buffer is written, in every frame: 150 ms each. `here` is any number above −1e30
// that varies between fragments.
fn non_uniform(x: u32, here: f32) -> u32 {
    return x + select(0u, 1u, here < -1e30);
}

// Coordinates of a point in a light's space, metres: across its direction, and away from it. A near
// light is moved to infinity with the space around it by a projective map, so that its rays, too, are
// parallel; w divides the first three.
fn in_light_space(i: u32, p: vec3f) -> vec4f {
    let along = dot(lights[i].direction.xyz, p) + lights[i].more.x;
    let across = vec2f(dot(lights[i].right.xyz, p) + lights[i].right.w, dot(lights[i].up.xyz, p) + lights[i].up.w);
    return vec4f(across, -along, 1.0 - lights[i].place.w * along);
}

// Texture coordinates and depth in a shadow map.
fn in_shadow_map(at: vec4f, fit: vec4f, depth: vec2f) -> vec3f {
    let q = at.xyz / max(at.w, 0.02);
    return vec3f(q.xy * fit.xy + fit.zw, q.z * depth.x + depth.y);
}

// Vector from a point to light `i`, in units of its distance from its reference.
fn towards_light(i: u32, p: vec3f) -> vec3f {
    return lights[i].place.xyz - lights[i].place.w * p;
}

// What the irradiance of a light is multiplied by on a surface, given the vector to the light:
// inverse square law and cosine. Twin of `DomeLight::facing`.
fn facing_light(v: vec3f, n: vec3f) -> f32 {
    let square = max(dot(v, v), 0.0025);
    return max(dot(n, v), 0.0) * inverseSqrt(square) / square;
}

// Unshadowed irradiance of near lights, which are in no table.
fn near_irradiance(world: vec3f, n: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    let count = non_uniform(frame.counts.z, world.x);
    for (var k = 0u; k < count; k++) {
        let place = frame.near_lights[k].place;
        sum += frame.near_lights[k].irradiance.rgb * facing_light(place.xyz - place.w * world, n);
    }
    return sum;
}

fn ray_through(pixel: vec2f) -> vec3f {
    let p = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    return frame.right.xyz * p.x + frame.down.xyz * p.y + frame.forward.xyz;
}

// Distorts the direction (p, 1) by the camera's own lens, on the plane z = 1; continues linearly
// beyond the polynomial's valid range.
fn distorted(p: vec2f) -> vec2f {
    let k = frame.distortion;
    let past = sqrt(max(dot(p, p) / frame.rows.w, 1.0));
    let q = p / past;
    let r2 = dot(q, q);
    let radial = 1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z));
    let tangential = vec2f(k.w, frame.rows.x);
    let aside = 2.0 * tangential * q.x * q.y + tangential.yx * (vec2f(r2) + 2.0 * q * q);
    return (q * radial + aside) * past;
}

// Row of the camera's own, distorted picture that shows the direction (p, 1).
fn row_of(p: vec2f) -> f32 {
    return distorted(p).y * frame.rows.y + frame.rows.z;
}

// Vignetting: fraction of the light in a pixel's direction that the camera shows there.
fn brightness_at(pixel: vec2f) -> f32 {
    if !VIGNETTING {
        return 1.0;
    }
    let p = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    let away = distorted(p) * frame.vignetting_intrinsics.xy + frame.vignetting_intrinsics.zw;
    let q = dot(away, away) * frame.vignetting.w;
    return clamp(1.0 + q * (frame.vignetting.x + q * (frame.vignetting.y + q * frame.vignetting.z)), 0.02, 2.0);
}

// Displacement of a point in camera coordinates until `row` is read.
fn rolling_displacement(p: vec3f, row: f32) -> vec3f {
    return (row - frame.rotation_per_row.w) * (frame.translation_per_row.xyz + cross(frame.rotation_per_row.xyz, p));
}

// Reversed depth with the far plane at infinity: depth = near / z.
fn world_at(pixel: vec2f, depth: f32) -> vec3f {
    if !ROLLING {
        return frame.eye.xyz + ray_through(pixel) * (frame.eye.w / depth);
    }
    let shown = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    let q = vec3f(shown, 1.0) * (frame.eye.w / depth);
    let p = q + rolling_displacement(q, row_of(shown));
    return frame.eye.xyz + frame.right.xyz * p.x + frame.down.xyz * p.y + frame.forward.xyz * p.z;
}

fn pixel_of(world: vec3f) -> vec3f {
    let d = world - frame.eye.xyz;
    let z = dot(d, frame.forward.xyz);
    let p = vec2f(dot(d, frame.right.xyz), dot(d, frame.down.xyz)) / max(z, 1e-6);
    return vec3f(p * frame.intrinsics.xy + frame.intrinsics.zw, z);
}

// Projects a point of the world. Under a rolling shutter the point is seen by the row in which it
// appears: three fixed-point iterations find it.
fn clip_of(world: vec4f) -> vec4f {
    if !ROLLING {
        return frame.clip_from_world * world;
    }
    let d = world.xyz - frame.eye.xyz;
    let p = vec3f(dot(d, frame.right.xyz), dot(d, frame.down.xyz), dot(d, frame.forward.xyz));
    let last = 2.0 * frame.rotation_per_row.w;
    var q = p;
    for (var k = 0; k < 3; k++) {
        let row = row_of(q.xy / max(q.z, frame.eye.w));
        q = p - rolling_displacement(p, clamp(row, -last, 2.0 * last));
    }
    let scale = 2.0 * frame.intrinsics.xy * frame.size.zw;
    let shift = 2.0 * (frame.intrinsics.zw + vec2f(0.5)) * frame.size.zw - vec2f(1.0);
    let xy = (scale * q.xy + shift * q.z) * vec2f(1.0, -1.0);
    return vec4f(xy, frame.eye.w, q.z);
}

fn sky_irradiance(n: vec3f) -> vec3f {
    let h = frame.harmonics;
    let e = h[0] + h[1] * n.y + h[2] * n.z + h[3] * n.x + h[4] * n.x * n.y + h[5] * n.y * n.z
        + h[6] * (3.0 * n.z * n.z - 1.0) + h[7] * n.x * n.z + h[8] * (n.x * n.x - n.y * n.y);
    return max(e.rgb, vec3f(0.0));
}

// Share of the ground's grid on either side of the part about the objects.
const GROUND_AROUND = 1.0 / 6.0;
// Size of the first texel beside that part, of the mean of those on its side. Twin of `ground_map::NEAREST`.
const GROUND_NEAREST = 0.5;

// Twin of `ground_map::texels_to`.
fn texels_to(way: vec2f) -> vec2f {
    let root = sqrt(GROUND_NEAREST * GROUND_NEAREST + 4.0 * (1.0 - GROUND_NEAREST) * way);
    return (root - GROUND_NEAREST) / (2.0 * (1.0 - GROUND_NEAREST));
}

// The place in the ground's grid at a share of the region's size. Twin of `GroundMap`.
fn ground_uv(at: vec2f) -> vec2f {
    let low = frame.indirect_objects.xy;
    let high = frame.indirect_objects.zw;
    let before = texels_to(max(low - at, vec2f(0.0)) / low);
    let behind = texels_to(max(at - high, vec2f(0.0)) / (1.0 - high));
    let around = 1.0 - before + behind;
    let inside = clamp((at - low) / (high - low), vec2f(0.0), vec2f(1.0));
    return GROUND_AROUND * around + (1.0 - 2.0 * GROUND_AROUND) * inside;
}
