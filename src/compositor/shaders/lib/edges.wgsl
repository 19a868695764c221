// Pixels along edges of the real scene: outlines and creases of phantoms, and the rims of real
// shadows. The camera mixes both sides there, and a proxy or a pose is never exact to the pixel, so
// a pixel may be assigned to the wrong side: sunlit paving keeps its sunlight, or paving in shadow
// loses its sunlight twice. Such pixels are divided between both sides by their colour.

// Maximum error of the proxies' edges, picture pixels.
const EDGE_ERROR = 3.0;
// Difference of shadow across an edge from which on it matters.
const EDGE_CONTRAST = 0.15;
// Contrast of the picture between both sides (difference over sum) below which the sides cannot be
// told apart in a pixel, and from which on they can.
const EDGE_KNOWN = vec2f(0.05, 0.15);
// Texture as a share of the difference between both sides up to which a pixel shows how it is mixed,
// and from which on it does not: standard deviation on both sides, and the distance of the pixel's
// colour from the line between theirs.
const EDGE_TEXTURE = vec2f(0.25, 0.5);
// Levels to which the light share beside a surface's key is quantised.
const SHARE_LEVELS = 7.0;

// Eight directions around a pixel.
fn around(k: i32) -> vec2f {
    let angle = 0.785398163 * f32(k);
    return vec2f(cos(angle), sin(angle));
}

// Packs a surface's key and the fraction of the unshadowed light that arrives on it in the real
// scene into one integer up to 2039; `share` < 0 if the fraction is unknown.
fn key_with_share(key: f32, share: f32) -> f32 {
    return key * 8.0 + select(1.0 + round(clamp(share, 0.0, 1.0) * (SHARE_LEVELS - 1.0)), 0.0, share < 0.0);
}

fn key_of(packed: f32) -> f32 {
    return floor(packed / 8.0);
}

// The light share beside a surface's key, from 1 to SHARE_LEVELS; 0 if it is unknown.
fn share_level(packed: f32) -> f32 {
    return packed - 8.0 * key_of(packed);
}

// Whether a real edge separates two texels of the shadow buffer: they lie on different surfaces, or
// only one of them is in real shadow.
fn real_edge(a: f32, b: f32) -> bool {
    let level = vec2f(share_level(a), share_level(b));
    let known = all(level > vec2f(0.0));
    return (key_of(a) != key_of(b)) | (known & (abs(level.x - level.y) > 1.0));
}
