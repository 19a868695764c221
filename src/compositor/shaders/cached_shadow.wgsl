// Light that surfaces lose, from the surface cache: the shadow buffer without a light's own look-up.

// Tiles in which real surfaces may lose some light.
@vertex
fn shadowed_tile(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
    let across = textureDimensions(phantom_tiles).x;
    let t = v / 6u;
    let tile = vec2u(t % across, t / across);
    let shadowed = any(textureLoad(phantom_tiles, tile, 0).xy != vec2u(0u));
    return tile_corner(v % 6u, tile, MARK, shadowed);
}

@fragment
fn phantom_shadow(@builtin(position) at: vec4f) -> @location(0) vec4f {
    let pixel = vec2i(at.xy);
    let surface = textureLoad(phantom_normal, pixel, 0);
    var place = vec2u(0u);
    IF_CACHED place = textureLoad(phantom_place, pixel, 0).xy;
    let n = normal_from_octahedron(surface.xy);
    let uv = cache_uv(place);
    let lost = textureSampleLevel(cache_first, table_sampler, uv, 0.0).rgb * frame.params.x;
    let kept = textureSampleLevel(cache_second, table_sampler, uv, 0.0);
    var added = vec3f(0.0);
    var open = vec4f(1.0);
    if LAMPED {
        let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
        added = multiplied_lamps(lamps_at(phantom_lamps, pixel), world, n);
        open = vec4f(open_in_real(world, n), 1.0);
    }
    let there = place.x != 0u;
    let arriving = select(open, kept, there);
    let change = change_of_picture(select(vec3f(0.0), lost, there), arriving.rgb, added, n);
    let unshadowed = vec4f(vec3f(select(1.0, 0.0, frame.counts.y == 1u)), 0.0);
    let found = vec4f(change, key_with_share(surface.w, arriving.a));
    return select(unshadowed, found, surface.z == 1.0);
}

// Irradiance from lamps alone; the rest is in the cache.
@fragment
fn virtual_light(@builtin(position) position: vec4f) -> @location(0) vec4u {
    let found = covered_sample(vec2i(position.xy));
    let n = normal_from_octahedron(octahedron(textureLoad(virtual_shape, found.xy, found.z)));
    let depth = textureLoad(virtual_depth, found.xy, found.z);
    let world = world_at(sample_position(found.xy, found.z), depth);
    let lamps = lamp_irradiance(lamps_at(virtual_lamps, found.xy), world, n);
    return packed_light(lamps, frame.eye.w / depth, n);
}
