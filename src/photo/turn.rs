//! The rotation about the optical axis between two photographs that were taken by hand.
//!
//! ```text
//!  Each cell i of a grid over the picture, cᵢ from the middle, is shifted by sᵢ. If the picture is turned by θ, then
//!  sᵢ − sⱼ = θ × (cᵢ − cⱼ) for each pair, so θ is the median of (cᵢ − cⱼ) × (sᵢ − sⱼ)/|cᵢ − cⱼ|².
//! ```

use crate::align::shift;
use glam::{DVec2, IVec2};
use penumbra_numerics::median;
use penumbra_picture::Picture;

/// Cells of the grid along each side.
const CELLS: i32 = 4;
/// Share of a cell's pixels that may differ: the ball, its shadow and people.
const MAX_DIFFERING: f64 = 0.3;
/// Least number of cells that can be compared.
const ENOUGH: usize = 8;
/// Largest rotation, radians (6°).
const LARGEST: f64 = 0.105;
/// Median distance of the cells' shifts from those of the rotation, relative to those that it explains.
const MISFIT: f64 = 0.35;

/// Returns the angle, radians, clockwise in the picture, by which `second` is turned against `first`, where its
/// corners are at least a pixel off by that; `None` if it is not turned, or that cannot be told. `by`: the shift of
/// its content as a whole, pixels.
pub(crate) fn turn(first: &Picture, second: &Picture, by: IVec2) -> Option<f64> {
    let size = IVec2::new(first.width as i32, first.height as i32) / CELLS;
    let numbers = (0..CELLS).flat_map(|y| (0..CELLS).map(move |x| IVec2::new(x, y)));
    let cells: Vec<(DVec2, DVec2)> = numbers
        .filter_map(|number| {
            let corner = number * size;
            let of_second = part(second, corner + by, size)?;
            let found = shift(&part(first, corner, size)?, &of_second)?;
            let middle = (corner + size / 2).as_dvec2();
            (found.differing <= MAX_DIFFERING).then(|| (middle, found.pixels.as_dvec2()))
        })
        .collect();
    if cells.len() < ENOUGH {
        return None;
    }
    let pairs = || {
        cells
            .iter()
            .enumerate()
            .flat_map(|(i, a)| cells[..i].iter().map(move |b| (a, b)))
    };
    let angle = |((ca, sa), (cb, sb)): (&(DVec2, DVec2), &(DVec2, DVec2))| {
        (*ca - *cb).perp_dot(*sa - *sb) / ca.distance_squared(*cb)
    };
    let angle = median(pairs().map(angle))?;
    let turned = |c: DVec2| c.perp() * angle;
    let off = pairs().map(|((ca, sa), (cb, sb))| (*sa - *sb).distance(turned(*ca - *cb)));
    let explained = pairs().map(|((ca, _), (cb, _))| turned(*ca - *cb).length());
    let (off, explained) = (median(off)?, median(explained)?);
    let corner = DVec2::new(f64::from(first.width), f64::from(first.height)).length() / 2.0;
    let is_turned = angle.abs() * corner >= 1.0 && angle.abs() < LARGEST;
    (is_turned && off < MISFIT * explained + 0.5).then_some(angle)
}

/// A part of a picture; `None` if not all of it is inside.
fn part(picture: &Picture, corner: IVec2, size: IVec2) -> Option<Picture> {
    let end = corner + size;
    let whole = IVec2::new(picture.width as i32, picture.height as i32);
    if corner.min_element() < 0 || end.cmpgt(whole).any() {
        return None;
    }
    let row = |y: i32| {
        let from = 4 * (y as usize * picture.width as usize + corner.x as usize);
        &picture.rgba[from..from + 4 * size.x as usize]
    };
    Some(Picture {
        width: size.x as u32,
        height: size.y as u32,
        rgba: (corner.y..end.y).flat_map(row).copied().collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat2;

    /// Returns a picture that is turned clockwise about its middle by `angle`, radians, with bilinear interpolation. What
    /// is not in the picture is as at its border.
    fn turned(picture: &Picture, angle: f64) -> Picture {
        let last = DVec2::new(f64::from(picture.width), f64::from(picture.height)) - 1.0;
        let (middle, back) = (last / 2.0, DMat2::from_angle(-angle));
        let mut rgba = Vec::with_capacity(picture.rgba.len());
        for y in 0..picture.height {
            for x in 0..picture.width {
                let at = DVec2::new(f64::from(x), f64::from(y)) - middle;
                let from = (middle + back * at).clamp(DVec2::ZERO, last);
                let (low, share) = (from.floor(), from.fract());
                let high = (low + 1.0).min(last);
                let codes = |u: f64, v: f64| picture.rgb(u as u32, v as u32).map(f64::from);
                let corners = [
                    (low.x, low.y),
                    (high.x, low.y),
                    (low.x, high.y),
                    (high.x, high.y),
                ];
                let [a, b, c, d] = corners.map(|(u, v)| codes(u, v));
                let mix = |k: usize| {
                    let top = a[k] + (b[k] - a[k]) * share.x;
                    let bottom = c[k] + (d[k] - c[k]) * share.x;
                    (top + (bottom - top) * share.y).round() as u8
                };
                rgba.extend([mix(0), mix(1), mix(2), 255]);
            }
        }
        Picture {
            width: picture.width,
            height: picture.height,
            rgba,
        }
    }

    /// A blotchy texture.
    fn texture() -> Picture {
        let (width, height) = (360, 270);
        let shade = |x: f64, y: f64| {
            let waves = (x * 0.11).sin() + (y * 0.13 + x * 0.021).sin() + (0.23 * (x - y)).sin();
            90.0 + 28.0 * waves
        };
        let rgba = (0..width * height).flat_map(|i| {
            let code = shade(f64::from(i % width), f64::from(i / width)) as u8;
            [code, code, code, 255]
        });
        Picture {
            width: width as u32,
            height: height as u32,
            rgba: rgba.collect(),
        }
    }

    #[test]
    fn finds_by_how_much_a_picture_is_turned() {
        let first = texture();
        for degrees in [-3.0, -1.5, 0.8, 1.5, 4.0_f64] {
            let second = turned(&first, degrees.to_radians());
            let found = turn(&first, &second, IVec2::ZERO).unwrap().to_degrees();
            assert!((found - degrees).abs() < 0.25, "{found} for {degrees}");
        }
    }

    #[test]
    fn picture_that_is_not_turned_is_left_alone() {
        let first = texture();
        assert_eq!(turn(&first, &first, IVec2::ZERO), None);
        let again = turned(&turned(&first, 0.01), -0.01);
        assert_eq!(turn(&first, &again, IVec2::ZERO), None);
        // Another place, and nothing to compare.
        let mirrored = Picture {
            rgba: first
                .rgba
                .chunks_exact(4)
                .rev()
                .flatten()
                .copied()
                .collect(),
            ..first.clone()
        };
        assert_eq!(turn(&first, &mirrored, IVec2::ZERO), None);
        let grey = Picture {
            rgba: vec![128; first.rgba.len()],
            ..first.clone()
        };
        assert_eq!(turn(&grey, &grey, IVec2::ZERO), None);
    }
}
