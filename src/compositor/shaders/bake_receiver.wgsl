// The parts that a shadowing plane covers, rendered in parallel projection along the plane's
// normal: their normals and their depth behind the plane.

struct View {
    // Rows of an affine map from the world: clip x, clip y, fraction of the slab's depth.
    x: vec4f,
    y: vec4f,
    depth: vec4f,
    // Away from the covered parts.
    normal: vec4f,
}

@group(0) @binding(0) var<uniform> plane: View;

struct Seen {
    @builtin(position) position: vec4f,
    @location(0) normal: vec3f,
    @location(1) depth: f32,
}

@vertex
fn receiver_vertex(@location(0) world: vec3f, @location(1) normal: vec3f) -> Seen {
    let p = vec4f(world, 1.0);
    let depth = dot(plane.depth, p);
    return Seen(vec4f(dot(plane.x, p), dot(plane.y, p), depth, 1.0), normal, depth);
}

// Octahedral normal, depth, and 1 where there is a surface. Back-facing normals are flipped.
@fragment
fn receiver_fragment(in: Seen) -> @location(0) vec4f {
    let n = normalize(in.normal);
    let facing = select(-n, n, dot(n, plane.normal.xyz) >= 0.0);
    return vec4f(octahedron_from_normal(facing), in.depth, 1.0);
}
