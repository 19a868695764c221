// What planning and summing know of the planes. Twins of `synthesis::Settings`, `SumPlane` and
// `Job`.

struct Settings {
    planes: u32,
    lights: u32,
    // Texels along a side.
    side: u32,
    // Planes of the real layer: they come first.
    real: u32,
    // Shares of a plane's light: lights below the first are left out; planes further off than
    // the second are summed again; lights further off than the third are.
    skip_below: f32,
    recompute_above: f32,
    least_change: f32,
    // Entries from one plane's first to the next plane's.
    stride: u32,
}

struct SumPlane {
    normal: vec4f,
    // x: 1 where the receiver is the plane itself. y: where its sums begin, in vectors.
    kind: vec4u,
}

// What a plane has to sum in this frame.
struct Job {
    // Workgroups of `sum`, none where nothing changes: read as the size of its dispatch.
    groups: vec3u,
    // 1: sums begin anew; 0: differences are added.
    anew: u32,
    // Entries with an image, from the first on; entries of images that are black and not
    // stored, from the last on backwards. Then lights that were left out.
    stored: u32,
    black: u32,
    skipped: u32,
    unused: u32,
    // Asum where the receiver is the plane itself.
    whole: vec4f,
}

// A light whose image a plane has to sum: by how much its luminance has changed and the number
// of its image past everything, then where it stands and the number of that past phantoms.
struct Entry {
    change: vec4f,
    light: vec4f,
}

const BLACK = 0xffffffffu;
const WHITE = 0xfffffffeu;
