// Light that surfaces lose, from the surface cache, with the light of lamps: the shadow buffer
// without a dome light's own look-up. Without lamps, `phantom_geometry` writes it.

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
    let world = world_at(vec2f(pixel), textureLoad(phantom_depth, pixel, 0));
    let added = multiplied_lamps(lamps_at(phantom_lamps, pixel), world, n);
    // Surfaces without a page lie far beyond the region of indirect light.
    let kept = kept_or(place, ground_irradiance(n) + by_normal(irradiance_of_lights, n));
    let change = change_of_picture(kept.lost, kept.arriving, added, n);
    return shadow_texel(change, kept.share, surface.w, surface.z == 1.0);
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
