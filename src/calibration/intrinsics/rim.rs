//! Angles from the axis up to which a fisheye lens is determined and receives light.

use super::detect::Grey;
use super::estimate::Estimate;
use glam::{DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_numerics::Matrix;
use std::f64::consts::{PI, TAU};

/// Columns and rows of the cells in which light is measured.
const CELLS: (usize, usize) = (64, 48);
/// Minimum brightness of a lit cell as a share of the brightest cell; darker ones belong to the
/// black rim.
const MIN_LIT_SHARE: f32 = 0.12;
/// Minimum code of a lit cell.
const MIN_LIT_CODE: f32 = 12.0;
/// Maximum standard deviation of a determined direction's projection, pixels of a picture 1280
/// wide.
const MAX_SIGMA: f64 = 3.0;
/// Maximum ratio of the determined angle to the largest angle of corners. Farther out the polynomial
/// is extrapolated, and the standard deviation omits that the real lens does not follow it.
const MAX_EXTRAPOLATION: f64 = 1.05;
/// Step of the outward search, radians.
const STEP: f64 = 0.5 * PI / 180.0;

/// Area of the pictures that receives light: maximum brightness of each cell over all pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Light {
    brightest: Vec<f32>,
}

impl Light {
    /// Adds a picture; all pictures must have the same size.
    pub fn add(&mut self, picture: &Grey) {
        let (columns, rows) = CELLS;
        if picture.width < columns || picture.height < rows {
            return;
        }
        self.brightest.resize(columns * rows, 0.0);
        for (i, brightest) in self.brightest.iter_mut().enumerate() {
            let across = |k: usize| k * picture.width / columns;
            let down = |k: usize| k * picture.height / rows;
            let (x, y) = (i % columns, i / columns);
            let (left, right) = (across(x), across(x + 1));
            let lines = down(y)..down(y + 1);
            let count = (lines.len() * (right - left)) as f32;
            let rows = lines.map(|y| &picture.data[y * picture.width..]);
            let sum: f32 = rows.map(|row| row[left..right].iter().sum::<f32>()).sum();
            *brightest = brightest.max(sum / count);
        }
    }

    /// Returns whether a position, as shares of the picture's width and height, receives light;
    /// `None` without pictures.
    #[must_use]
    pub fn is_lit(&self, position: DVec2) -> Option<bool> {
        let (columns, rows) = CELLS;
        let cell = |share: f64, n: usize| ((share * n as f64).max(0.0) as usize).min(n - 1);
        let at = cell(position.y, rows) * columns + cell(position.x, columns);
        Some(*self.brightest.get(at)? > self.min_lit())
    }

    fn min_lit(&self) -> f32 {
        let max = self.brightest.iter().copied().fold(0.0, f32::max);
        (MIN_LIT_SHARE * max).max(MIN_LIT_CODE)
    }

    /// Returns the largest angle from the axis, by `lens`, from which light comes, radians; the
    /// outermost hundredth is ignored as possible glare.
    fn max_angle(&self, lens: &Lens) -> Option<f64> {
        let (columns, rows) = CELLS;
        let size = lens.last_pixel() + 1.0;
        let angle = |i: usize| {
            let at = DVec2::new((i % columns) as f64 + 0.5, (i / columns) as f64 + 0.5);
            let share = at / DVec2::new(columns as f64, rows as f64);
            angle_of(lens, share * size - 0.5)
        };
        let lit = (0..self.brightest.len()).filter(|&i| self.brightest[i] > self.min_lit());
        let mut angles: Vec<f64> = lit.filter_map(angle).collect();
        angles.sort_unstable_by(f64::total_cmp);
        angles
            .get(angles.len().saturating_sub(1 + angles.len() / 100))
            .copied()
    }
}

/// Angles from a fisheye's axis, radians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rim {
    /// Largest angle at which corners were seen.
    pub seen: f64,
    /// Angle to which the corners determine the lens: at most a twentieth beyond the outermost
    /// corner, and only as far as the projection is monotonic with a standard deviation of at most
    /// three pixels.
    pub known: f64,
    /// Largest angle from which light comes; `None` without pictures.
    pub lit: Option<f64>,
}

impl Rim {
    /// Computes the angles of an estimate; `None` if the lens is not a fisheye.
    #[must_use]
    pub fn from_estimate(estimate: &Estimate, light: &Light) -> Option<Self> {
        let lens = &estimate.lens;
        if lens.model != LensModel::KannalaBrandt {
            return None;
        }
        let used = estimate.views.iter().filter(|v| v.used);
        let points = used.flat_map(|v| v.points.iter().filter(|p| p.used));
        let seen = points.filter_map(|p| angle_of(lens, p.pixel));
        let seen = seen.fold(0.0, f64::max);
        Some(Self {
            seen,
            known: known_angle(estimate, seen),
            lit: light.max_angle(lens),
        })
    }
}

