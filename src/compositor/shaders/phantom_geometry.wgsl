// Depth and normal of the real scene's proxies in the scene camera. The instance index is the part.

struct PhantomPart {
    world_from_part: mat4x4f,
    normal_from_part: mat4x4f,
    // x: 1 receives shadows, 2 mirrors; yzw: diffuse reflectance.
    kind: vec4f,
}

@group(1) @binding(0) var<storage, read> parts: array<PhantomPart>;

struct Varying {
    // `lamp_response` draws the same triangles again and requires equal depth.
    @builtin(position) @invariant position: vec4f,
    @location(0) normal: vec3f,
    @location(1) @interpolate(flat) kind: f32,
    @location(2) @interpolate(flat) part: u32,
    IF_CACHED @location(3) cache_at: vec2f,
    IF_CACHED @location(4) @interpolate(flat) cache_chart: vec4u,
}

struct Surface {
    @location(0) normal: vec4f,
    IF_CACHED @location(1) place: vec2u,
}

@vertex
fn phantom_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    IF_CACHED @location(4) cache_at: vec2f,
    IF_CACHED @location(5) cache_chart: vec4u,
    @builtin(instance_index) i: u32,
) -> Varying {
    let world = parts[i].world_from_part * vec4f(position, 1.0);
    var out: Varying;
    out.position = clip_of(world);
    out.normal = (parts[i].normal_from_part * vec4f(normal, 0.0)).xyz;
    out.kind = parts[i].kind.x;
    out.part = i;
    IF_CACHED out.cache_at = cache_at;
    IF_CACHED out.cache_chart = cache_chart;
    return out;
}

// A number that neighbouring pixels of one smooth surface share: part and dominant axis of the
// normal. Up to 254: the shadow buffer stores it with three more bits in a half float.
fn surface_key(part: u32, n: vec3f) -> f32 {
    let a = abs(n);
    let along_x = select(0u, 2u, n.x < 0.0);
    let along_y = select(1u, 3u, n.y < 0.0);
    let along_z = select(4u, 5u, n.z < 0.0);
    let axis = select(select(along_y, along_x, a.x > a.y), along_z, a.z >= max(a.x, a.y));
    return f32((part * 6u + axis) % 254u + 1u);
}

// The change of the picture at once, where the light is kept on surfaces and no lamp adds to it.
IF_CACHED @fragment
IF_CACHED fn shadowed_fragment(in: Varying) -> @location(0) vec4f {
IF_CACHED     let n = normalize(in.normal);
IF_CACHED     let kept = kept_or(place_of(in.cache_at, in.cache_chart), vec3f(1.0));
IF_CACHED     let change = change_of_picture(kept.lost, kept.arriving, vec3f(0.0), n);
IF_CACHED     return shadow_texel(change, kept.share, surface_key(in.part, n), in.kind == 1.0);
IF_CACHED }

@fragment
fn phantom_fragment(in: Varying) -> Surface {
    let n = normalize(in.normal);
    var out: Surface;
    out.normal = vec4f(octahedron_from_normal(n), in.kind, surface_key(in.part, n));
    IF_CACHED out.place = place_of(in.cache_at, in.cache_chart);
    return out;
}
