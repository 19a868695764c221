// Finds the tiles of the picture in which an edge of the real scene may separate pixels of
// different shadow: only there is the composite clamped to both sides' values.

@group(1) @binding(0) var shadow: texture_2d<f32>;
@group(1) @binding(1) var phantom_tiles: texture_2d<u32>;
@group(1) @binding(2) var covered_tiles: texture_2d<u32>;

// One fragment for the upper or the lower half of a tile. Every other texel is looked at, in a
// pattern that leaves out no row and no column.
@fragment
fn find_edges(@builtin(position) at: vec4f) -> @location(0) u32 {
    let half_tile = vec2i(at.xy);
    let tile = vec2u(vec2i(half_tile.x, half_tile.y >> 1u));
    let shadowed = any(textureLoad(phantom_tiles, tile, 0).xy != vec2u(0u));
    let side = i32(non_uniform(frame.tiling.y, at.w));
    let last = vec2i(textureDimensions(shadow)) - vec2i(1);
    let margin = i32(EDGE_ERROR);
    let corner = half_tile * vec2i(side, side >> 1u) - margin;
    let wanted = shadowed | tile_is_covered(tile);
    let rows = select(0, ((side >> 1u) + 2 * margin + 1) >> 1u, wanted);
    let columns = (side + 2 * margin + 1) >> 1u;
    let first = textureLoad(shadow, clamp(corner, vec2i(0), last), 0);
    var low = first.rgb;
    var high = first.rgb;
    var levels = vec2f(1e9, -1e9);
    var other_key = false;
    for (var j = 0; j < rows; j++) {
        for (var i = 0; i < columns; i++) {
            let texel = corner + vec2i(2 * i + (j & 1), 2 * j + (i & 1));
            let there = textureLoad(shadow, clamp(texel, vec2i(0), last), 0);
            let key = key_of(there.a);
            let level = share_level(there.a);
            low = min(low, there.rgb);
            high = max(high, there.rgb);
            levels = select(levels, vec2f(min(levels.x, level), max(levels.y, level)), level > 0.0);
            other_key |= key != key_of(first.a);
        }
    }
    let differs = any(high - low > vec3f(EDGE_CONTRAST));
    return select(0u, 1u, differs & (other_key | (levels.y - levels.x > 1.0)));
}
