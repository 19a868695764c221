// What the passes of the camera's look share.

// Twin of `look::uniform::LookUniform`.
struct Look {
    // Width and height of the picture, and their reciprocals.
    size: vec4f,
    // Pixels beyond the marked tiles that a pass fills: layers, blur, spread, finish.
    reach: vec4f,
    // Weights of the point spread: pixel, neighbour, next neighbour, each way.
    across: vec4f,
    down: vec4f,
    // The same without sharpening, for shadows.
    soft_across: vec4f,
    soft_down: vec4f,
    // Variance of the noise: read, and per linear value; w of the first = factor of the exposure.
    read: vec4f,
    shot: vec4f,
    // Where the tile of noise begins; then the lowest class of tiles whose layers are filtered.
    grain: vec4u,
    // Samples of a blur: position along the motion, position in the circle of confusion (x, y).
    taps: array<vec4f, MAX_TAPS>,
}

@group(0) @binding(0) var<uniform> look: Look;
// Class of each tile of the picture: 2 where virtual objects may be, 1 where they may only have
// changed the light, 0 for others.
@group(0) @binding(1) var marked: texture_2d<u32>;

const SIDE = 32;

fn class_at(tile: vec2i) -> u32 {
    let inside = all(tile >= vec2i(0)) & all(tile < vec2i(textureDimensions(marked)));
    let at = clamp(tile, vec2i(0), vec2i(textureDimensions(marked)) - vec2i(1));
    return select(0u, textureLoad(marked, at, 0).x, inside);
}

fn is_unmarked(tile: vec2i) -> f32 {
    return select(1.0, 0.0, class_at(tile) >= look.grain.z);
}

fn tile_of_vertex(v: u32) -> vec2i {
    let across = textureDimensions(marked).x;
    let t = v / 6u;
    return vec2i(vec2u(t % across, t / across));
}

fn corner_of(v: u32) -> vec2f {
    let k = v % 6u;
    return vec2f(vec2u(select(0u, 1u, k == 1u || k == 2u || k == 4u), select(0u, 1u, k >= 2u && k != 3u)));
}

fn clip_at(pixel: vec2f, visible: bool) -> vec4f {
    let ndc = pixel * look.size.zw * vec2f(2.0, -2.0) + vec2f(-1.0, 1.0);
    return select(vec4f(2.0, 2.0, 2.0, 1.0), vec4f(ndc, 0.5, 1.0), visible);
}

// Corner of a tile whose layers are not filtered, although its light may have changed.
fn unfiltered_corner(v: u32) -> vec4f {
    let tile = tile_of_vertex(v);
    let own = class_at(tile);
    return clip_at((vec2f(tile) + corner_of(v)) * f32(SIDE), (own != 0u) & (own < look.grain.z));
}

// Corner of a tile whose layers are filtered, `reach` pixels larger on sides without such a neighbour.
fn look_corner(v: u32, reach: f32) -> vec4f {
    let tile = tile_of_vertex(v);
    let before = vec2f(is_unmarked(tile - vec2i(1, 0)), is_unmarked(tile - vec2i(0, 1)));
    let after = vec2f(is_unmarked(tile + vec2i(1, 0)), is_unmarked(tile + vec2i(0, 1)));
    let low = vec2f(tile * SIDE) - reach * before;
    let high = vec2f((tile + vec2i(1)) * SIDE) + reach * after;
    return clip_at(mix(low, high, corner_of(v)), is_unmarked(tile) < 0.5);
}

// The picture as two layers, which are filtered apart: the virtual surfaces, premultiplied by the
// share of the pixel that they cover, and the change of the real picture behind them, premultiplied
// by its weight.
struct Layers {
    @location(0) surface: vec4f,
    @location(1) change: vec4f,
}

// Light, linear, that is added to the real picture before its change is expressed as a ratio: the
// codes of dark pixels are too coarse for a ratio.
const DARK = 1.0 / 64.0;
