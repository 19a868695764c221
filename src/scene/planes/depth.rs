//! Visibility of fragments from a plane's camera, by a small depth image on the CPU.

use super::ShadowingPlane;
use super::surface::Fragment;
use glam::{DVec2, DVec3};

/// Side of the depth image, cells.
const CELLS: usize = 96;

/// Returns the fragments inside a plane's rectangle and depth that nothing hides from the plane.
pub(super) fn visible_from(plane: &ShadowingPlane, fragments: &[Fragment]) -> Vec<u32> {
    let view = View::new(plane);
    let mut nearest = vec![f64::INFINITY; CELLS * CELLS];
    for f in fragments {
        view.draw(f, &mut nearest);
    }
    let is_visible = |f: &Fragment| view.is_visible(f, &nearest);
    let all = fragments.iter().enumerate();
    all.filter(|(_, f)| is_visible(f))
        .map(|(i, _)| i as u32)
        .collect()
}

struct View<'a> {
    plane: &'a ShadowingPlane,
    normal: DVec3,
}

impl<'a> View<'a> {
    fn new(plane: &'a ShadowingPlane) -> Self {
        Self {
            plane,
            normal: plane.normal(),
        }
    }

    /// Position in the depth image (cells right and up from the rectangle's corner) and distance
    /// behind the plane, metres.
    fn project(&self, p: DVec3) -> (DVec2, f64) {
        let from = p - self.plane.centre;
        let flat = DVec2::new(from.dot(self.plane.right), from.dot(self.plane.up));
        let cell = (flat / self.plane.half_size + 1.0) / 2.0 * CELLS as f64;
        (cell, -from.dot(self.normal))
    }

    fn draw(&self, f: &Fragment, nearest: &mut [f64]) {
        let placed = f.corners.map(|p| self.project(p));
        let min = placed.iter().fold(f64::INFINITY, |m, p| m.min(p.1));
        let max = placed.iter().fold(f64::NEG_INFINITY, |m, p| m.max(p.1));
        if max < 0.0 || min > self.plane.depth {
            return;
        }
        let [a, b, c] = placed;
        let double = (b.0 - a.0).perp_dot(c.0 - a.0);
        if double.abs() < 1e-12 {
            return;
        }
        let low = a.0.min(b.0).min(c.0).max(DVec2::ZERO).floor();
        let high =
            a.0.max(b.0)
                .max(c.0)
                .min(DVec2::splat(CELLS as f64 - 1.0))
                .floor();
        for y in low.y as i64..=high.y as i64 {
            for x in low.x as i64..=high.x as i64 {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let u = (p - a.0).perp_dot(c.0 - a.0) / double;
                let v = (b.0 - a.0).perp_dot(p - a.0) / double;
                if u < 0.0 || v < 0.0 || u + v > 1.0 {
                    continue;
                }
                let depth = a.1 + u * (b.1 - a.1) + v * (c.1 - a.1);
                if let Some(slot) = nearest.get_mut(y as usize * CELLS + x as usize)
                    && depth >= 0.0
                {
                    *slot = slot.min(depth);
                }
            }
        }
    }

    fn is_visible(&self, f: &Fragment, nearest: &[f64]) -> bool {
        let (cell, depth) = self.project(f.centre);
        let inside = cell.min_element() >= 0.0 && cell.max_element() < CELLS as f64;
        if !inside || depth < 0.0 || depth > self.plane.depth {
            return false;
        }
        let first = nearest.get(cell.y as usize * CELLS + cell.x as usize);
        first.is_none_or(|first| depth <= first + self.tolerance(f))
    }

    /// Tolerance of the depth comparison: the depth of a steep surface varies within a cell.
    fn tolerance(&self, f: &Fragment) -> f64 {
        // Rounding may make the cosine larger than one.
        let cosine = f.normal.dot(self.normal).abs().clamp(0.2, 1.0);
        let cell = self.plane.half_size.max_element() * 2.0 / CELLS as f64;
        cell * (1.0 - cosine * cosine).sqrt() / cosine + self.plane.depth * 2e-3
    }
}
