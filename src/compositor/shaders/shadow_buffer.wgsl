// The shadow buffer (Supan 2006, eq. 3), for both layers of the picture.
//
//   R = Σ C_i · N·L_i · (1 − S_i)        the light that virtual casters keep away
//   E = Σ C_i · N·L_i · S_i(phantoms)    the light that arrives in the real scene
//
// On phantoms the result is the factor (E − R) / E, or R / π for the paper's own
// subtraction; on virtual objects it is the irradiance that is left.

const NO_LIGHT = 0xffffffffu;

// A walk through the lights of a mask of 64 bits, each of which stands for `tiling.x`.
struct Walk {
    mask: vec2u,
    // The light it stands at, NO_LIGHT past the last.
    light: u32,
    // Where the lights of this bit end.
    end: u32,
}

fn first_light(mask: vec2u) -> Walk {
    return next_light(Walk(mask, 0u, 0u));
}

fn next_light(w: Walk) -> Walk {
    let within = w.light + 1u;
    if within < w.end {
        return Walk(w.mask, within, w.end);
    }
    let low = w.mask.x != 0u;
    let word = select(w.mask.y, w.mask.x, low);
    // Number of the lowest bit, by way of a float's exponent.
    let lowest = word & (~word + 1u);
    let exponent = (bitcast<u32>(f32(bitcast<i32>(lowest))) >> 23u) & 255u;
    let bit = exponent - 127u + select(32u, 0u, low);
    let rest = word & (word - 1u);
    let mask = select(vec2u(0u, rest), vec2u(rest, w.mask.y), low);
    let light = bit * frame.tiling.x;
    // A tile may be drawn for other reasons than a light: its bits may stand for none.
    if word == 0u || light >= frame.counts.x {
        return Walk(mask, NO_LIGHT, 0u);
    }
    return Walk(mask, light, min(light + frame.tiling.x, frame.counts.x));
}

// Cosine of light `i` on a surface; 0 for no light.
fn facing(i: u32, n: vec3f) -> f32 {
    return select(0.0, max(dot(n, lights[i].direction.xyz), 0.0), i != NO_LIGHT);
}

// Software drivers run a loop's body once more than it is gone through, with nothing to
// do, unless the condition stands at its end; so these loops end with it, are not nested,
// and go once through a light of no weight where a mask is empty.
fn lost_behind_virtual(masks: vec4u, world: vec3f, n: vec3f) -> vec3f {
    var lost = vec3f(0.0);
    var at = first_light(masks.xy & ~masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, n);
        let blocked = 1.0 - virtual_visibility(i, world, n, n_dot_l, 0.0);
        lost += lights[i].irradiance.rgb * (n_dot_l * blocked);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    at = first_light(masks.xy & masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, n);
        let blocked = 1.0 - virtual_visibility(i, world, n, n_dot_l, 0.0);
        let real = phantom_visibility(i, world, n, 1.0);
        lost += lights[i].irradiance.rgb * (n_dot_l * blocked * real);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    return lost;
}

fn arriving_in_real(open: vec3f, masks: vec4u, world: vec3f, n: vec3f) -> vec3f {
    var sum = open;
    var at = first_light(masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, n);
        let blocked = 1.0 - phantom_visibility(i, world, n, 1.0);
        sum -= lights[i].irradiance.rgb * (n_dot_l * blocked);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    return sum;
}

@fragment
fn phantom_shadow(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(at.xy) * i32(frame.counts.z);
    let unshadowed = vec3f(select(1.0, 0.0, frame.counts.y == 1u));
    let surface = textureLoad(phantom_normal, pixel, 0);
    let masks = textureLoad(phantom_tiles, tile_of(pixel), 0);
    let n = normal_from_octahedron(surface.xy);
    let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
    // Less the light that virtual objects throw back.
    let lost = (lost_behind_virtual(masks, world, n) - indirect_irradiance(0.0, world, n)) * frame.params.x;
    let added = multiplied_lamps(lamps_at(phantom_lamps, pixel), world, n);
    // At full resolution real shadows are wanted beside virtual ones, too.
    if !FINE & all(lost == vec3f(0.0)) & all(added == vec3f(0.0)) {
        return vec4f(unshadowed, key_with_share(surface.w, -1.0));
    }
    let open = open_in_real(world, n);
    let arriving = max(arriving_in_real(open, masks, world, n), lost);
    let share = arriving.g / max(open.g, 1e-6);
    return vec4f(change_of_picture(lost, arriving, added, n), key_with_share(surface.w, share));
}

// Light that surfaces of one colour throw at one another where they hide the sky from one
// another: more of it comes back than the open share says (Jimenez et al. 2016, eq. 10).
fn with_bounces(open_share: vec3f, albedo: vec3f) -> vec3f {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    return max(open_share, ((open_share * a + b) * open_share + c) * open_share);
}

// Texels of the light buffer: irradiance, depth along the view and normal, packed.
@fragment
fn virtual_light(@builtin(position) position: vec4f) -> @location(0) vec4u {
    let step = i32(decided_here(frame.counts.z, position.w));
    let found = covered_sample(vec2i(position.xy) * step, step);
    let shape = textureLoad(virtual_shape, found.xy, found.z);
    let n = normal_from_octahedron(octahedron(shape));
    let depth = textureLoad(virtual_depth, found.xy, found.z);
    let world = world_at(sample_place(found.xy, found.z), depth);
    // Compact sources are not in the sky's polynomial, cells are.
    var left = sky_irradiance(n) + by_normal(irradiance_of_compact, n);
    let cells = by_normal(irradiance_of_lights, n) - by_normal(irradiance_of_compact, n);
    var hidden = vec3f(0.0);
    // Lights that phantoms reach are few; the others are spared their shadow maps.
    let masks = textureLoad(virtual_tiles, tile_of(found.xy), 0);
    var at = first_light(masks.xy & ~masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, n);
        let hides = lights[i].irradiance.rgb * (n_dot_l * (1.0 - virtual_visibility(i, world, n, n_dot_l, 1.0)));
        left -= hides;
        hidden += hides * (1.0 - lights[i].irradiance.w);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    at = first_light(masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, n);
        let open = virtual_visibility(i, world, n, n_dot_l, 1.0);
        let seen = open * phantom_visibility(i, world, n, 0.0);
        left -= lights[i].irradiance.rgb * (n_dot_l * (1.0 - seen));
        hidden += lights[i].irradiance.rgb * (n_dot_l * (1.0 - open) * (1.0 - lights[i].irradiance.w));
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    let albedo = base_colour(shape);
    let open_share = clamp(1.0 - hidden / max(cells, vec3f(1e-6)), vec3f(0.0), vec3f(1.0));
    left += cells * (with_bounces(open_share, albedo) - open_share);
    left += indirect_irradiance(2.0, world, n);
    left += lamp_irradiance(lamps_at(virtual_lamps, found.xy), world, n);
    return packed_light(max(left, vec3f(0.0)), frame.eye.w / depth, n);
}
