// Images of a compact source, baked while frames are drawn: `store` converts the sums of
// `bake_evaluate` to 8-bit images in the texture that holds the bake's; `number` and `reset` keep
// the planner's tables up to date.

struct Images {
    // First plane of this dispatch; number of planes; number of planes of the real layer, which
    // come first; number of lights.
    planes: vec4u,
    // Number of the source's light; number of its first image in the texture; images in a row; 0.
    source: vec4u,
}

@group(0) @binding(0) var<uniform> images: Images;
// Per texel: Σ w cos (1 − V) past all casters, past phantoms alone, and Σ w cos.
@group(0) @binding(1) var<storage, read> sums: array<vec4f>;
@group(0) @binding(2) var<storage, read_write> flags: array<atomic<u32>>;
// As in `planes_plan`.
@group(0) @binding(3) var<storage, read_write> basis: array<vec2u>;
@group(0) @binding(4) var<storage, read_write> applied: array<vec4f>;
@group(0) @binding(5) var stored: texture_storage_2d<rgba8unorm, write>;

fn lost_at(k: u32, texel: u32) -> vec2f {
    let s = sums[k * RESOLUTION * RESOLUTION + texel];
    if s.z <= 0.0 {
        return vec2f(0.0);
    }
    atomicOr(&flags[k], flags_of(s));
    return clamp(s.xy, vec2f(0.0), vec2f(1.0));
}

// `kind`: 0 past all casters, 1 past phantoms alone.
fn number_of(k: u32, kind: u32) -> u32 {
    return images.source.y + 2u * k + kind;
}

fn texel_of(number: u32, word: u32) -> vec2u {
    let across = RESOLUTION / 4u;
    let corner = vec2u(number % images.source.z * across, number / images.source.z * RESOLUTION);
    return corner + vec2u(word % across, word / across);
}

@compute @workgroup_size(64)
fn store(@builtin(global_invocation_id) id: vec3u) {
    let word = id.x;
    let k = id.y + images.planes.x;
    if word >= RESOLUTION * RESOLUTION / 4u || k >= images.planes.y {
        return;
    }
    let a = lost_at(k, 4u * word);
    let b = lost_at(k, 4u * word + 1u);
    let c = lost_at(k, 4u * word + 2u);
    let d = lost_at(k, 4u * word + 3u);
    textureStore(stored, texel_of(number_of(k, 0u), word), vec4f(a.x, b.x, c.x, d.x));
    textureStore(stored, texel_of(number_of(k, 1u), word), vec4f(a.y, b.y, c.y, d.y));
}

// As in `Work::images` of the baker.
fn image_of(flag: u32, arrives: u32, hides: u32, number: u32) -> u32 {
    let there = select(WHITE, number, (flag & hides) != 0u);
    return select(BLACK, there, (flag & arrives) != 0u);
}

@compute @workgroup_size(64)
fn number(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if k >= images.planes.y {
        return;
    }
    let flag = atomicLoad(&flags[k]);
    let faced = (flag & FACED) != 0u;
    let all = image_of(flag, ALL_PASS, ALL_HIDE, number_of(k, 0u));
    // Two black images mean that nothing faces the light, and not that all light is lost.
    let kept = flag | select(0u, PHANTOMS_PASS, faced && all == BLACK);
    let past = image_of(kept, PHANTOMS_PASS, PHANTOMS_HIDE, number_of(k, 1u));
    let phantoms = select(past, WHITE, faced && k >= images.planes.z);
    basis[k * images.planes.w + images.source.x] = vec2u(all, phantoms);
}

// Makes the planner recompute sums that contain images which are about to be overwritten.
@compute @workgroup_size(64)
fn reset(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if k >= images.planes.y {
        return;
    }
    let first = k * images.planes.w;
    let own = first + images.source.x;
    if any(applied[own].rgb != vec3f(0.0)) {
        applied[own] = vec4f(0.0);
        applied[first].w = 0.0;
    }
    atomicStore(&flags[k], 0u);
}
