// Pixels along edges of the real scene: outlines and creases of phantoms, and the rims of
// real shadows. The camera mixes both sides there, and a proxy or a pose is never true to
// the pixel, so the side that a pixel is taken for may be the wrong one: sunlit paving
// keeps its sunlight, or paving in shadow loses its sunlight twice. What is shown there may
// therefore not leave the range of what is shown on both sides, a few pixels off, where the
// sides are certain (as temporal antialiasing clamps history to its neighbourhood; Karis
// 2014).

// How far the proxies' edges may be off, picture pixels.
const DOUBT = 3.0;
// Levels of light that reaches a real surface, told apart beside its key.
const SHARES = 7.0;

// Eight directions around a pixel.
fn around(k: i32) -> vec2f {
    let angle = 0.785398163 * f32(k);
    return vec2f(cos(angle), sin(angle));
}

// A surface's key and the share of the light without shadows that arrives on it in the real
// scene, in one whole number up to 2039; `share` < 0 where it is not known.
fn key_with_share(key: f32, share: f32) -> f32 {
    return key * 8.0 + select(1.0 + round(clamp(share, 0.0, 1.0) * (SHARES - 1.0)), 0.0, share < 0.0);
}

fn key_of(packed: f32) -> f32 {
    return floor(packed / 8.0);
}

// Whether two texels of the shadow buffer lie on either side of a real edge: other
// surfaces, or one of them in real shadow.
fn real_edge(a: f32, b: f32) -> bool {
    let level = vec2f(a, b) - 8.0 * vec2f(key_of(a), key_of(b));
    let known = all(level > vec2f(0.0));
    return (key_of(a) != key_of(b)) | (known & (abs(level.x - level.y) > 1.0));
}
