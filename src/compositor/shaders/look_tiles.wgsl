// Marks the tiles of the finished picture: 2 where virtual objects may be, 1 where they may only have
// changed the light, 0 for others.

@group(0) @binding(0) var phantom_tiles: texture_2d<u32>;
@group(0) @binding(1) var covered_tiles: texture_2d<u32>;
// Position of each pixel in the undistorted picture, for a lens with distortion.
@group(0) @binding(2) var positions: texture_2d<f32>;

const SIDE = 32;

fn class_of(tile: vec2i) -> u32 {
    let shadowed = any(textureLoad(phantom_tiles, tile, 0).xy != vec2u(0u));
    let covered = textureLoad(covered_tiles, tile, 0).x != 0u;
    return select(select(0u, 1u, shadowed), 2u, covered);
}

// The highest class of the tiles of the undistorted picture that a tile of the distorted one shows:
// those in the box around the positions of nine of its pixels.
fn class_of_undistorted(tile: vec2i) -> u32 {
    let last = vec2i(textureDimensions(positions)) - vec2i(1);
    var low = vec2f(1e6);
    var high = vec2f(-1e6);
    for (var k = 0; k < 9; k++) {
        let pixel = min((2 * tile + vec2i(k % 3, k / 3)) * (SIDE / 2), last);
        let at = textureLoad(positions, pixel, 0).xy;
        low = select(low, min(low, at), at.x > -1e5);
        high = select(high, max(high, at), at.x > -1e5);
    }
    // The lens may bulge a little between the nine pixels.
    let grid = vec2i(textureDimensions(covered_tiles)) - vec2i(1);
    let first = clamp(vec2i(floor((low - vec2f(3.0)) / f32(SIDE))), vec2i(0), grid);
    let end = clamp(vec2i(floor((high + vec2f(3.0)) / f32(SIDE))), vec2i(-1), grid);
    let count = max(end - first + vec2i(1), vec2i(0));
    var highest = 0u;
    for (var k = 0; k < count.x * count.y; k++) {
        highest = max(highest, class_of(first + vec2i(k % count.x, k / count.x)));
    }
    return highest;
}

@fragment
fn mark(@builtin(position) position: vec4f) -> @location(0) vec4u {
    let tile = vec2i(position.xy);
    if DISTORTED {
        return vec4u(class_of_undistorted(tile));
    }
    return vec4u(class_of(tile));
}
