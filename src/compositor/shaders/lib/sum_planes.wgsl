// What planning and summing know of the planes. Twins of `synthesis::Settings` and
// `synthesis::SumPlane`.

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

// A light whose image a plane has to sum: by how much its luminance has changed and the number
// of its image by the model, then where it stands and the number of its image by phantoms.
struct Entry {
    change: vec4f,
    light: vec4f,
}
