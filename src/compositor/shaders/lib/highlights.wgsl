// Radiance that a surface mirrors of one lamp, by the lobe that its map is prefiltered for.
fn highlight_of_lamp(k: u32, world: vec3f, n: vec3f, v: vec3f, gloss: Gloss) -> vec3f {
    let ray = lamp_ray(k, world);
    let n_dot_l = max(dot(n, ray.to), 0.0);
    let seen = mix(1.0, lamp_visibility(k, world, n, n_dot_l), frame.params.x);
    return lobe_towards(gloss, n, v, ray.to) * ray.facing * (n_dot_l * seen);
}

// The same of all lamps of a tile's mask; the loop is as in `lamp_irradiance`.
fn lamp_highlights(mask: u32, world: vec3f, n: vec3f, v: vec3f, gloss: Gloss) -> vec3f {
    if !LAMPED {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    var left = mask;
    loop {
        let weight = select(0.0, 1.0, left != 0u);
        sum += highlight_of_lamp(first_lamp(left), world, n, v, gloss) * weight;
        left &= left - 1u;
        continuing {
            break if left == 0u;
        }
    }
    return sum;
}
