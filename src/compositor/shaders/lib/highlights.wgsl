// Radiance that a surface mirrors of the lamps, by the lobe that its map is prefiltered for.
fn lamp_highlights(world: vec3f, n: vec3f, v: vec3f, gloss: Gloss) -> vec3f {
    if !LAMPED {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    let count = decided_here(lamps.count.x, world.x);
    for (var k = 0u; k < count; k++) {
        let ray = lamp_ray(k, world);
        let n_dot_l = max(dot(n, ray.to), 0.0);
        let seen = mix(1.0, lamp_visibility(k, world, n, n_dot_l), frame.params.x);
        sum += lobe_towards(gloss, n, v, ray.to) * ray.facing * (n_dot_l * seen);
    }
    return sum;
}
