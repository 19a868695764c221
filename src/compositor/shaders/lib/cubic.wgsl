// Catmull-Rom weights (1974) of four neighbours, at `t` past the second.
fn cubic(t: f32) -> vec4f {
    let t2 = t * t;
    let t3 = t2 * t;
    return 0.5 * vec4f(2.0 * t2 - t - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2);
}

// Interpolates a picture between its pixels, in code values.
fn smooth_at(picture: texture_2d<f32>, at: vec2f) -> vec3f {
    let corner = floor(at);
    let across = cubic(at.x - corner.x);
    let down = cubic(at.y - corner.y);
    let last = vec2i(textureDimensions(picture)) - vec2i(1);
    var sum = vec3f(0.0);
    for (var y = 0; y < 4; y++) {
        for (var x = 0; x < 4; x++) {
            let pixel = clamp(vec2i(corner) + vec2i(x - 1, y - 1), vec2i(0), last);
            sum += textureLoad(picture, pixel, 0).rgb * (across[x] * down[y]);
        }
    }
    return clamp(sum, vec3f(0.0), vec3f(1.0));
}
