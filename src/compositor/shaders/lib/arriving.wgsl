// What arrives on a surface besides the dome's shadows: light from the ground, from close by,
// and from the whole dome where nothing is in the way.

const PI = 3.14159265;

// Light of the lower hemisphere, which no dome light stands for where there is a ground.
fn ground_irradiance(n: vec3f) -> vec3f {
    return frame.params.z * frame.ground.rgb * (PI * 0.5 * (1.0 - n.z));
}

fn by_normal(table: texture_2d<f32>, n: vec3f) -> vec3f {
    let side = f32(textureDimensions(table).x);
    let uv = ((octahedron_from_normal(n) * 0.5 + 0.5) * (side - 1.0) + 0.5) / side;
    return textureSampleLevel(table, table_sampler, uv, 0.0).rgb;
}

fn indirect_facing(face: f32, at: vec3f) -> vec3f {
    let size = vec3f(textureDimensions(indirect_volume)) * vec3f(1.0 / 18.0, 1.0, 1.0);
    // Half a probe from the walls, so that neighbouring volumes do not mix.
    let inside = clamp(at, 0.5 / size, 1.0 - 0.5 / size);
    let uvw = vec3f((inside.x + face) / 18.0, inside.yz);
    return textureSampleLevel(indirect_volume, table_sampler, uvw, 0.0).rgb;
}

// Irradiance from close by: `kind` 0 = what virtual objects add, or, below zero, keep from
// things beside them; 1 = what phantoms throw where nothing is virtual, 2 = as things are.
fn indirect_irradiance(kind: f32, world: vec3f, n: vec3f) -> vec3f {
    let at = (world - frame.indirect_low.xyz) / (frame.indirect_high.xyz - frame.indirect_low.xyz);
    let margin = vec3f(0.0, 0.0, 0.02);
    if (frame.indirect_low.w == 0.0) | any(at < -margin) | any(at > vec3f(1.0)) {
        return vec3f(0.0);
    }
    if n.z > 0.99 && at.z < 0.02 {
        let half = 0.5 / f32(textureDimensions(indirect_ground).y);
        let uv = vec2f((clamp(at.x, half, 1.0 - half) + kind) / 3.0, at.y);
        return textureSampleLevel(indirect_ground, table_sampler, uv, 0.0).rgb;
    }
    let face = 6.0 * kind + select(vec3f(0.0, 2.0, 4.0), vec3f(1.0, 3.0, 5.0), n < vec3f(0.0));
    let w = n * n;
    // Half a probe off the surface: those behind it are inside of things, or look elsewhere.
    let off = at + 0.5 * n / (vec3f(textureDimensions(indirect_volume)) * vec3f(1.0 / 18.0, 1.0, 1.0));
    return w.x * indirect_facing(face.x, off) + w.y * indirect_facing(face.y, off) + w.z * indirect_facing(face.z, off);
}

// What arrives where no phantom shadows the point.
fn open_in_real(world: vec3f, n: vec3f) -> vec3f {
    return ground_irradiance(n) + by_normal(irradiance_of_lights, n) + indirect_irradiance(1.0, world, n);
}

// What the camera's picture is multiplied by (or, by the paper's eq. 4, what is taken off it)
// where `lost` of what is `arriving` is missing and lamps add `added`: (E - R + V) / E, and 1
// in a channel without light.
fn change_of_picture(lost: vec3f, arriving: vec3f, added: vec3f, n: vec3f) -> vec3f {
    // A shadow that the light says is black, and the picture says is not, would glow.
    var least = vec3f(1e-6);
    if LAMPED {
        least = max(0.05 * by_normal(irradiance_of_lights, n), vec3f(1e-4));
    }
    let factor = vec3f(1.0) - lost / max(arriving, vec3f(1e-6)) + added / max(arriving, least);
    return select(factor, (lost - added) / PI, frame.counts.y == 1u);
}
