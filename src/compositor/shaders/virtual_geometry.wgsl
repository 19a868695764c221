// Surface properties of the virtual objects, several samples per pixel, for the shadow buffer and
// the composite. The instance index is the part.

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
}

@group(1) @binding(0) var<storage, read> parts: array<VirtualPart>;
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
    @location(3) @interpolate(flat) part: u32,
}

@vertex
fn virtual_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) uv: vec2f,
    @location(3) tangent: vec4f,
    @builtin(instance_index) i: u32,
) -> Varying {
    let world = parts[i].world_from_part * vec4f(position, 1.0);
    let n = (parts[i].normal_from_part * vec4f(normal, 0.0)).xyz;
    let t = (parts[i].world_from_part * vec4f(tangent.xyz, 0.0)).xyz;
    let side = tangent.w * parts[i].normal_from_part[3].w;
    return Varying(clip_of(world), n, uv, vec4f(t, side), i);
}

// Without textures and alpha test.
struct PlainVarying {
    @builtin(position) position: vec4f,
    @location(0) @interpolate(perspective, centroid) normal: vec3f,
    @location(1) @interpolate(flat) part: u32,
}

@vertex
fn plain_vertex(
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @builtin(instance_index) i: u32,
) -> PlainVarying {
    let world = parts[i].world_from_part * vec4f(position, 1.0);
    let n = (parts[i].normal_from_part * vec4f(normal, 0.0)).xyz;
    return PlainVarying(clip_of(world), n, i);
}

@vertex
fn occluder_vertex(@location(0) world: vec3f) -> @builtin(position) vec4f {
    return clip_of(vec4f(world, 1.0));
}

fn mapped_normal(in: Varying, scale: f32) -> vec3f {
    let n = normalize(in.normal);
    if scale == 0.0 {
        return n;
    }
    let t = normalize(in.tangent.xyz - n * dot(n, in.tangent.xyz));
    let b = cross(n, t) * in.tangent.w;
    let m = textureSample(normal_map, surface_sampler, in.uv).xyz * 2.0 - 1.0;
    return normalize(t * m.x * scale + b * m.y * scale + n * m.z);
}

@fragment
fn virtual_fragment(in: Varying, @builtin(front_facing) front: bool) -> PackedSurface {
    let part = parts[in.part];
    let base = part.base_colour * textureSample(base_colour_map, surface_sampler, in.uv);
    let mr = textureSample(metallic_roughness_map, surface_sampler, in.uv);
    let occlusion = textureSample(occlusion_map, surface_sampler, in.uv).r;
    let emissive = part.emissive.rgb * textureSample(emissive_map, surface_sampler, in.uv).rgb;
    var n = mapped_normal(in, part.emissive.w);
    if base.a < part.surface.w {
        discard;
    }
    n = select(-n, n, front);
    if part.phong.w >= 0.0 {
        let shape = packed_shape(base.rgb, n, phong_kind(occlusion));
        return PackedSurface(shape, packed_material(part.phong, emissive));
    }
    let properties = vec4f(part.surface.x * mr.b, part.surface.y * mr.g, part.surface.z, occlusion);
    return PackedSurface(packed_shape(base.rgb, n, METALLIC_ROUGHNESS), packed_material(properties, emissive));
}

@fragment
fn plain_fragment(in: PlainVarying, @builtin(front_facing) front: bool) -> PackedSurface {
    let part = parts[in.part];
    let n = normalize(in.normal);
    let phong = part.phong.w >= 0.0;
    let kind = select(METALLIC_ROUGHNESS, phong_kind(1.0), phong);
    let shape = packed_shape(part.base_colour.rgb, select(-n, n, front), kind);
    let properties = select(vec4f(part.surface.xyz, 1.0), part.phong, phong);
    return PackedSurface(shape, packed_material(properties, part.emissive.rgb));
}