/// Returns the angle between the axis and a pixel's ray.
fn angle_of(lens: &Lens, pixel: DVec2) -> Option<f64> {
    Some(lens.unproject(pixel)?.angle_between(DVec3::Z))
}

/// Returns the angle, from `seen` outwards, to which the lens is determined.
fn known_angle(estimate: &Estimate, seen: f64) -> f64 {
    let lens = &estimate.lens;
    let limit = MAX_SIGMA * (f64::from(lens.width.max(lens.height)) / 1280.0).max(1.0);
    let mut gathered = vec![DVec2::ZERO; estimate.unknowns.count()];
    let mut is_known = |theta: f64, azimuth: f64| {
        let (out, along) = theta.sin_cos();
        let ray = (DVec2::from_angle(azimuth) * out).extend(along);
        let Some(p) = lens.project_with_derivatives(ray) else {
            return false;
        };
        estimate.unknowns.gather(&p.by_parameter, &mut gathered);
        let (out, along) = (theta - STEP).sin_cos();
        let nearer = lens.project((DVec2::from_angle(azimuth) * out).extend(along));
        let is_monotonic =
            nearer.is_some_and(|q| q.distance(lens.centre) < p.pixel.distance(lens.centre));
        is_monotonic && deviation(&gathered, &estimate.covariance) <= limit
    };
    let farthest = (MAX_EXTRAPOLATION * seen).min(PI);
    let mut theta = seen;
    while theta + STEP < farthest
        && (0..8).all(|k| is_known(theta + STEP, f64::from(k) * TAU / 8.0))
    {
        theta += STEP;
    }
    theta
}

/// Returns √(½ trace J Σ Jᵀ), the standard deviation of one coordinate, pixels.
pub(super) fn deviation(rows: &[DVec2], covariance: &Matrix) -> f64 {
    let mut trace = 0.0;
    for (i, a) in rows.iter().enumerate() {
        for (j, b) in rows.iter().enumerate() {
            trace += covariance[(i, j)] * a.dot(*b);
        }
    }
    (0.5 * trace.max(0.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intrinsics::estimate::tests::{fisheye, poses, simulated_views};
    use crate::intrinsics::{Options, estimate};
    use penumbra_numerics::Random;

    fn found(distance: f64, lateral: f64) -> Estimate {
        let lens = fisheye();
        let views = simulated_views(
            &lens,
            &poses(30, distance, lateral, 5),
            0.15,
            &mut Random::new(3),
        );
        let options = Options {
            model: LensModel::KannalaBrandt,
            square_pixels: true,
        };
        estimate((lens.width, lens.height), &views, &options).unwrap()
    }

    #[test]
    fn lens_is_known_to_outermost_corners_and_beyond() {
        let wide = Rim::from_estimate(&found(0.12, 0.9), &Light::default()).unwrap();
        let narrow = Rim::from_estimate(&found(0.4, 0.2), &Light::default()).unwrap();
        assert!(wide.seen > narrow.seen + 0.3, "{wide:?} {narrow:?}");
        for rim in [wide, narrow] {
            assert!(rim.known >= rim.seen && rim.lit.is_none(), "{rim:?}");
        }
    }

    #[test]
    fn lens_is_not_known_far_beyond_outermost_corners() {
        for (distance, lateral) in [(0.12, 0.9), (0.4, 0.2), (0.2, 0.4)] {
            let rim = Rim::from_estimate(&found(distance, lateral), &Light::default()).unwrap();
            assert!(rim.known <= 1.05 * rim.seen, "{rim:?}");
        }
    }

    #[test]
    fn light_is_distinguished_from_black_rim() {
        let lens = fisheye();
        let (w, h) = (lens.width as usize, lens.height as usize);
        let radius = 0.45 * h as f64;
        let code = |i: usize| {
            let p = DVec2::new((i % w) as f64, (i / w) as f64);
            if p.distance(lens.centre) < radius {
                90
            } else {
                6
            }
        };
        let bytes: Vec<u8> = (0..w * h).map(code).collect();
        let mut light = Light::default();
        assert_eq!(light.is_lit(DVec2::splat(0.5)), None);
        light.add(&Grey::from_bytes(w, h, &bytes));
        assert_eq!(light.is_lit(DVec2::splat(0.5)), Some(true));
        assert_eq!(light.is_lit(DVec2::ZERO), Some(false));
        let at_rim = angle_of(&lens, lens.centre + DVec2::X * radius).unwrap();
        let max_angle = light.max_angle(&lens).unwrap();
        assert!((max_angle - at_rim).abs() < 0.1, "{max_angle} {at_rim}");
    }
}
