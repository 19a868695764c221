// Applies shadowing planes to the picture: projects each point of a surface along the normals of
// its layer's planes to their sums of basis images.

struct VisiblePlane {
    // Rows of an affine map from the world: texture coordinates u, v (0 to 1 across the
    // rectangle) and metres behind the plane.
    u: vec4f,
    v: vec4f,
    behind: vec4f,
    // Away from the surface that the plane covers; w = depth of its slab, metres.
    normal: vec4f,
    // Layer of the textures; 1 if the receiver is the plane itself; 0; 0.
    kind: vec4u,
    // Texels per metre (finer planes weigh more), fraction of the rectangle that fades out at its
    // border, tolerance of depth in metres, 0.
    scale: vec4f,
}

struct VisiblePlanes {
    // Number of planes of the real layer, number of all planes; unused.
    count: vec4u,
    each: array<VisiblePlane>,
}

@group(1) @binding(0) var<storage, read> visible: VisiblePlanes;
// Fractions of the dome's light on an open surface: past all casters (alpha: the receiver's depth
// in the slab), and past phantoms alone.
@group(1) @binding(1) var share_all: texture_2d_array<f32>;
@group(1) @binding(2) var share_real: texture_2d_array<f32>;
@group(1) @binding(3) var plane_sampler: sampler;

struct Shares {
    all: vec3f,
    real: vec3f,
}

// How well plane `k` represents a point: x, y = coordinates on the plane, z, w = weights; z = 0 if
// it does not represent it.
fn fit_of(k: u32, world: vec3f, n: vec3f) -> vec4f {
    let p = vec4f(world, 1.0);
    let uv = vec2f(dot(visible.each[k].u, p), dot(visible.each[k].v, p));
    let behind = dot(visible.each[k].behind, p);
    let edge = min(min(uv.x, 1.0 - uv.x), min(uv.y, 1.0 - uv.y));
    let inside = clamp(edge / visible.each[k].scale.y, 0.0, 1.0);
    let within = behind > -visible.each[k].scale.z && behind < visible.each[k].normal.w + visible.each[k].scale.z;
    let facing = clamp(dot(n, visible.each[k].normal.xyz) * 1.1 - 0.1, 0.0, 1.0);
    let squared = facing * facing;
    return vec4f(uv, select(0.0, inside, within && facing > 0.0), squared * squared);
}

// Weight of plane `k` for the point with the given `fit`, where the receiver lies at the fraction
// `depth` of the slab behind the plane.
fn weight_of(k: u32, world: vec3f, fit: vec4f, depth: f32) -> f32 {
    let off = abs(dot(visible.each[k].behind, vec4f(world, 1.0)) - depth * visible.each[k].normal.w);
    // Surfaces behind the first are left to another plane, if there is one.
    let tolerance = visible.each[k].scale.z;
    let hit = 1.0 - smoothstep(tolerance, 3.0 * tolerance, off);
    let matches = select(max(hit, 1e-3 * tolerance / (tolerance + off)), 1.0, visible.each[k].kind.y == 1u);
    let fine = visible.each[k].scale.x * visible.each[k].scale.x;
    return fit.z * (fit.w + 1e-6) * matches * fine * fine;
}

// Weighted means over the planes of the real layer. Points that no plane covers are unshadowed.
fn real_shares(world: vec3f, n: vec3f) -> Shares {
    var sum = Shares(vec3f(0.0), vec3f(0.0));
    var weight = 0.0;
    var covered = 0.0;
    for (var k = 0u; k < visible.count.x; k++) {
        let fit = fit_of(k, world, n);
        let layer = visible.each[k].kind.x;
        let all = textureSampleLevel(share_all, plane_sampler, fit.xy, layer, 0.0);
        let real = textureSampleLevel(share_real, plane_sampler, fit.xy, layer, 0.0).rgb;
        let w = weight_of(k, world, fit, all.a);
        sum.all += all.rgb * w;
        sum.real += real * w;
        weight += w;
        covered = max(covered, fit.z);
    }
    let scale = covered / max(weight, 1e-30);
    let open = vec3f(1.0 - covered);
    return Shares(open + sum.all * scale, open + sum.real * scale);
}

// The same over the planes of the virtual layer.
fn virtual_share(world: vec3f, n: vec3f) -> vec3f {
    var sum = vec3f(0.0);
    var weight = 0.0;
    var covered = 0.0;
    for (var k = visible.count.x; k < visible.count.y; k++) {
        let fit = fit_of(k, world, n);
        let all = textureSampleLevel(share_all, plane_sampler, fit.xy, visible.each[k].kind.x, 0.0);
        let w = weight_of(k, world, fit, all.a);
        sum += all.rgb * w;
        weight += w;
        covered = max(covered, fit.z);
    }
    return vec3f(1.0 - covered) + sum * (covered / max(weight, 1e-30));
}
