// Samples of virtual surfaces, packed into two targets: software drivers pay for each target per
// sample, and each pass loads only the targets that it needs.

struct PackedSurface {
    // Square root of the base colour, 8 bits per channel, and the kind in 8 bits: 0 nothing, 255
    // metallic-roughness, else Phong's lobe with that occlusion; then the octahedral normal, 16
    // bits per component.
    @location(0) shape: vec4u,
    // Metallic, roughness, specular, occlusion, 8 bits each, or for Phong's lobe the square root of
    // the specular colour and log2(exponent + 1) / 14; emissive.
    @location(1) material: vec4u,
    IF_CACHED // Place in the surface cache.
    IF_CACHED @location(2) place: vec2u,
}

fn halves(a: u32, b: u32) -> vec4u {
    return vec4u(a & 0xffffu, a >> 16u, b & 0xffffu, b >> 16u);
}

const METALLIC_ROUGHNESS = 1.0;

// `kind`: METALLIC_ROUGHNESS or `phong_kind`.
fn packed_shape(base: vec3f, n: vec3f, kind: f32) -> vec4u {
    return halves(
        pack4x8unorm(vec4f(sqrt(clamp(base, vec3f(0.0), vec3f(1.0))), kind)),
        pack2x16snorm(octahedron_from_normal(n)),
    );
}

fn is_surface(shape: vec4u) -> bool {
    return shape.y > 255u;
}

// Encodes occlusion as the kind of a Phong surface: 1 to 127 of 255.
fn phong_kind(occlusion: f32) -> f32 {
    return (1.0 + 126.0 * clamp(occlusion, 0.0, 1.0)) / 255.0;
}

fn is_phong(shape: vec4u) -> bool {
    return (shape.y >> 8u) < 128u;
}

fn occlusion_of(shape: vec4u, properties: vec4f) -> f32 {
    let kind = f32(shape.y >> 8u);
    return select(properties.w, (kind - 1.0) / 126.0, PHONG && kind < 128.0);
}

// Fraction of the base colour that is diffuse.
fn diffuse_share(shape: vec4u, properties: vec4f) -> f32 {
    return select(1.0 - properties.x, 1.0, PHONG && is_phong(shape));
}

fn base_colour(shape: vec4u) -> vec3f {
    let root = vec3f(vec3u(shape.x & 255u, shape.x >> 8u, shape.y & 255u)) / 255.0;
    return root * root;
}

fn octahedron(shape: vec4u) -> vec2f {
    return unpack2x16snorm(shape.z | (shape.w << 16u));
}

// `properties`: as stored in `PackedSurface`. Emissive has a shared exponent (Ward 1991) and 8 bits per
// channel for its square root: the darkest channel of a saturated colour would have steps of a tenth.
fn packed_material(properties: vec4f, emissive: vec3f) -> vec4u {
    let brightest = max(max(emissive.r, emissive.g), emissive.b);
    let exponent = clamp(ceil(log2(max(brightest, 1e-30))), -64.0, 63.0);
    let mantissa = sqrt(clamp(emissive * exp2(-exponent), vec3f(0.0), vec3f(1.0)));
    let light = pack4x8unorm(vec4f(mantissa, 0.0)) | (u32(exponent + 64.0) << 24u);
    return halves(pack4x8unorm(properties), light);
}

fn properties_of(material: vec4u) -> vec4f {
    return unpack4x8unorm(material.x | (material.y << 16u));
}

fn emissive_of(material: vec4u) -> vec3f {
    let root = unpack4x8unorm(material.z | (material.w << 16u)).rgb;
    return root * root * exp2(f32(material.w >> 8u) - 64.0);
}
