// The sums of basis images (Kakuta 2007, eqs. 3 and 4), per colour channel, over the lost light:
//
//   Isum / Asum = Σ S_i Ib_i / Σ S_i a_i = 1 − Σ S_i (a_i − Ib_i) / Σ S_i a_i
//
//   a_i = max(n · l_i, 0),   Ib_i = a_i V_i,   a_i − Ib_i = a_i (1 − V_i): the stored images
//
// with n of the surface that the texel shows. On the real layer Isum is also computed with phantoms
// alone: their shadows are in the camera's picture already. An invocation processes four texels of
// a row, which share a texel of the texture.

@group(0) @binding(0) var<storage, read> planes: array<SumPlane>;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
// All stored images side by side; a texel holds four texels of a row.
@group(0) @binding(2) var images: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> receivers: array<vec2u>;
// Per four texels: red, green and blue of the light lost past all casters, and on the real layer
// past phantoms alone.
@group(0) @binding(4) var<storage, read_write> sums: array<vec4f>;
@group(0) @binding(5) var share_all: texture_storage_2d_array<rgba16float, write>;
@group(0) @binding(6) var share_real: texture_storage_2d_array<rgba16float, write>;
@group(0) @binding(7) var asum_by_normal: texture_2d_array<f32>;
@group(0) @binding(8) var smooth_sampler: sampler;
// The entries of one plane. They are a uniform and the images a texture: software drivers read
// storage buffers lane by lane, many times slower.
@group(1) @binding(0) var<uniform> work: array<Entry, LIGHTS>;
@group(1) @binding(1) var<uniform> which: vec4u;

// Four texels of stored image `number`.
fn stored(number: f32, at: vec2u) -> vec4f {
    let image = bitcast<u32>(number);
    return textureLoad(images, vec2u((image % ACROSS) * (SIDE / 4u), (image / ACROSS) * SIDE) + at, 0);
}

// The same for any image: `cosine` where all light is lost, zero where none is.
fn lost_of(number: f32, at: vec2u, cosine: vec4f) -> vec4f {
    let image = bitcast<u32>(number);
    let there = image < WHITE;
    // Images that are not stored have no texels: the first image is read and ignored.
    let read = stored(bitcast<f32>(select(0u, image, there)), at);
    return select(select(vec4f(0.0), cosine, image == BLACK), read, there);
}

