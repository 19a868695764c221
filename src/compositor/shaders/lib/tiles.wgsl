// Tiles of the picture in which a pass has work; the others are not drawn. Software drivers run
// both sides of every branch, so only skipping pixels saves time.

// One byte per tile: 0 where nothing virtual can be.
fn tile_is_covered(tile: vec2u) -> bool {
    return textureLoad(covered_tiles, tile, 0).x != 0u;
}

// The tile that contains a pixel of the picture.
fn tile_of(pixel: vec2i) -> vec2u {
    return vec2u(pixel) >> vec2u(frame.tiling.w);
}

// Corner `v` (0..5) of a tile at `depth`; outside the clip volume unless `visible`.
fn tile_corner(v: u32, tile: vec2u, depth: f32, visible: bool) -> vec4f {
    let o = vec2u(select(0u, 1u, v == 1u || v == 2u || v == 4u), select(0u, 1u, v >= 2u && v != 3u));
    let pixel = vec2f(tile + o) * f32(frame.tiling.y);
    let ndc = vec2f(pixel.x / frame.size.x * 2.0 - 1.0, 1.0 - pixel.y / frame.size.y * 2.0);
    return select(vec4f(2.0, 2.0, 2.0, 1.0), vec4f(ndc, depth, 1.0), visible);
}
