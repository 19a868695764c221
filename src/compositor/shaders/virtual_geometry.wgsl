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

// Centroid: a partly covered pixel takes the normal within the triangle. At the pixel's centre,
// beyond the outline, the extrapolated normal would face away from the camera.
struct Varying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) normal: vec3f,
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

fn mapped_normal(in: Varying, scale: f32) -> vec3f {
    let n = normalize(in.normal);
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
    var n = mapped_normal(in, part.emissive.w);
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
    let n = normalize(in.normal);
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
