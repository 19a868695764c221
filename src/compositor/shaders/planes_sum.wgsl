// The sums of basis images (Kakuta 2007, eqs. 3 and 4), per colour channel:
//
//   Isum = Σ S_i · Ib_i        Ib_i = c_i · V_i,   c_i = max(n · l_i, 0)
//   Asum = Σ S_i · a_i         a_i = c_i
//
// with n of the surface that the texel shows. V is the product of what virtual objects and
// what phantoms let through. On the real layer Isum is made with phantoms alone as well:
// their shadows are in the camera's picture already. Written are the shares Isum / Asum.
// An invocation has four texels of a row: their visibilities share a word.

@group(0) @binding(0) var<storage, read> planes: array<SumPlane>;
@group(0) @binding(1) var<storage, read> jobs: array<vec4u>;
// All stored images side by side, four texels of a row in one.
@group(0) @binding(2) var images: texture_2d<f32>;
@group(0) @binding(3) var<storage, read> receivers: array<vec2u>;
// Per four texels: red, green and blue of Asum, of Isum, and on the real layer of Isum with
// phantoms alone.
@group(0) @binding(4) var<storage, read_write> sums: array<vec4f>;
@group(0) @binding(5) var share_all: texture_storage_2d_array<rgba16float, write>;
@group(0) @binding(6) var share_real: texture_storage_2d_array<rgba16float, write>;
// Of one plane. Uniform, and images a texture: software drivers take storage buffers lane by
// lane, ten times slower.
@group(1) @binding(0) var<uniform> work: array<Entry, LIGHTS>;
@group(1) @binding(1) var<uniform> which: vec4u;

const WHITE = 0xfffffffeu;

// Visibilities of four texels: the `word`th of image `number`.
fn visibility(number: f32, at: vec2u) -> vec4f {
    let image = bitcast<u32>(number);
    // Images that are not stored have no place: the first image is read and not used.
    let stored = image < WHITE;
    let place = select(0u, image, stored);
    let corner = vec2u((place % ACROSS) * (SIDE / 4u), (place / ACROSS) * SIDE);
    let read = textureLoad(images, corner + at, 0);
    return select(vec4f(select(0.0, 1.0, image == WHITE)), read, stored);
}

struct Normals {
    x: vec4f,
    y: vec4f,
    z: vec4f,
}

fn normals_of(k: u32, texel: u32) -> Normals {
    let flat = planes[k].kind.x == 1u;
    let own = planes[k].normal.xyz;
    let at = k * SIDE * SIDE + texel;
    let a = select(normal_from_octahedron(unpack2x16snorm(receivers[at].x)), own, flat);
    let b = select(normal_from_octahedron(unpack2x16snorm(receivers[at + 1u].x)), own, flat);
    let c = select(normal_from_octahedron(unpack2x16snorm(receivers[at + 2u].x)), own, flat);
    let d = select(normal_from_octahedron(unpack2x16snorm(receivers[at + 3u].x)), own, flat);
    return Normals(
        vec4f(a.x, b.x, c.x, d.x),
        vec4f(a.y, b.y, c.y, d.y),
        vec4f(a.z, b.z, c.z, d.z),
    );
}

// 1 where no light arrives that could be kept away.
fn share(part: vec4f, whole: vec4f) -> vec4f {
    let ratio = clamp(part / max(whole, vec4f(1e-12)), vec4f(0.0), vec4f(1.0));
    return select(vec4f(1.0), ratio, whole > vec4f(1e-9));
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

// What was summed before stays where differences are added.
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

fn shares(part: Colours, whole: Colours) -> Colours {
    return Colours(share(part.r, whole.r), share(part.g, whole.g), share(part.b, whole.b));
}

fn depth_at(texel: u32) -> f32 {
    return f32(receivers[texel].y) / 65534.0;
}

// Loops over colours and texels are written out: software drivers keep what is indexed by a
// variable in memory.
fn sum_plane(k: u32, word: u32) {
    let words = SIDE * SIDE / 4u;
    let job = jobs[k];
    if word >= words || (job.x | job.y) == 0u {
        return;
    }
    let texel = 4u * word;
    let n = normals_of(k, texel);
    let none = Colours(vec4f(0.0), vec4f(0.0), vec4f(0.0));
    var whole = none;
    var all = none;
    var past = none;
    let at_word = vec2u(word % (SIDE / 4u), word / (SIDE / 4u));
    for (var j = 0u; j < job.x; j++) {
        let s = work[j].change;
        let l = work[j].light;
        let cosine = max(n.x * l.x + n.y * l.y + n.z * l.z, vec4f(0.0));
        var arrives = cosine;
        if PHANTOMS {
            arrives *= visibility(l.w, at_word);
        }
        whole = added(whole, cosine, s.rgb);
        all = added(all, arrives * visibility(s.w, at_word), s.rgb);
        if REAL {
            past = added(past, arrives, s.rgb);
        }
    }
    let keep = select(1.0, 0.0, job.y == 1u);
    let at = planes[k].kind.y + word * select(6u, 9u, REAL);
    whole = kept(whole, at, keep);
    all = shares(kept(all, at + 3u, keep), whole);
    let row = vec2u(texel % SIDE, texel / SIDE);
    let first = k * SIDE * SIDE + texel;
    textureStore(share_all, row, k, vec4f(all.r.x, all.g.x, all.b.x, depth_at(first)));
    textureStore(share_all, row + vec2u(1u, 0u), k, vec4f(all.r.y, all.g.y, all.b.y, depth_at(first + 1u)));
    textureStore(share_all, row + vec2u(2u, 0u), k, vec4f(all.r.z, all.g.z, all.b.z, depth_at(first + 2u)));
    textureStore(share_all, row + vec2u(3u, 0u), k, vec4f(all.r.w, all.g.w, all.b.w, depth_at(first + 3u)));
    if REAL {
        past = shares(kept(past, at + 6u, keep), whole);
        textureStore(share_real, row, k, vec4f(past.r.x, past.g.x, past.b.x, 1.0));
        textureStore(share_real, row + vec2u(1u, 0u), k, vec4f(past.r.y, past.g.y, past.b.y, 1.0));
        textureStore(share_real, row + vec2u(2u, 0u), k, vec4f(past.r.z, past.g.z, past.b.z, 1.0));
        textureStore(share_real, row + vec2u(3u, 0u), k, vec4f(past.r.w, past.g.w, past.b.w, 1.0));
    }
}

@compute @workgroup_size(64)
fn sum(@builtin(global_invocation_id) id: vec3u) {
    sum_plane(which.x, id.x);
}
