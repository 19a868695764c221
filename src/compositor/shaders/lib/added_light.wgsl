// The result of the pass `lamp_response`: linear light that lamps add to a pixel of the real
// picture, in the scene camera's own exposure; zero with the default response, which multiplies the
// picture.
fn added_at(pixel: vec2i) -> vec3f {
    if !LAMPED {
        return vec3f(0.0);
    }
    let added = textureLoad(response, pixel, 0).rgb * brightness_at(vec2f(pixel));
    return select(vec3f(0.0), added, frame.brightest.w > 0.5);
}
