// Lights of the planes: the dome's faces, minus the compact sources in them, and those sources' own
// lights. The source gets what is subtracted from a face, which never exceeds the face's light, so
// that the total is preserved. Each source has two lights, one with the images in use and one with
// those being baked; the latter is dark.

const LANES = 64u;

struct Sources {
    // Number of faces; the light in use of each source.
    faces: vec4u,
    // Per source and face, the source's light in the face.
    taken: array<vec4f>,
}

// S_i of the faces.
@group(0) @binding(0) var<storage, read> sums: array<vec4f>;
@group(0) @binding(1) var<storage, read> sources: Sources;
@group(0) @binding(2) var<storage, read_write> lights: array<vec4f>;

var<workgroup> partial: array<array<vec4f, LANES>, MAX_SOURCES>;

@compute @workgroup_size(LANES)
fn assign(@builtin(local_invocation_index) lane: u32) {
    let faces = sources.faces.x;
    for (var s = 0u; s < MAX_SOURCES; s++) {
        partial[s][lane] = vec4f(0.0);
    }
    for (var i = lane; i < faces; i += LANES) {
        var left = sums[i];
        for (var s = 0u; s < MAX_SOURCES; s++) {
            let taken = min(sources.taken[s * faces + i], left);
            left -= taken;
            partial[s][lane] += taken;
        }
        lights[i] = left;
    }
    workgroupBarrier();
    if lane < MAX_SOURCES {
        var sum = vec4f(0.0);
        for (var k = 0u; k < LANES; k++) {
            sum += partial[lane][k];
        }
        let in_use = select(sources.faces.y, sources.faces.z, lane == 1u);
        lights[faces + 2u * lane + in_use] = sum;
        lights[faces + 2u * lane + 1u - in_use] = vec4f(0.0);
    }
}
