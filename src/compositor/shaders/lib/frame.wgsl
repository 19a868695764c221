// What every pass knows of this frame. Twin of `gpu_data::FrameUniform` and
// `gpu_data::LightUniform`.

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
    // Number of lights, shadow mode, step of the shadow buffer in pixels, highest mip of the radiance map.
    counts: vec4u,
    // Shadow strength, ground height (metres), 1 where there is a ground, highest mip of the surroundings.
    params: vec4f,
    // Radiance of the ground where the picture does not show it; w = factor of the exposure, 1 as
    // the camera took it.
    ground: vec4f,
    // Lights per bit of a tile's mask, side of a tile in picture pixels, logarithms of the
    // shadow buffer's step and of the tile's side: software drivers divide whole numbers lane by lane, so nothing
    // that runs per pixel or per light does.
    tiling: vec4u,
    // Region around the virtual objects, world; w of the first = 1 where it is lit.
    indirect_low: vec4f,
    indirect_high: vec4f,
    // What shadowing planes of the real layer cover, world; w of the first = 1 where planes
    // are the technique.
    planes_low: vec4f,
    planes_high: vec4f,
    // To the brightest light of the real scene, times its dominance; w = 1 where real surfaces
    // answer lamps as in the paper.
    brightest: vec4f,
    // A rolling shutter: rotation vector of the camera from one of its own rows to the next, in its
    // own axes; w = the row that the pose is of.
    turning: vec4f,
    // Its way from one row to the next, likewise, metres.
    moving: vec4f,
    // Which row that is behind a lens that bends: k1, k2, k3, p1 of the camera's own picture.
    bending: vec4f,
    // p2, focal length and principal point down, pixels of that picture, and the squared tangent
    // up to which the lens' polynomial holds.
    rows: vec4f,
    // How the camera's own picture fades towards its edge: k1, k2, k3 about a middle; w = 1 / radius².
    vignetting: vec4f,
    // Focal lengths of that picture, and its principal point seen from that middle, pixels.
    vignetting_from: vec4f,
}

struct Light {
    // Texture coordinates and depth in the virtual casters' shadow map: rows of an affine map.
    virtual_u: vec4f,
    virtual_v: vec4f,
    virtual_d: vec4f,
    // The same for the phantoms' map.
    phantom_u: vec4f,
    phantom_v: vec4f,
    phantom_d: vec4f,
    // To the light; w = angular radius, radians.
    direction: vec4f,
    // RGB irradiance facing it; w = 1 for a compact source, 0 for a cell.
    irradiance: vec4f,
    // Texel sizes of both maps, then metres per unit of depth of both.
    scale: vec4f,
}

@group(0) @binding(0) var<uniform> frame: Frame;
// A uniform rather than a storage buffer: every pixel of a wave reads the same light, and
// software drivers load uniforms once for all of them. 64 KiB is what every device has.
@group(0) @binding(1) var<uniform> lights: array<Light, MAX_LIGHTS>;
// Irradiance by normal (octahedral) of all lights and of the compact ones, unshadowed.
@group(0) @binding(2) var irradiance_of_lights: texture_2d<f32>;
@group(0) @binding(3) var irradiance_of_compact: texture_2d<f32>;
@group(0) @binding(4) var table_sampler: sampler;
// Irradiance from close by on the ground, and on surfaces in the air that face the six
// axes: what virtual objects change, and beside it along x what phantoms throw, before it and after.
@group(0) @binding(5) var indirect_ground: texture_2d<f32>;
@group(0) @binding(6) var indirect_volume: texture_3d<f32>;

// `x`, in a way that no compiler takes for a uniform. Mesa's software driver writes the
// values of uniforms that alone decide a branch or a loop into the shader, and compiles it
// again whenever the buffer they stand in is written, in every frame: 150 ms each. `here`
// is any number of this fragment's own, above −1e30.
fn decided_here(x: u32, here: f32) -> u32 {
    return x + select(0u, 1u, here < -1e30);
}

fn ray_through(pixel: vec2f) -> vec3f {
    let p = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    return frame.right.xyz * p.x + frame.down.xyz * p.y + frame.forward.xyz;
}

// Where the camera's own lens puts the direction (p, 1), on the plane z = 1; straight on past
// what its polynomial holds for.
fn lens_bent(p: vec2f) -> vec2f {
    let k = frame.bending;
    let past = sqrt(max(dot(p, p) / frame.rows.w, 1.0));
    let q = p / past;
    let r2 = dot(q, q);
    let radial = 1.0 + r2 * (k.x + r2 * (k.y + r2 * k.z));
    let tangential = vec2f(k.w, frame.rows.x);
    let aside = 2.0 * tangential * q.x * q.y + tangential.yx * (vec2f(r2) + 2.0 * q * q);
    return (q * radial + aside) * past;
}

// Row of the camera's own picture, bent by its lens, that shows the direction (p, 1).
fn row_of(p: vec2f) -> f32 {
    return lens_bent(p).y * frame.rows.y + frame.rows.z;
}

// Share of the light in a pixel's direction that the camera shows there: less towards the edge.
fn brightness_at(pixel: vec2f) -> f32 {
    if !VIGNETTING {
        return 1.0;
    }
    let p = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    let away = lens_bent(p) * frame.vignetting_from.xy + frame.vignetting_from.zw;
    let q = dot(away, away) * frame.vignetting.w;
    return clamp(1.0 + q * (frame.vignetting.x + q * (frame.vignetting.y + q * frame.vignetting.z)), 0.02, 2.0);
}

// How far a point of the camera's frame goes before `row` is read.
fn rolled(p: vec3f, row: f32) -> vec3f {
    return (row - frame.turning.w) * (frame.moving.xyz + cross(frame.turning.xyz, p));
}

// Reversed depth with the far plane at infinity: depth = near / z.
fn world_at(pixel: vec2f, depth: f32) -> vec3f {
    if !ROLLING {
        return frame.eye.xyz + ray_through(pixel) * (frame.eye.w / depth);
    }
    let shown = (pixel - frame.intrinsics.zw) / frame.intrinsics.xy;
    let q = vec3f(shown, 1.0) * (frame.eye.w / depth);
    let p = q + rolled(q, row_of(shown));
    return frame.eye.xyz + frame.right.xyz * p.x + frame.down.xyz * p.y + frame.forward.xyz * p.z;
}

fn pixel_of(world: vec3f) -> vec3f {
    let d = world - frame.eye.xyz;
    let z = dot(d, frame.forward.xyz);
    let p = vec2f(dot(d, frame.right.xyz), dot(d, frame.down.xyz)) / max(z, 1e-6);
    return vec3f(p * frame.intrinsics.xy + frame.intrinsics.zw, z);
}

// Where a point of the world is drawn. Under a rolling shutter it is seen by the row that its
// own picture lies in: a fixed point, found in three rounds.
fn clip_of(world: vec4f) -> vec4f {
    if !ROLLING {
        return frame.clip_from_world * world;
    }
    let d = world.xyz - frame.eye.xyz;
    let p = vec3f(dot(d, frame.right.xyz), dot(d, frame.down.xyz), dot(d, frame.forward.xyz));
    let last = 2.0 * frame.turning.w;
    var q = p;
    for (var k = 0; k < 3; k++) {
        let row = row_of(q.xy / max(q.z, frame.eye.w));
        q = p - rolled(p, clamp(row, -last, 2.0 * last));
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
