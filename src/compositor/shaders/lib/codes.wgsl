// The camera's response curve, in both directions. In a uniform buffer, from which software drivers
// load at a fraction of a texture's cost.

struct Codes {
    // Linear value by code, four per vector.
    decoding: array<vec4f, 64>,
    // Code by the square root of the linear value, an eighth of a code per entry, so that no
    // interpolation is needed.
    encoding: array<vec4f, ENCODING_VECTORS>,
}

@group(1) @binding(1) var<uniform> codes: Codes;

fn linear_from_code(code: vec3f) -> vec3f {
    let c = vec3u(round(code * 255.0));
    return vec3f(
        codes.decoding[c.r >> 2u][c.r & 3u],
        codes.decoding[c.g >> 2u][c.g & 3u],
        codes.decoding[c.b >> 2u][c.b & 3u],
    );
}

fn code_from_linear(linear: vec3f) -> vec3f {
    let at = vec3u(sqrt(clamp(linear, vec3f(0.0), vec3f(1.0))) * f32(4 * ENCODING_VECTORS - 1) + 0.5);
    return vec3f(
        codes.encoding[at.r >> 2u][at.r & 3u],
        codes.encoding[at.g >> 2u][at.g & 3u],
        codes.encoding[at.b >> 2u][at.b & 3u],
    );
}
