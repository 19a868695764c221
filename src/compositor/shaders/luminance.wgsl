// S_i = Σ weight · radiance over the pixels of face i. Faces are divided into chunks: one workgroup
// sums a chunk, another a face's chunks, always in the same order. The CPU twin is
// `environment::geodesic::sum_faces`.

const INVOCATIONS: u32 = 64u;

// First pixel and number of pixels of each chunk.
@group(0) @binding(0) var<storage, read> chunks: array<vec2u>;
// First chunk and number of chunks of each face.
@group(0) @binding(1) var<storage, read> faces: array<vec2u>;
@group(0) @binding(2) var<storage, read> pixels: array<u32>;
@group(0) @binding(3) var<storage, read> weights: array<f32>;
// RGB, three numbers per pixel.
@group(0) @binding(4) var<storage, read> radiance: array<f32>;
@group(0) @binding(5) var<storage, read_write> partial: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> sums: array<vec4f>;

var<workgroup> shared_sums: array<vec3f, INVOCATIONS>;

fn weighted(at: u32) -> vec3f {
    let k = 3u * pixels[at];
    return weights[at] * vec3f(radiance[k], radiance[k + 1u], radiance[k + 2u]);
}

// The sum over all invocations, for the first of them.
fn reduced(value: vec3f, lane: u32) -> vec3f {
    shared_sums[lane] = value;
    workgroupBarrier();
    for (var half = INVOCATIONS / 2u; half > 0u; half /= 2u) {
        if lane < half {
            shared_sums[lane] += shared_sums[lane + half];
        }
        workgroupBarrier();
    }
    return shared_sums[0];
}

@compute @workgroup_size(INVOCATIONS)
fn sum_chunk(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let chunk = chunks[group.x];
    let end = chunk.x + chunk.y;
    var sum = vec3f(0.0);
    for (var at = chunk.x + lane; at < end; at += INVOCATIONS) {
        sum += weighted(at);
    }
    let total = reduced(sum, lane);
    if lane == 0u {
        partial[group.x] = vec4f(total, 0.0);
    }
}

@compute @workgroup_size(INVOCATIONS)
fn sum_face(@builtin(workgroup_id) group: vec3u, @builtin(local_invocation_index) lane: u32) {
    let face = faces[group.x];
    let end = face.x + face.y;
    var sum = vec3f(0.0);
    for (var at = face.x + lane; at < end; at += INVOCATIONS) {
        sum += partial[at].rgb;
    }
    let total = reduced(sum, lane);
    if lane == 0u {
        sums[group.x] = vec4f(total, 0.0);
    }
}
