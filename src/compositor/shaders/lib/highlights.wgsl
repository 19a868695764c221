// The lobe for specular reflection of rectangles: `scale` times the integral over the round lobe
// about `d`. It is a cosine lobe narrowed to `s` times its width (Heitz et al. 2016), for which
// Lambert's formula holds after widening the rectangle by 1 / `s`.
struct RoundLobe {
    scale: vec3f,
    d: vec3f,
    s: f32,
}

// `s` matches GGX's mean cosine; for Phong's lobe, which has no tails, half of the light within the
// same angle.
fn round_lobe(gloss: Gloss, scale: vec3f, d: vec3f) -> RoundLobe {
    let w = gloss.width;
    let ggx = 2.09 * w / (1.0 + 0.82 * w * w);
    let phong = 1.18 * w / (1.0 + 0.18 * w * w);
    return RoundLobe(scale, d, select(ggx, phong, gloss.phong));
}

// Radiance that a surface reflects from one lamp, by the lobe for which its map is prefiltered.
fn highlight_of_lamp(k: u32, world: vec3f, n: vec3f, v: vec3f, gloss: Gloss) -> vec3f {
    let ray = lamp_ray(k, world);
    let n_dot_l = max(dot(n, ray.to), 0.0);
    let seen = mix(1.0, lamp_visibility(k, world, n), frame.params.x);
    return lobe_towards(gloss, n, v, ray.to) * ray.facing * (n_dot_l * seen);
}

// The same for all lamps of a tile's mask; the loop is as in `lamp_irradiance`.
fn lamp_highlights(mask: u32, world: vec3f, n: vec3f, v: vec3f, gloss: Gloss, lobe: RoundLobe) -> vec3f {
    if !LAMPED {
        return vec3f(0.0);
    }
    var sum = vec3f(0.0);
    var left = mask & ~lamps.count.y;
    loop {
        let weight = select(0.0, 1.0, left != 0u);
        sum += highlight_of_lamp(first_lamp(left), world, n, v, gloss) * weight;
        left &= left - 1u;
        continuing {
            break if left == 0u;
        }
    }
    if !AREAS {
        return sum;
    }
    left = mask & lamps.count.y;
    loop {
        let weight = select(0.0, 1.0, left != 0u);
        sum += lobe.scale * highlight_of_area(first_lamp(left), world, n, lobe) * weight;
        left &= left - 1u;
        continuing {
            break if left == 0u;
        }
    }
    return sum;
}

fn widened(v: vec3f, lobe: RoundLobe) -> vec3f {
    let along = lobe.d * dot(v, lobe.d);
    return along + (v - along) / lobe.s;
}

// Mean radiance in the lobe from one rectangular lamp.
fn highlight_of_area(k: u32, world: vec3f, n: vec3f, lobe: RoundLobe) -> vec3f {
    let r = rectangle_of(k);
    let to = r.centre - world;
    let a = to - r.right - r.up;
    let b = to + r.right - r.up;
    let c = to + r.right + r.up;
    let d = to - r.right + r.up;
    let share = form_factor(widened(a, lobe), widened(b, lobe), widened(c, lobe), widened(d, lobe), lobe.d);
    // Fraction of the rectangle above the surface, from the heights of its corners.
    let high = vec4f(dot(n, a), dot(n, b), dot(n, c), dot(n, d));
    let highest = max(max(high.x, high.y), max(high.z, high.w));
    let lowest = min(min(high.x, high.y), min(high.z, high.w));
    let above = clamp(highest / max(highest - lowest, 1e-9), 0.0, 1.0);
    // Where the lobe's axis meets the rectangle's plane, and the lobe's width there.
    let towards = dot(lobe.d, r.normal);
    let away = clamp(dot(to, r.normal) / select(min(towards, -0.05), max(towards, 0.05), towards > 0.0), 0.0, 1e3);
    let off = lobe.d * away - to;
    let at = vec2f(dot(off, r.right) / dot(r.right, r.right), -dot(off, r.up) / dot(r.up, r.up));
    let texel = 2.0 * min(length(r.right), length(r.up)) / f32(textureDimensions(lamp_screens).x);
    let level = log2(max(lobe.s * max(away, length(to)) / texel, 1.0));
    let layer = i32(lamps.each[k].half_right.w);
    let uv = clamp(0.5 + 0.5 * at, vec2f(0.0), vec2f(1.0));
    let colour = textureSampleLevel(lamp_screens, table_sampler, uv, layer, level).rgb;
    let seen = mix(1.0, area_seen(k, r, world, n), frame.params.x);
    let radiance = lamps.each[k].intensity.rgb * colour / r.size;
    return select(vec3f(0.0), radiance * (share * above * seen), shines_towards(k, -to));
}
