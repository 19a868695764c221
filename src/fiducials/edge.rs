//! Refines the sides of a tag to a fraction of a pixel.
//!
//! ```text
//!  Across a side, from s = −r (black) to s = +r (white), a pixel's value in linear light is the
//!  mean over its square. If the blur is symmetric, the step is at
//!      s0 = r − ∫ (I(s) − I_black) / (I_white − I_black) ds
//!  wherever it lies within the range: no threshold, and no bias by the sampling. In the camera's
//!  codes instead of linear light, the step would shift by up to a fifth of a pixel towards black.
//! ```

use super::quad::intersection;
use glam::DVec2;
use penumbra_camera::PinholeCamera;

/// Samples per pixel across a side.
const PER_PIXEL: f64 = 4.0;
/// Refinement passes; each starts from the previous result.
const PASSES: usize = 2;
/// Maximum number of sampled points along a side.
const MAX_POINTS: usize = 48;

/// A grey picture with the linear light of each code.
#[derive(Clone, Copy)]
pub(super) struct Grey<'a> {
    pub width: usize,
    pub height: usize,
    pub codes: &'a [u8],
    pub linear: &'a [f32; 256],
}

impl Grey<'_> {
    /// Returns the linear light at a position, bilinear; `None` beyond the outermost pixel centres.
    pub fn at(&self, p: DVec2) -> Option<f64> {
        let base = p.floor();
        let (x, y) = (base.x as isize, base.y as isize);
        let inside =
            x >= 0 && y >= 0 && x + 1 < self.width as isize && y + 1 < self.height as isize;
        if !inside {
            return None;
        }
        let i = y as usize * self.width + x as usize;
        let at = |i: usize| f64::from(self.linear[usize::from(self.codes[i])]);
        let f = p - base;
        let row = |i: usize| at(i) * (1.0 - f.x) + at(i + 1) * f.x;
        Some(row(i) * (1.0 - f.y) + row(i + self.width) * f.y)
    }
}

/// Removes lens distortion, so that sides are straight lines.
#[derive(Clone, Copy)]
pub(super) struct Lens<'a>(pub Option<&'a PinholeCamera>);

impl Lens<'_> {
    fn distorting(&self) -> Option<&PinholeCamera> {
        self.0.filter(|c| c.distortion != [0.0; 5])
    }

    fn undistort(&self, p: DVec2) -> DVec2 {
        self.distorting().map_or(p, |camera| {
            let ray = camera.unproject(p);
            ray.truncate() / ray.z * camera.focal + camera.centre
        })
    }

    fn distort(&self, p: DVec2) -> Option<DVec2> {
        let Some(camera) = self.distorting() else {
            return Some(p);
        };
        camera.project(((p - camera.centre) / camera.focal).extend(1.0))
    }
}

/// A black-to-white step across a side.
#[derive(Clone, Copy)]
struct Step {
    /// Position along the side, 0 to 1.
    along: f64,
    /// Position across the side, towards white, pixels.
    across: f64,
}

/// Refines the corners (clockwise on the screen) to the steps from the black border to white. The
/// tag is `modules` modules across. A side with too few visible steps keeps its position; `None`
/// if that is more than one side, or if a corner moves too far.
pub(super) fn refine(
    grey: &Grey,
    lens: Lens,
    corners: &[DVec2; 4],
    modules: u32,
) -> Option<[DVec2; 4]> {
    let mut now = *corners;
    for _ in 0..PASSES {
        let mut lines = [(DVec2::ZERO, DVec2::ZERO); 4];
        let mut missed = 0;
        for k in 0..4 {
            let ends = (now[k], now[(k + 1) % 4]);
            let module = depth(&now, k) / f64::from(modules);
            lines[k] = fit_side(grey, lens, ends, module).unwrap_or_else(|| {
                missed += 1;
                let (a, b) = (lens.undistort(ends.0), lens.undistort(ends.1));
                (a, (b - a).normalize_or_zero())
            });
        }
        if missed > 1 {
            return None;
        }
        for k in 0..4 {
            now[k] = lens.distort(intersection(lines[(k + 3) % 4], lines[k])?)?;
        }
    }
    let near = |k: usize| {
        let side = corners[k].distance(corners[(k + 1) % 4]);
        now[k].distance(corners[k]) < 2.0 + 0.1 * side
    };
    (0..4).all(near).then_some(now)
}

