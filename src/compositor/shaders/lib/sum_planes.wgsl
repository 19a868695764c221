// Structures shared by planning and summing. Twins of `synthesis::Settings`, `SumPlane` and `Job`.

struct Settings {
    planes: u32,
    lights: u32,
    // Texels along a side.
    side: u32,
    // Number of planes of the real layer, which come first.
    real: u32,
    // Fractions of a plane's light: lights below the first are skipped; planes whose error exceeds
    // the second are summed again; lights whose change exceeds the third are updated.
    skip_below: f32,
    recompute_above: f32,
    min_change: f32,
    // Entries from one plane's first to the next plane's.
    stride: u32,
}

struct SumPlane {
    normal: vec4f,
    // x: 1 if the receiver is the plane itself. y: start of its sums, in vectors.
    kind: vec4u,
}

// Work for a plane in this frame.
struct Job {
    // Workgroups of `sum`, zero if nothing changes; read as the size of an indirect dispatch.
    groups: vec3u,
    // 1: recompute the sums; 0: add differences.
    recompute: u32,
    // Number of entries with an image, from the first on; number of entries of images that are
    // black and not stored, from the last on backwards; number of lights that were skipped.
    stored: u32,
    black: u32,
    skipped: u32,
    unused: u32,
    // Asum where the receiver is the plane itself.
    asum: vec4f,
}

// A light whose image a plane has to sum: the change of its luminance and the number of its image
// past all casters, then its direction and the number of its image past phantoms.
struct Entry {
    change: vec4f,
    light: vec4f,
}

const BLACK = 0xffffffffu;
const WHITE = 0xfffffffeu;
