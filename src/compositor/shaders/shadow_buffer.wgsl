// The shadow buffer (Supan 2006, eq. 3), for both layers of the picture.
//
//   R = Σ C_i · N·L_i · (1 − S_i)        the light that virtual casters block
//   E = Σ C_i · N·L_i · S_i(phantoms)    the light that arrives in the real scene
//
// On phantoms the result is the factor (E − R) / E, or R / π for the paper's own subtraction; on
// virtual objects it is the remaining irradiance.

const NO_LIGHT = 0xffffffffu;

// Iterates over the lights of a mask of 64 bits, each of which stands for `tiling.x` lights.
struct LightCursor {
    mask: vec2u,
    // The current light; NO_LIGHT past the last.
    light: u32,
    // End of this bit's lights.
    end: u32,
}

fn first_light(mask: vec2u) -> LightCursor {
    return next_light(LightCursor(mask, 0u, 0u));
}

fn next_light(w: LightCursor) -> LightCursor {
    let within = w.light + 1u;
    if within < w.end {
        return LightCursor(w.mask, within, w.end);
    }
    let low = w.mask.x != 0u;
    let word = select(w.mask.y, w.mask.x, low);
    // Index of the lowest set bit, from a float's exponent.
    let lowest = word & (~word + 1u);
    let exponent = (bitcast<u32>(f32(bitcast<i32>(lowest))) >> 23u) & 255u;
    let bit = exponent - 127u + select(32u, 0u, low);
    let rest = word & (word - 1u);
    let mask = select(vec2u(0u, rest), vec2u(rest, w.mask.y), low);
    let light = bit * frame.tiling.x;
    // A tile may be drawn for another reason than a light: its bits may stand for no light.
    if word == 0u || light >= frame.counts.x {
        return LightCursor(mask, NO_LIGHT, 0u);
    }
    return LightCursor(mask, light, min(light + frame.tiling.x, frame.counts.x));
}

// What the irradiance of light `i` is multiplied by on a surface; 0 for no light.
fn facing(i: u32, world: vec3f, n: vec3f) -> f32 {
    return select(0.0, facing_light(towards_light(i, world), n), i != NO_LIGHT);
}

// Software drivers run a loop's body once more than needed unless its condition is at its end; so
// these loops test at the end, are not nested, and run once with a light of weight 0 if a mask is
// empty.
fn lost_behind_virtual(masks: vec4u, world: vec3f, n: vec3f) -> vec3f {
    var lost = vec3f(0.0);
    var at = first_light(masks.xy & ~masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, world, n);
        let blocked = 1.0 - virtual_visibility(i, world, n, 0.0);
        lost += lights[i].irradiance.rgb * (n_dot_l * blocked);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    at = first_light(masks.xy & masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, world, n);
        let blocked = 1.0 - virtual_visibility(i, world, n, 0.0);
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
        let n_dot_l = facing(i, world, n);
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
    let pixel = vec2i(at.xy);
    let surface = textureLoad(phantom_normal, pixel, 0);
    let masks = textureLoad(phantom_tiles, tile_of(pixel), 0);
    let n = normal_from_octahedron(surface.xy);
    let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
    // Minus the indirect light from virtual objects.
    let lost = (lost_behind_virtual(masks, world, n) - indirect_on_real(CHANGE, world, n)) * frame.params.x;
    let added = multiplied_lamps(lamps_at(phantom_lamps, pixel), world, n);
    let open = open_in_real(world, n) + near_irradiance(world, n);
    let arriving = max(arriving_in_real(open, masks, world, n), lost);
    let share = arriving.g / max(open.g, 1e-6);
    return vec4f(change_of_picture(lost, arriving, added, n), key_with_share(surface.w, share));
}

// Interreflection between surfaces of one colour that hide the sky from each other: more light
// arrives than the open share indicates (Jimenez et al. 2016, eq. 10).
fn with_bounces(open_share: vec3f, albedo: vec3f) -> vec3f {
    let a = 2.0404 * albedo - 0.3324;
    let b = -4.7951 * albedo + 0.6417;
    let c = 2.7552 * albedo + 0.6903;
    return max(open_share, ((open_share * a + b) * open_share + c) * open_share);
}

// Texels of the light buffer: irradiance, depth along the view and normal, packed.
@fragment
fn virtual_light(@builtin(position) position: vec4f) -> @location(0) vec4u {
    let found = covered_sample(vec2i(position.xy));
    let shape = textureLoad(virtual_shape, found.xy, found.z);
    let n = normal_from_octahedron(octahedron(shape));
    let depth = textureLoad(virtual_depth, found.xy, found.z);
    let world = world_at(sample_position(found.xy, found.z), depth);
    // The sky's polynomial contains the cells but not the compact sources.
    var remaining = sky_irradiance(n) + by_normal(irradiance_of_compact, n) + near_irradiance(world, n);
    let cells = by_normal(irradiance_of_lights, n) - by_normal(irradiance_of_compact, n);
    var hidden = vec3f(0.0);
    // Few lights reach phantoms; the others need no look-up of the phantoms' shadow maps.
    let masks = textureLoad(virtual_tiles, tile_of(found.xy), 0);
    var at = first_light(masks.xy & ~masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, world, n);
        let hides = lights[i].irradiance.rgb * (n_dot_l * (1.0 - virtual_visibility(i, world, n, 1.0)));
        remaining -= hides;
        hidden += hides * (1.0 - lights[i].irradiance.w);
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    at = first_light(masks.zw);
    loop {
        let i = at.light;
        let n_dot_l = facing(i, world, n);
        let open = virtual_visibility(i, world, n, 1.0);
        let seen = open * phantom_visibility(i, world, n, 0.0);
        remaining -= lights[i].irradiance.rgb * (n_dot_l * (1.0 - seen));
        hidden += lights[i].irradiance.rgb * (n_dot_l * (1.0 - open) * (1.0 - lights[i].irradiance.w));
        continuing {
            at = next_light(at);
            break if at.light == NO_LIGHT;
        }
    }
    let albedo = base_colour(shape);
    let open_share = clamp(1.0 - hidden / max(cells, vec3f(1e-6)), vec3f(0.0), vec3f(1.0));
    let indirect = indirect_light_on_virtual(world, n);
    remaining += cells * (with_bounces(open_share, albedo) - open_share) * (1.0 - indirect.w) + indirect.rgb;
    remaining += lamp_irradiance(lamps_at(virtual_lamps, found.xy), world, n);
    return packed_light(max(remaining, vec3f(0.0)), frame.eye.w / depth, n);
}
