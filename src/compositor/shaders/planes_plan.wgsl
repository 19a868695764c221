// Which basis images each plane has to sum in this frame (Kakuta 2004, section 4): lights
// that give next to nothing are left out, planes whose light has hardly changed are left
// alone, and of the others only the difference is summed. One invocation per plane.

struct Job {
    // Entries of `work`.
    count: u32,
    // 1: sums begin anew; 0: differences are added.
    anew: u32,
    // Lights that are left out, and lights in sight of the plane.
    skipped: u32,
    lights: u32,
}

@group(0) @binding(0) var<storage, read> settings: Settings;
@group(0) @binding(1) var<storage, read> faces: array<vec4f>;
@group(0) @binding(2) var<storage, read> luminance: array<vec4f>;
@group(0) @binding(3) var<storage, read> planes: array<SumPlane>;
@group(0) @binding(4) var<storage, read> visible: array<u32>;
// The luminance that each plane's sums were made with.
@group(0) @binding(5) var<storage, read_write> applied: array<vec4f>;
@group(0) @binding(6) var<storage, read_write> work: array<Entry>;
@group(0) @binding(7) var<storage, read_write> jobs: array<Job>;
// Per plane and light: numbers of the images by the model and by phantoms, as bits.
@group(0) @binding(8) var<storage, read> basis: array<vec2f>;

// How much a light can give a plane. Surfaces behind a plane may face any way; where both
// images are black none faces the light.
fn reach(k: u32, i: u32) -> f32 {
    let facing = max(dot(planes[k].normal.xyz, faces[i].xyz), 0.0);
    let image = bitcast<vec2u>(basis[k * settings.lights + i]);
    let some = select(1.0, 0.0, all(image == vec2u(0xffffffffu)));
    return select(some, facing, planes[k].kind.x == 1u);
}

fn brightness(s: vec3f) -> f32 {
    return s.x + s.y + s.z;
}

@compute @workgroup_size(64)
fn plan(@builtin(global_invocation_id) id: vec3u) {
    let k = id.x;
    if k >= settings.planes {
        return;
    }
    var job = Job(0u, 0u, 0u, 0u);
    if visible[k] == 0u {
        jobs[k] = job;
        return;
    }
    let begin = k * settings.lights;
    var total = 0.0;
    for (var i = 0u; i < settings.lights; i++) {
        total += brightness(luminance[i].rgb) * reach(k, i);
    }
    // How far the sums are off, and how many images would mend them.
    var off = 0.0;
    var differ = 0u;
    for (var i = 0u; i < settings.lights; i++) {
        let gives = brightness(luminance[i].rgb) * reach(k, i);
        let counts = gives > 0.0 && gives >= settings.skip_below * total;
        job.lights += select(0u, 1u, counts);
        job.skipped += select(0u, 1u, gives > 0.0 && !counts);
        let wanted = select(vec3f(0.0), luminance[i].rgb, counts);
        let change = brightness(abs(wanted - applied[begin + i].rgb)) * reach(k, i);
        off += change;
        differ += select(0u, 1u, change > settings.least_change * total);
    }
    let untouched = off <= settings.recompute_above * total && !planes_are_new(k);
    job.anew = select(0u, 1u, 2u * differ > job.lights || planes_are_new(k));
    for (var i = 0u; i < settings.lights; i++) {
        let gives = brightness(luminance[i].rgb) * reach(k, i);
        let counts = gives > 0.0 && gives >= settings.skip_below * total;
        let wanted = select(vec3f(0.0), luminance[i].rgb, counts);
        let before = select(applied[begin + i].rgb, vec3f(0.0), job.anew == 1u);
        let change = wanted - before;
        let matters = brightness(abs(change)) * reach(k, i) > settings.least_change * total;
        let listed = select(matters, any(change != vec3f(0.0)), job.anew == 1u);
        if !untouched && listed {
            let image = basis[begin + i];
            let entry = Entry(vec4f(change, image.x), vec4f(faces[i].xyz, image.y));
            work[k * settings.stride + job.count] = entry;
            job.count += 1u;
        }
        if !untouched && (listed || job.anew == 1u) {
            applied[begin + i] = vec4f(wanted, 1.0);
        }
    }
    job.anew = select(job.anew, 0u, untouched);
    jobs[k] = job;
}

// Nothing was summed on it yet: of every light the sums hold nothing.
fn planes_are_new(k: u32) -> bool {
    return applied[k * settings.lights].w == 0.0;
}
