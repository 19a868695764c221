// Texels of the light buffer, 16 bytes: irradiance and distance as half floats, then the octahedral
// normal. One load returns all that an edge-aware filter needs.

struct LightTexel {
    irradiance: vec3f,
    // Metres along the view; 0 without a virtual surface.
    z: f32,
    normal: vec3f,
}

fn packed_light(irradiance: vec3f, z: f32, n: vec3f) -> vec4u {
    return vec4u(
        pack2x16float(irradiance.rg),
        pack2x16float(vec2f(irradiance.b, z)),
        pack2x16snorm(octahedron_from_normal(n)),
        0u,
    );
}

fn unpacked_light(t: vec4u) -> LightTexel {
    let bz = unpack2x16float(t.y);
    let n = normal_from_octahedron(unpack2x16snorm(t.z));
    return LightTexel(vec3f(unpack2x16float(t.x), bz.x), bz.y, n);
}
