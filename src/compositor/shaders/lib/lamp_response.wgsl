// Responses of real surfaces to lamps. By default the picture is multiplied: picture ÷ estimated
// irradiance = albedo. The paper's response (DiVerdi and Höllerer 2004, section 4.2) is added by a
// pass of its own.

// Irradiance from lamps with the default response; zero with the paper's.
fn multiplied_lamps(mask: u32, world: vec3f, n: vec3f) -> vec3f {
    return select(lamp_irradiance(mask, world, n), vec3f(0.0), frame.brightest.w > 0.5);
}

// Cosine below which the light fades to zero, as a surface turns into its own shadow.
const GRAZING = 0.1;

// The paper's response of a surface with unit normal `n` to a lamp along the unit vector `to`, as a
// fraction of the light of a white surface facing the lamp. `intensity`: that of the video, 0 to 1.
//
//   alpha = dominance · (brightest physical light · lamp)
//   near 1: the video's intensity; near 0: N·L; near −1: the inverted intensity
fn lamp_response(to: vec3f, n: vec3f, intensity: f32) -> f32 {
    let n_dot_l = dot(n, to);
    let alpha = clamp(dot(frame.brightest.xyz, to), -1.0, 1.0);
    let multiplicative = select(intensity, 1.0 - intensity, alpha < 0.0);
    let response = mix(max(n_dot_l, 0.0), multiplicative, abs(alpha));
    // The video's relief does not contain the side turned away from the lamp, which lies in its own
    // shadow.
    return response * clamp(n_dot_l / GRAZING, 0.0, 1.0);
}