/// Returns the extent of the tag perpendicular to a side, pixels: small where it is foreshortened.
fn depth(corners: &[DVec2; 4], side: usize) -> f64 {
    let from = corners[side];
    let along = (corners[(side + 1) % 4] - from).normalize_or_zero();
    let off = |k: usize| along.perp_dot(corners[(side + k) % 4] - from).abs();
    off(2).min(off(3))
}

/// Fits a line (a point, a unit vector; without lens distortion) to the steps along one side.
/// `module` is the width of the black border there, pixels.
fn fit_side(
    grey: &Grey,
    lens: Lens,
    (a, b): (DVec2, DVec2),
    module: f64,
) -> Option<(DVec2, DVec2)> {
    let length = a.distance(b);
    let along = (b - a) / length;
    // The outline is clockwise, with black on its right.
    let white = along.perp() * -1.0;
    let reach = (0.8 * module).clamp(1.0, 3.0);
    let mut steps = [Step {
        along: 0.0,
        across: 0.0,
    }; MAX_POINTS];
    let count = (length as usize).clamp(8, MAX_POINTS);
    let mut found = 0;
    for i in 0..count {
        // The ends are left out, because the corners are blurred.
        let t = 0.06 + 0.88 * (i as f64 + 0.5) / count as f64;
        let at = a.lerp(b, t);
        if let Some(across) = step(grey, at, white, reach) {
            steps[found] = Step { along: t, across };
            found += 1;
        }
    }
    if found * 2 < count {
        return None;
    }
    let place = |s: &Step| lens.undistort(a.lerp(b, s.along) + white * s.across);
    robust_line(&mut steps[..found], place)
}

/// Returns the distance of the step from `at` towards white, pixels; `None` if it is too weak.
fn step(grey: &Grey, at: DVec2, white: DVec2, reach: f64) -> Option<f64> {
    let n = (2.0 * reach * PER_PIXEL).round();
    let spacing = 2.0 * reach / n;
    let mut values = [0.0; 32];
    let n = (n as usize).min(values.len());
    for (k, value) in values[..n].iter_mut().enumerate() {
        let s = -reach + (k as f64 + 0.5) * spacing;
        *value = grey.at(at + white * s)?;
    }
    let end = (n / 6).max(1);
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len() as f64;
    let (dark, bright) = (mean(&values[..end]), mean(&values[n - end..n]));
    if bright - dark < 0.02 || bright < 1.25 * dark {
        return None;
    }
    let area: f64 = values[..n]
        .iter()
        .map(|v| (v - dark) / (bright - dark))
        .sum();
    let across = reach - area * spacing;
    (across.abs() < 0.8 * reach).then_some(across)
}

/// Fits a line to the steps by least squares, twice: the second time without those farther from the
/// line than three times the median distance.
fn robust_line(steps: &mut [Step], place: impl Fn(&Step) -> DVec2) -> Option<(DVec2, DVec2)> {
    let line = least_squares(steps.iter().map(&place))?;
    let off = |s: &Step| line.1.perp_dot(place(s) - line.0).abs();
    let mut offs = [0.0; MAX_POINTS];
    for (slot, s) in offs.iter_mut().zip(steps.iter()) {
        *slot = off(s);
    }
    let offs = &mut offs[..steps.len()];
    offs.sort_unstable_by(f64::total_cmp);
    let limit = (3.0 * offs[offs.len() / 2]).max(0.1);
    let kept = steps.iter().filter(|s| off(s) <= limit);
    least_squares(kept.map(&place))
}

fn least_squares(points: impl Iterator<Item = DVec2> + Clone) -> Option<(DVec2, DVec2)> {
    let n = points.clone().count();
    if n < 4 {
        return None;
    }
    let mean = points.clone().sum::<DVec2>() / n as f64;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for p in points {
        let d = p - mean;
        (xx, xy, yy) = (xx + d.x * d.x, xy + d.x * d.y, yy + d.y * d.y);
    }
    Some((mean, DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy))))
}
