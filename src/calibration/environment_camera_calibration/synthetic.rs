//! Synthetic pictures for tests, with given light and noise.

use super::super::intrinsics::Grey;
use super::rays::RandomIndices;
use glam::DVec2;

/// Renders a picture whose linear light (0 to 1) at a point is `light`, averaged over 3×3 points per
/// pixel, with noise in codes; returns it encoded by a square root, and in linear light (0 to 255).
pub fn render(size: (usize, usize), noise: f64, light: impl Fn(DVec2) -> f64) -> (Grey, Grey) {
    let mut random = RandomIndices::new();
    let mut normal = move || {
        (0..12)
            .map(|_| random.below(1 << 20) as f64 / f64::from(1 << 20))
            .sum::<f64>()
            - 6.0
    };
    let (mut codes, mut linear) = (Vec::new(), Vec::new());
    for i in 0..size.0 * size.1 {
        let p = DVec2::new((i % size.0) as f64, (i / size.0) as f64);
        let sub = |k: usize| DVec2::new((k % 3) as f64 - 1.0, (k / 3) as f64 - 1.0) / 3.0;
        let mean = (0..9).map(|k| light(p + sub(k))).sum::<f64>() / 9.0;
        let code = (255.0 * mean.clamp(0.0, 1.0).sqrt() + noise * normal())
            .round()
            .clamp(0.0, 255.0);
        codes.push(code as f32);
        linear.push((code * code / 255.0) as f32);
    }
    let grey = |data| Grey {
        width: size.0,
        height: size.1,
        data,
    };
    (grey(codes), grey(linear))
}

/// Linear light of a room: two windows and a wall with a seam.
pub fn room(p: DVec2) -> f64 {
    let window = |x: f64, y: f64| (p.x - x).abs() < 22.0 && (p.y - y).abs() < 30.0;
    match () {
        () if window(150.0, 120.0) || window(330.0, 300.0) => 0.9,
        () if p.x + 0.3 * p.y > 260.0 => 0.10,
        () => 0.05,
    }
}
