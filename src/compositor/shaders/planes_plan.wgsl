// Plans which basis images each plane sums in this frame (Kakuta 2004, section 4): lights of
// negligible share are skipped, planes whose light has hardly changed keep their sums, and for the
// others only the difference is summed. One invocation per plane.

@group(0) @binding(0) var<storage, read> settings: Settings;
@group(0) @binding(1) var<storage, read> faces: array<vec4f>;
@group(0) @binding(2) var<storage, read> luminance: array<vec4f>;
@group(0) @binding(3) var<storage, read> planes: array<SumPlane>;
@group(0) @binding(4) var<storage, read> visible: array<u32>;
// The luminance from which each plane's sums were made; w = 1 once they were made.
@group(0) @binding(5) var<storage, read_write> applied: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> work: array<Entry>;
@group(0) @binding(7) var<storage, read_write> jobs: array<Job>;
// Per plane and light: numbers of the images past all casters and past phantoms, as bits.
@group(0) @binding(8) var<storage, read> basis: array<vec2f>;
// Asum by normal, octahedral: see `asum_by_normal`.
@group(0) @binding(9) var asum: texture_storage_2d_array<rgba16float, write>;

fn facing(k: u32, i: u32) -> f32 {
    return max(dot(planes[k].normal.xyz, faces[i].xyz), 0.0);
}

// Weight of a light on a plane. Surfaces behind a plane may have any orientation; where both images
// are black none faces the light.
fn reach(k: u32, i: u32) -> f32 {
    let image = bitcast<vec2u>(basis[k * settings.lights + i]);
    let some = select(1.0, 0.0, all(image == vec2u(BLACK)));
    return select(some, facing(k, i), planes[k].kind.x == 1u);
}

fn brightness(s: vec3f) -> f32 {
    return s.x + s.y + s.z;
}

// Whether plane `k` has no sums yet.
fn is_new(k: u32) -> bool {
    return applied[k * settings.lights].w == 0.0;
}

@compute @workgroup_size(64)
fn plan(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if k >= settings.planes {
        return;
    }
    var job = Job(vec3u(0u, 1u, 1u), 0u, 0u, 0u, 0u, 0u, vec4f(0.0));
    if visible[k] == 0u {
        jobs[k] = job;
        return;
    }
    let begin = k * settings.lights;
    var total = 0.0;
    for (var i = 0u; i < settings.lights; i++) {
        total += brightness(luminance[i].rgb) * reach(k, i);
        job.asum += luminance[i] * facing(k, i);
    }
    // Error of the sums, number of images that would correct it, and number of all images.
    var error = 0.0;
    var differ = 0u;
    var count = 0u;
    for (var i = 0u; i < settings.lights; i++) {
        let gives = brightness(luminance[i].rgb) * reach(k, i);
        let counts = gives > 0.0 && gives >= settings.skip_below * total;
        count += select(0u, 1u, counts);
        job.skipped += select(0u, 1u, gives > 0.0 && !counts);
        let target_light = select(vec3f(0.0), luminance[i].rgb, counts);
        let change = brightness(abs(target_light - applied[begin + i].rgb)) * reach(k, i);
        error += change;
        differ += select(0u, 1u, change > settings.min_change * total);
    }
    let untouched = error <= settings.recompute_above * total && !is_new(k);
    job.recompute = select(0u, 1u, 2u * differ > count || is_new(k));
    for (var i = 0u; i < settings.lights; i++) {
        let gives = brightness(luminance[i].rgb) * reach(k, i);
        let counts = gives > 0.0 && gives >= settings.skip_below * total;
        let target_light = select(vec3f(0.0), luminance[i].rgb, counts);
        let before = select(applied[begin + i].rgb, vec3f(0.0), job.recompute == 1u);
        let change = target_light - before;
        let matters = brightness(abs(change)) * reach(k, i) > settings.min_change * total;
        let listed = select(matters, any(change != vec3f(0.0)), job.recompute == 1u);
        let image = basis[begin + i];
        let states = bitcast<vec2u>(image);
        // Images that lose no light need not be summed.
        if !untouched && listed && any(states != vec2u(WHITE)) {
            let entry = Entry(vec4f(change, image.x), vec4f(faces[i].xyz, image.y));
            // Planes of the real layer process both kinds together.
            let is_black = states.x == BLACK && k >= settings.real;
            let last = k * settings.stride + settings.lights - 1u;
            work[select(k * settings.stride + job.stored, last - job.black, is_black)] = entry;
            job.stored += select(1u, 0u, is_black);
            job.black += select(0u, 1u, is_black);
        }
        if !untouched && (listed || job.recompute == 1u) {
            applied[begin + i] = vec4f(target_light, 1.0);
        }
    }
    job.recompute = select(job.recompute, 0u, untouched);
    let words = settings.side * settings.side / 4u;
    job.groups.x = select((words + 63u) / 64u, 0u, untouched);
    jobs[k] = job;
}

// Asum of a surface by its normal: Σ S_i max(n · l_i, 0). Surfaces behind planes look it up.
@compute @workgroup_size(64)
fn asum_by_normal(@builtin(global_invocation_id) id: vec3u) {
    if id.x >= BY_NORMAL * BY_NORMAL {
        return;
    }
    let at = vec2u(id.x % BY_NORMAL, id.x / BY_NORMAL);
    let n = normal_from_octahedron(vec2f(at) * (2.0 / f32(BY_NORMAL - 1u)) - 1.0);
    var sum = vec3f(0.0);
    for (var i = 0u; i < settings.lights; i++) {
        sum += luminance[i].rgb * max(dot(n, faces[i].xyz), 0.0);
    }
    textureStore(asum, at, 0u, vec4f(min(sum, vec3f(65000.0)), 1.0));
}