struct Normals {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

fn normal_at(k: u32, texel: u32) -> vec3f {
    let own = normal_from_octahedron(unpack2x16snorm(receivers[k * SIDE * SIDE + texel].x));
    return select(own, planes[k].normal.xyz, planes[k].kind.x == 1u);
}

fn normals_of(k: u32, texel: u32) -> Normals {
    let a = normal_at(k, texel);
    let b = normal_at(k, texel + 1u);
    let c = normal_at(k, texel + 2u);
    let d = normal_at(k, texel + 3u);
    return Normals(vec4f(a.x, b.x, c.x, d.x), vec4f(a.y, b.y, c.y, d.y), vec4f(a.z, b.z, c.z, d.z));
}

// One vector per colour channel, over four texels.
struct Colours {
    r: vec4f,
    g: vec4f,
    b: vec4f,
}

fn added(sum: Colours, light: vec4f, s: vec3f) -> Colours {
    return Colours(sum.r + light * s.r, sum.g + light * s.g, sum.b + light * s.b);
}

// Adds the previous sums, times `keep`, and stores the result.
fn kept(sum: Colours, at: u32, keep: f32) -> Colours {
    let all = Colours(
        sum.r + sums[at] * keep,
        sum.g + sums[at + 1u] * keep,
        sum.b + sums[at + 2u] * keep,
    );
    sums[at] = all.r;
    sums[at + 1u] = all.g;
    sums[at + 2u] = all.b;
    return all;
}

fn asum_at(k: u32, x: f32, y: f32, z: f32) -> vec3f {
    let side = f32(BY_NORMAL);
    let uv = ((octahedron_from_normal(vec3f(x, y, z)) * 0.5 + 0.5) * (side - 1.0) + 0.5) / side;
    let by_normal = textureSampleLevel(asum_by_normal, smooth_sampler, uv, 0u, 0.0).rgb;
    return select(by_normal, jobs[k].asum.rgb, planes[k].kind.x == 1u);
}

// Fraction of the possible light that arrives; 1 where there is no light to lose.
fn share(lost: vec3f, asum: vec3f) -> vec3f {
    let ratio = clamp(vec3f(1.0) - lost / max(asum, vec3f(1e-12)), vec3f(0.0), vec3f(1.0));
    return select(vec3f(1.0), ratio, asum > vec3f(1e-9));
}

fn depth_at(texel: u32) -> f32 {
    return f32(receivers[texel].y) / 65534.0;
}

// The code for the four texels is written out, because software drivers keep arrays that are
// indexed by a variable in memory.
@compute @workgroup_size(64)
fn sum(@builtin(global_invocation_id) id: vec3u) {
    let word = id.x;
    let k = which.x;
    if word >= SIDE * SIDE / 4u {
        return;
    }
    let texel = 4u * word;
    let n = normals_of(k, texel);
    let none = Colours(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var all = none;
    var past = none;
    let at_word = vec2u(word % (SIDE / 4u), word / (SIDE / 4u));
    let count = jobs[k].stored;
    let black = jobs[k].black;
    for (var j = 0u; j < count; j++) {
        let s = work[j].change;
        if REAL {
            let l = work[j].light;
            let cosine = max(n.x * l.x + n.y * l.y + n.z * l.z, vec4f(0.0));
            all = added(all, lost_of(s.w, at_word, cosine), s.rgb);
            past = added(past, lost_of(l.w, at_word, cosine), s.rgb);
        } else {
            all = added(all, stored(s.w, at_word), s.rgb);
        }
    }
    for (var j = 0u; j < black; j++) {
        let s = work[LIGHTS - 1u - j].change;
        let l = work[LIGHTS - 1u - j].light;
        all = added(all, max(n.x * l.x + n.y * l.y + n.z * l.z, vec4f(0.0)), s.rgb);
    }
    let keep = select(1.0, 0.0, jobs[k].recompute == 1u);
    let at = planes[k].kind.y + word * select(3u, 6u, REAL);
    all = kept(all, at, keep);
    let w0 = asum_at(k, n.x.x, n.y.x, n.z.x);
    let w1 = asum_at(k, n.x.y, n.y.y, n.z.y);
    let w2 = asum_at(k, n.x.z, n.y.z, n.z.z);
    let w3 = asum_at(k, n.x.w, n.y.w, n.z.w);
    let row = vec2u(texel % SIDE, texel / SIDE);
    let first = k * SIDE * SIDE + texel;
    textureStore(share_all, row, k, vec4f(share(vec3f(all.r.x, all.g.x, all.b.x), w0), depth_at(first)));
    textureStore(share_all, row + vec2u(1u, 0u), k, vec4f(share(vec3f(all.r.y, all.g.y, all.b.y), w1), depth_at(first + 1u)));
    textureStore(share_all, row + vec2u(2u, 0u), k, vec4f(share(vec3f(all.r.z, all.g.z, all.b.z), w2), depth_at(first + 2u)));
    textureStore(share_all, row + vec2u(3u, 0u), k, vec4f(share(vec3f(all.r.w, all.g.w, all.b.w), w3), depth_at(first + 3u)));
    if REAL {
        past = kept(past, at + 3u, keep);
        textureStore(share_real, row, k, vec4f(share(vec3f(past.r.x, past.g.x, past.b.x), w0), 1.0));
        textureStore(share_real, row + vec2u(1u, 0u), k, vec4f(share(vec3f(past.r.y, past.g.y, past.b.y), w1), 1.0));
        textureStore(share_real, row + vec2u(2u, 0u), k, vec4f(share(vec3f(past.r.z, past.g.z, past.b.z), w2), 1.0));
        textureStore(share_real, row + vec2u(3u, 0u), k, vec4f(share(vec3f(past.r.w, past.g.w, past.b.w), w3), 1.0));
    }
}
