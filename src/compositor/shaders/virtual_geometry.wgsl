// Surface properties of the virtual objects, several samples per pixel, for the shadow buffer and
// the composite. A part is a uniform, because Mesa's software driver reads storage buffers lane by
// lane.

struct VirtualPart {
    world_from_part: mat4x4f,
    // Its last entry is -1 if the placement mirrors.
    normal_from_part: mat4x4f,
    base_colour: vec4f,
    // Metallic, roughness, specular, alpha cutoff.
    surface: vec4f,
    // RGB emissive; w = scale of the normal map, 0 for none.
    emissive: vec4f,
    // Square root of Phong's specular colour, log2(exponent + 1) / 14; negative without Phong's
    // lobe.
    phong: vec4f,
    // Offsets of uniforms are multiples of 256 bytes.
    unused: mat4x4f,
}

@group(1) @binding(0) var<uniform> part: VirtualPart;
@group(2) @binding(0) var surface_sampler: sampler;
@group(2) @binding(1) var base_colour_map: texture_2d<f32>;
@group(2) @binding(2) var metallic_roughness_map: texture_2d<f32>;
@group(2) @binding(3) var normal_map: texture_2d<f32>;
@group(2) @binding(4) var occlusion_map: texture_2d<f32>;
@group(2) @binding(5) var emissive_map: texture_2d<f32>;

// Centroid: a pixel that a triangle covers partly takes a place within it. At the pixel's centre, beyond an
// outline, the extrapolated normal would face away from the camera; everywhere else it counts.
struct Varying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) normal: vec3f,
    @location(6) @interpolate(perspective, center) normal_at_centre: vec3f,
    @location(1) @interpolate(perspective, centroid) uv: vec2f,
    @location(2) @interpolate(perspective, centroid) tangent: vec4f,
    IF_CACHED @location(4) @interpolate(perspective, centroid) cache_at: vec2f,
    IF_CACHED @location(5) @interpolate(flat) cache_chart: vec4u,
}

@vertex
fn virtual_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) tangent: vec4f,
    IF_CACHED @location(4) cache_at: vec2f,
    IF_CACHED @location(5) cache_chart: vec4u,
) -> Varying {
    let world = part.world_from_part * vec4f(position, 1.0);
    let n = (part.normal_from_part * vec4f(normal, 0.0)).xyz;
    let t = (part.world_from_part * vec4f(tangent.xyz, 0.0)).xyz;
    let side = tangent.w * part.normal_from_part[3].w;
    var out: Varying;
    out.position = clip_of(world);
    out.normal = n;
    out.normal_at_centre = n;
    out.uv = uv;
    out.tangent = vec4f(t, side);
    IF_CACHED out.cache_at = cache_at;
    IF_CACHED out.cache_chart = cache_chart;
    return out;
}

// Without textures and alpha test.
struct PlainVarying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) normal: vec3f,
    @location(6) @interpolate(perspective, center) normal_at_centre: vec3f,
    IF_CACHED @location(2) @interpolate(perspective, centroid) cache_at: vec2f,
    IF_CACHED @location(3) @interpolate(flat) cache_chart: vec4u,
}

@vertex
fn plain_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    IF_CACHED @location(4) cache_at: vec2f,
    IF_CACHED @location(5) cache_chart: vec4u,
) -> PlainVarying {
    let world = part.world_from_part * vec4f(position, 1.0);
    let n = (part.normal_from_part * vec4f(normal, 0.0)).xyz;
    var out: PlainVarying;
    out.position = clip_of(world);
    out.normal = n;
    out.normal_at_centre = n;
    IF_CACHED out.cache_at = cache_at;
    IF_CACHED out.cache_chart = cache_chart;
    return out;
}

// No surface, as far away as can be.
@fragment
fn nothing() -> @location(0) vec4u {
    return vec4u(0u);
}

@vertex
fn occluder_vertex(@location(0) world: vec3f) -> @builtin(position) vec4f {
    return clip_of(vec4f(world, 1.0));
}

// Least cosine between a triangle's normals within it and at the centre of a pixel that it covers partly,
// where the latter counts.
const LIKE = 0.8;

// The normal at the centre of a pixel, where the rays of `reflections` start, or `within` the triangle
// beyond outlines.
fn normal_of(centre: vec3f, within: vec3f, position: vec2f, front: bool) -> vec3f {
    let there = normalize(centre);
    let n = normalize(within);
    let towards = dot(there, ray_through(position - vec2f(0.5)));
    let faces = select(towards, -towards, front) > 0.0;
    return select(n, there, faces & (dot(there, n) > LIKE));
}

fn mapped_normal(in: Varying, n: vec3f, scale: f32) -> vec3f {
    let t = normalize(in.tangent.xyz - n * dot(n, in.tangent.xyz));
    let b = cross(n, t) * in.tangent.w;
    let m = textureSample(normal_map, surface_sampler, in.uv).xyz * 2.0 - 1.0;
    let mapped = normalize(t * m.x * scale + b * m.y * scale + n * m.z);
    // No branch: the scale is uniform.
    return select(mapped, n, scale == 0.0);
}

@fragment
fn virtual_fragment(in: Varying, @builtin(front_facing) front: bool) -> PackedSurface {
    let base = part.base_colour * textureSample(base_colour_map, surface_sampler, in.uv);
    let mr = textureSample(metallic_roughness_map, surface_sampler, in.uv);
    let occlusion = textureSample(occlusion_map, surface_sampler, in.uv).r;
    let emissive = part.emissive.rgb * textureSample(emissive_map, surface_sampler, in.uv).rgb;
    let smooth_normal = normal_of(in.normal_at_centre, in.normal, in.position.xy, front);
    var n = mapped_normal(in, smooth_normal, part.emissive.w);
    if base.a < part.surface.w {
        discard;
    }
    n = select(-n, n, front);
    let phong = part.phong.w >= 0.0;
    let rough = vec4f(part.surface.x * mr.b, part.surface.y * mr.g, part.surface.z, occlusion);
    let kind = select(METALLIC_ROUGHNESS, phong_kind(occlusion), phong);
    var out: PackedSurface;
    out.shape = packed_shape(base.rgb, n, kind);
    out.material = packed_material(select(rough, part.phong, phong), emissive);
    IF_CACHED out.place = select(vec2u(0u), place_of(in.cache_at, in.cache_chart), front);
    return out;
}

@fragment
fn plain_fragment(in: PlainVarying, @builtin(front_facing) front: bool) -> PackedSurface {
    let n = normal_of(in.normal_at_centre, in.normal, in.position.xy, front);
    let phong = part.phong.w >= 0.0;
    let kind = select(METALLIC_ROUGHNESS, phong_kind(1.0), phong);
    let shape = packed_shape(part.base_colour.rgb, select(-n, n, front), kind);
    let properties = select(vec4f(part.surface.xyz, 1.0), part.phong, phong);
    var out: PackedSurface;
    out.shape = shape;
    out.material = packed_material(properties, part.emissive.rgb);
    IF_CACHED out.place = select(vec2u(0u), place_of(in.cache_at, in.cache_chart), front);
    return out;
}
