// Specular lobes of a surface: GGX (metallic-roughness) or Phong's.

struct Gloss {
    // F0 and F90, or Phong's specular colour and zero.
    f0: vec3f,
    f90: f32,
    // Perceptual roughness; for Phong's lobe log2(exponent + 1) / 14.
    parameter: f32,
    // Width of the lobe, as GGX's alpha.
    width: f32,
    phong: bool,
}

// Rows of the gloss table per family. Twin of `gloss_maps::ROWS`.
const GLOSS_ROWS = 64.0;

fn gloss_of(shape: vec4u, properties: vec4f, base: vec3f) -> Gloss {
    if PHONG && is_phong(shape) {
        let specular = properties.xyz * properties.xyz;
        let width = exp2(-7.0 * properties.w);
        return Gloss(specular, 0.0, properties.w, width, true);
    }
    let metallic = properties.x;
    let roughness = clamp(properties.y, 0.03, 1.0);
    let f0 = mix(vec3f(0.04 * properties.z), base, metallic);
    let f90 = select(0.0, 1.0, properties.z > 0.0 || metallic > 0.0);
    return Gloss(f0, f90, roughness, roughness * roughness, false);
}

// Blocks of the table. Twin of `gloss_maps::BLOCKS`.
const GLOSS_BLOCKS = 3.0;

// Row of the gloss table: scale of F0, added term, tilt of the lobe towards the normal, mip level.
fn gloss_row(g: Gloss) -> f32 {
    return row_in_block(g, select(0.0, 1.0, g.phong));
}

// Row of the gloss table for GGX's long lobe: mip level of its parts, its share, step between its parts.
fn long_row(g: Gloss) -> f32 {
    return row_in_block(g, 2.0);
}

fn row_in_block(g: Gloss, block: f32) -> f32 {
    let within = clamp(g.parameter, 0.5 / GLOSS_ROWS, 1.0 - 0.5 / GLOSS_ROWS);
    return (within + block) / GLOSS_BLOCKS;
}

// The unit vector `mirror` rotated towards `n` by the fraction `tilt` of the angle between them;
// twin of `lobes::tilted`.
fn tilted(mirror: vec3f, n: vec3f, tilt: f32) -> vec3f {
    let cosine = dot(n, mirror);
    let across = n - mirror * cosine;
    let angle = tilt * acos(clamp(cosine, -1.0, 1.0));
    return normalize(mirror * cos(angle) + across * (sin(angle) / max(length(across), 1e-4)));
}

// Height-correlated Smith masking of GGX, divided by 4 n.l n.v (Heitz 2014).
fn masked(a2: f32, n_dot_l: f32, n_dot_v: f32) -> f32 {
    return 0.5 / (n_dot_l * sqrt(n_dot_v * n_dot_v * (1.0 - a2) + a2)
        + n_dot_v * sqrt(n_dot_l * n_dot_l * (1.0 - a2) + a2));
}

// BRDF for a light in direction `l`.
fn lobe_towards(g: Gloss, n: vec3f, v: vec3f, l: vec3f) -> vec3f {
    let n_dot_l = max(dot(n, l), 0.0);
    if PHONG && g.phong {
        let e = exp2(14.0 * g.parameter) - 1.0;
        let along = max(dot(reflect(-v, n), l), 0.0);
        let lobe = select(0.0, exp2(e * log2(max(along, 1e-20))), along > 0.0);
        return g.f0 * (lobe * (e + 2.0) * (0.5 / 3.14159265));
    }
    // The reflection of a point light in a mirror is a point; this blur keeps it from flickering.
    let alpha = max(g.width, 0.01);
    let a2 = alpha * alpha;
    let n_dot_v = max(dot(n, v), 1e-3);
    let h = normalize(l + v);
    let n_dot_h = max(dot(n, h), 0.0);
    let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
    let distribution = a2 / (3.14159265 * d * d);
    let masking = masked(a2, n_dot_l, n_dot_v);
    let fresnel = g.f0 + (vec3f(g.f90) - g.f0) * pow(1.0 - clamp(dot(v, h), 0.0, 1.0), 5.0);
    return fresnel * (distribution * masking);
}
