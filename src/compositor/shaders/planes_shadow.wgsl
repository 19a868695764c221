// Light that surfaces lose, from the sums of basis images: the shadow buffer by shadowing planes.
// P' = P · Isum / Asum per channel (Kakuta 2004, eq. 6), where phantoms already shadow the light of
// the picture itself:
//
//   R = E_dome · (Ireal − Iall) / Asum      the light that virtual casters block
//   E = E_open − E_dome · (1 − Ireal / Asum)   the light that arrives in the real scene

@fragment
fn phantom_shadow(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(at.xy);
    let surface = textureLoad(phantom_normal, pixel, 0);
    let n = normal_from_octahedron(surface.xy);
    let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
    let shares = real_shares(world, n);
    let dome = by_normal(irradiance_of_lights, n);
    // Minus the indirect light from virtual objects.
    let kept = dome * max(shares.real - shares.all, vec3f(0.0));
    let lost = (kept - indirect_on_real(CHANGE, world, n)) * frame.params.x;
    let added = multiplied_lamps(lamps_at(phantom_lamps, pixel), world, n);
    let open = open_in_real(world, n);
    let arriving = max(open - dome * (1.0 - shares.real), lost);
    let share = arriving.g / max(open.g, 1e-6);
    return vec4f(change_of_picture(lost, arriving, added, n), key_with_share(surface.w, share));
}

// Texels of the light buffer: irradiance, depth along the view and normal, packed.
@fragment
fn virtual_light(@builtin(position) position: vec4f) -> @location(0) vec4u {
    let found = covered_sample(vec2i(position.xy));
    let n = normal_from_octahedron(octahedron(textureLoad(virtual_shape, found.xy, found.z)));
    let depth = textureLoad(virtual_depth, found.xy, found.z);
    let world = world_at(sample_position(found.xy, found.z), depth);
    var remaining = sky_irradiance(n) + by_normal(irradiance_of_compact, n);
    remaining -= by_normal(irradiance_of_lights, n) * (1.0 - virtual_share(world, n));
    remaining += indirect_light_on_virtual(world, n).rgb;
    remaining += lamp_irradiance(lamps_at(virtual_lamps, found.xy), world, n);
    return packed_light(max(remaining, vec3f(0.0)), frame.eye.w / depth, n);
}
