// The lights of planes: the dome's faces, less what compact sources have in them, and those
// sources' own. What is taken from a face is what the source gets, so that all the light stays:
// no face gives more than it has. Each source has two lights, with the images in use and with
// those that are being drawn; the latter is dark.

const LANES = 64u;

struct Sources {
    // Faces; which of a source's lights is in use.
    faces: vec4u,
    // Per source and face, what the source has in it.
    taken: array<vec4f>,
}

// S_i of the faces.
@group(0) @binding(0) var<storage, read> sums: array<vec4f>;
@group(0) @binding(1) var<storage, read> sources: Sources;
@group(0) @binding(2) var<storage, read_write> lights: array<vec4f>;

var<workgroup> partial: array<array<vec4f, LANES>, SOURCES>;

@compute @workgroup_size(LANES)
fn give(@builtin(local_invocation_index) lane: u32) {
    let faces = sources.faces.x;
    for (var s = 0u; s < SOURCES; s++) {
        partial[s][lane] = vec4f(0.0);
    }
    for (var i = lane; i < faces; i += LANES) {
        var left = sums[i];
        for (var s = 0u; s < SOURCES; s++) {
            let given = min(sources.taken[s * faces + i], left);
            left -= given;
            partial[s][lane] += given;
        }
        lights[i] = left;
    }
    workgroupBarrier();
    if lane < SOURCES {
        var sum = vec4f(0.0);
        for (var k = 0u; k < LANES; k++) {
            sum += partial[lane][k];
        }
        let in_use = select(sources.faces.y, sources.faces.z, lane == 1u);
        lights[faces + 2u * lane + in_use] = sum;
        lights[faces + 2u * lane + 1u - in_use] = vec4f(0.0);
    }
}
