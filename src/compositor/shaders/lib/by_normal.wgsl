// Unshadowed irradiance on a surface with normal `n`, from a table on an octahedron.
fn by_normal(table: texture_2d<f32>, n: vec3f) -> vec3f {
    let side = f32(textureDimensions(table).x);
    let uv = ((octahedron_from_normal(n) * 0.5 + 0.5) * (side - 1.0) + 0.5) / side;
    return textureSampleLevel(table, table_sampler, uv, 0.0).rgb;
}
