// The sums of basis images (Kakuta 2007, eqs. 3 and 4), per colour channel:
//
//   Isum = Σ S_i · Ib_i        Ib_i = c_i · V_i,   c_i = max(n · l_i, 0)
//   Asum = Σ S_i · a_i         a_i = c_i
//
// with n of the surface that the texel shows. V is the product of what virtual objects and
// what phantoms let through. On the real layer Isum is made with phantoms alone as well:
// their shadows are in the camera's picture already. Written are the shares Isum / Asum.
// An invocation has four texels of a row: their visibilities share a word.

@group(0) @binding(0) var<storage, read> settings: Settings;
@group(0) @binding(1) var<storage, read> faces: array<vec4f>;
@group(0) @binding(2) var<storage, read> planes: array<SumPlane>;
@group(0) @binding(3) var<storage, read> jobs: array<vec4u>;
@group(0) @binding(4) var<storage, read> work: array<vec4f>;
// Per plane and light: numbers of the images by the model and by phantoms.
@group(0) @binding(5) var<storage, read> basis: array<vec2u>;
@group(0) @binding(6) var<storage, read> images: array<u32>;
@group(0) @binding(7) var<storage, read> receivers: array<vec2u>;
// Per four texels: red, green and blue of Asum, of Isum, and on the real layer of Isum with
// phantoms alone.
@group(0) @binding(8) var<storage, read_write> sums: array<vec4f>;
@group(0) @binding(9) var share_all: texture_storage_2d_array<rgba16float, write>;
@group(0) @binding(10) var share_real: texture_storage_2d_array<rgba16float, write>;

const BLACK = 0xffffffffu;
const WHITE = 0xfffffffeu;

fn visibility(image: u32, word: u32, words: u32) -> vec4f {
    // Images that are not stored have no words: the first image's are read and not used.
    let stored = image < WHITE;
    let read = unpack4x8unorm(images[select(0u, image, stored) * words + word]);
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
    let at = k * settings.side * settings.side + texel;
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

@compute @workgroup_size(64)
fn sum(@builtin(global_invocation_id) id: vec3u) {
    let words = settings.side * settings.side / 4u;
    let k = id.y;
    let job = jobs[k];
    if id.x >= words || (job.x | job.y) == 0u {
        return;
    }
    let texel = 4u * id.x;
    let real = k < settings.real;
    let n = normals_of(k, texel);
    var a = array<vec4f, 3>();
    var all = array<vec4f, 3>();
    var past = array<vec4f, 3>();
    let begin = k * settings.lights;
    for (var j = 0u; j < job.x; j++) {
        let entry = work[begin + j];
        let i = bitcast<u32>(entry.w);
        let l = faces[i].xyz;
        let cosine = max(n.x * l.x + n.y * l.y + n.z * l.z, vec4f(0.0));
        let image = basis[begin + i];
        let arrives = cosine * visibility(image.y, id.x, words);
        let open = arrives * visibility(image.x, id.x, words);
        a[0] += cosine * entry.r;
        a[1] += cosine * entry.g;
        a[2] += cosine * entry.b;
        all[0] += open * entry.r;
        all[1] += open * entry.g;
        all[2] += open * entry.b;
        past[0] += arrives * entry.r;
        past[1] += arrives * entry.g;
        past[2] += arrives * entry.b;
    }
    let keep = select(1.0, 0.0, job.y == 1u);
    let at = planes[k].kind.y + id.x * select(6u, 9u, real);
    for (var c = 0u; c < 3u; c++) {
        a[c] += sums[at + c] * keep;
        sums[at + c] = a[c];
        all[c] += sums[at + 3u + c] * keep;
        sums[at + 3u + c] = all[c];
    }
    let row = vec2u(texel % settings.side, texel / settings.side);
    let r = share(all[0], a[0]);
    let g = share(all[1], a[1]);
    let b = share(all[2], a[2]);
    for (var t = 0u; t < 4u; t++) {
        let depth = f32(receivers[k * settings.side * settings.side + texel + t].y) / 65534.0;
        textureStore(share_all, row + vec2u(t, 0u), k, vec4f(r[t], g[t], b[t], depth));
    }
    if !real {
        return;
    }
    for (var c = 0u; c < 3u; c++) {
        past[c] += sums[at + 6u + c] * keep;
        sums[at + 6u + c] = past[c];
    }
    let pr = share(past[0], a[0]);
    let pg = share(past[1], a[1]);
    let pb = share(past[2], a[2]);
    for (var t = 0u; t < 4u; t++) {
        textureStore(share_real, row + vec2u(t, 0u), k, vec4f(pr[t], pg[t], pb[t], 1.0));
    }
}
