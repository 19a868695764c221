// How real surfaces answer lamps. By default the picture is multiplied: picture ÷ estimated
// irradiance = albedo. The paper's response (DiVerdi and Höllerer 2004, section 4.2) is added
// by a pass of its own.

// What lamps add to what arrives, where the picture is multiplied.
fn multiplied_lamps(mask: u32, world: vec3f, n: vec3f) -> vec3f {
    return select(lamp_irradiance(mask, world, n), vec3f(0.0), frame.brightest.w > 0.5);
}

// Flatter than this a surface fades into its own shadow, cosine.
const GRAZING = 0.1;

// The paper's response of a surface with unit normal `n`, to a lamp along the unit vector `to`,
// as a share of what a white surface facing the lamp shows. `intensity`: of the video, 0 to 1.
//
//   alpha = dominance · (brightest physical light · lamp)
//   near 1: the video's own relief; near 0: N·L; near −1: the relief inverted
fn lamp_response(to: vec3f, n: vec3f, intensity: f32) -> f32 {
    let n_dot_l = dot(n, to);
    let alpha = clamp(dot(frame.brightest.xyz, to), -1.0, 1.0);
    let multiplicative = select(intensity, 1.0 - intensity, alpha < 0.0);
    let response = mix(max(n_dot_l, 0.0), multiplicative, abs(alpha));
    // The relief knows no night side: there the surface lies in its own shadow.
    return response * clamp(n_dot_l / GRAZING, 0.0, 1.0);
}
