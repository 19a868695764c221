// Specular reflection of compact sources that mip levels of the radiance map leave out, by
// evaluating the BRDF. Twin of `penumbra_lighting::compact_source_specular::reflected`.

struct CompactSource {
    // w = radius of the source's disc, radians.
    direction: vec4f,
    // Irradiance on a surface facing the source.
    flux: vec4f,
    // Leads to it from a point, as in `NearLight`; w = 0 for a distant source.
    place: vec4f,
    // Fraction of the flux that mip levels 0 to 7 leave out.
    weights: array<vec4f, 2>,
}

struct CompactSources {
    // x: number of sources.
    count: vec4u,
    each: array<CompactSource, MAX_COMPACT_SOURCES>,
}

@group(3) @binding(5) var<uniform> compact_sources: CompactSources;

// Widens the lobe by a source's disc, so that its peak is the mean over the disc.
fn widened_by_disc(g: Gloss, v: vec3f, l: vec3f, radius: f32) -> Gloss {
    var wide = g;
    let r2 = radius * radius * 0.25;
    if PHONG && g.phong {
        let e = exp2(14.0 * g.parameter) - 1.0;
        // Smaller discs do not widen the lobe.
        let x = 2.0 * e * r2;
        let narrower = select(e, (1.0 - exp(-x)) / (2.0 * r2), x > 1e-3);
        wide.parameter = log2(narrower + 1.0) / 14.0;
        return wide;
    }
    // Half vectors of a disc: half as far apart, and wider perpendicular to the plane of incidence.
    let v_dot_h2 = max(0.5 + 0.5 * dot(v, l), 0.01);
    let a2 = g.width * g.width;
    wide.width = sqrt(sqrt((a2 + r2) * (a2 + r2 / v_dot_h2)));
    return wide;
}

// BRDF towards a disc: that of the widened lobe, or the disc itself in a mirror.
fn lobe_towards_disc(g: Gloss, n: vec3f, v: vec3f, l: vec3f, radius: f32) -> vec3f {
    let wide = lobe_towards(widened_by_disc(g, v, l, radius), n, v, l);
    // Twin of `mirrored_disc`.
    let lobe = 2.0 * max(g.width, 0.01);
    let sharp = 1.0 - smoothstep(0.25, 0.75, lobe / max(radius, 1e-6));
    if (PHONG && g.phong) || sharp <= 0.0 {
        return wide;
    }
    let edge = max(lobe, 0.25 * radius);
    let apart = distance(reflect(-v, n), l);
    let shown = 1.0 - smoothstep(radius - edge, radius + edge, apart);
    let fresnel = g.f0 + (vec3f(g.f90) - g.f0) * pow(1.0 - clamp(dot(v, n), 0.0, 1.0), 5.0);
    let area = 3.14159265 * (radius * radius + 0.2 * edge * edge);
    return mix(wide, fresnel * (shown / (area * max(dot(n, l), 1e-3))), sharp);
}

// Radiance that a surface reflects from compact sources; `level` is the mip level of its map.
fn compact_source_specular(world: vec3f, n: vec3f, v: vec3f, gloss: Gloss, level: f32) -> vec3f {
    let off = vec4f(level) - vec4f(0.0, 1.0, 2.0, 3.0);
    let low = max(vec4f(1.0) - abs(off), vec4f(0.0));
    let high = max(vec4f(1.0) - abs(off - vec4f(4.0)), vec4f(0.0));
    var sum = vec3f(0.0);
    let count = non_uniform(compact_sources.count.x, level);
    if count == 0u {
        return sum;
    }
    // The loop tests its condition at the end: software drivers would otherwise run its body once
    // more.
    var k = 0u;
    loop {
        let towards = compact_sources.each[k].place.xyz - compact_sources.each[k].place.w * world;
        let near = inverseSqrt(max(dot(towards, towards), 0.0025));
        let l = towards * near;
        let weight = dot(low, compact_sources.each[k].weights[0]) + dot(high, compact_sources.each[k].weights[1]);
        let light = compact_sources.each[k].flux.rgb * (max(dot(n, l), 0.0) * weight * near * near);
        let radius = compact_sources.each[k].direction.w * near;
        sum += lobe_towards_disc(gloss, n, v, l, radius) * light;
        continuing {
            k += 1u;
            break if k >= count;
        }
    }
    return sum;
}
