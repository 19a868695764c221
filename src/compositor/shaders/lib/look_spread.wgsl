// Both layers filtered by five weights along a row or a column. The change of the real picture is
// filtered without sharpening: negative weights could leave it without any weight.
fn spread_along(
    surface: texture_2d<f32>,
    change: texture_2d<f32>,
    pixel: vec2i,
    step: vec2i,
    weights: vec4f,
    soft: vec4f,
) -> Layers {
    let last = vec2i(textureDimensions(surface)) - vec2i(1);
    var sum = Layers(
        textureLoad(surface, pixel, 0) * weights.x,
        textureLoad(change, pixel, 0) * soft.x,
    );
    for (var k = 1; k < 3; k++) {
        let before = clamp(pixel - k * step, vec2i(0), last);
        let after = clamp(pixel + k * step, vec2i(0), last);
        let w = select(weights.y, weights.z, k == 2);
        let s = select(soft.y, soft.z, k == 2);
        sum.surface += (textureLoad(surface, before, 0) + textureLoad(surface, after, 0)) * w;
        sum.change += (textureLoad(change, before, 0) + textureLoad(change, after, 0)) * s;
    }
    return sum;
}
