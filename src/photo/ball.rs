//! Finds the ball that was put into a picture.

use crate::photograph::reduced;
use glam::{DMat3, DVec2, DVec3, IVec2};
use penumbra_camera::PinholeCamera;
use penumbra_lighting::{Circle, OutlineSearch, find_outline, outline_points};
use penumbra_picture::Picture;

/// Maximum side of the pictures in which changes are searched, pixels.
const MAX_SIDE: u32 = 480;
/// Minimum change of a pixel where a ball was put, codes.
const MIN_CHANGE: i32 = 12;
/// Radii of balls that are searched, as shares of the picture's shorter side.
const RADII: [f64; 2] = [0.03, 0.45];
/// Error of an outline's points beyond which they belong to something else, pixels.
const MAX_ERROR: f64 = 2.0;

/// The ball's outline in a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoundBall {
    /// The circle that comes closest to its outline, pixels.
    pub circle: Circle,
    /// Unit vector from the camera to its centre (+X right, +Y down, +Z forward).
    pub direction: DVec3,
    /// Half of the angle that it covers, radians.
    pub half_angle: f64,
    /// Share of the outline that is visible as an edge, 0 to 1.
    pub support: f64,
}

impl FoundBall {
    /// Returns the centre of a ball of this radius (metres) in the camera's frame.
    #[must_use]
    pub fn centre(&self, radius: f64) -> DVec3 {
        self.direction * (radius / self.half_angle.sin())
    }
}

/// Where two pictures differ, reduced.
struct Changes {
    width: usize,
    height: usize,
    factor: f64,
    changed: Vec<bool>,
}

/// Finds the ball in `with`, which `without` does not show; its content is shifted by `shift` pixels
/// in `with`. `gain` is the factor of codes from `without` to `with` that their exposures cause.
#[must_use]
pub fn find(with: &Picture, without: &Picture, shift: IVec2) -> Option<Circle> {
    let changes = Changes::between(without, with, shift)?;
    let prior = |circle: Circle| changes.prior(circle);
    let search = OutlineSearch {
        radii: RADII,
        max_side: MAX_SIDE,
        prior: &prior,
    };
    find_outline(with, &search).map(|found| found.circle)
}

impl Changes {
    fn between(without: &Picture, with: &Picture, shift: IVec2) -> Option<Self> {
        let factor = with.width.max(with.height).div_ceil(MAX_SIDE).max(1);
        let (a, b) = (reduced(without, factor), reduced(with, factor));
        let shift = (shift.as_dvec2() / f64::from(factor)).round().as_ivec2();
        let (width, height) = (b.width as i32, b.height as i32);
        let gain = gain(&a, &b)?;
        let nearest = |x: i32, y: i32| {
            let (u, v) = (x - shift.x, y - shift.y);
            let here = b.rgb(x as u32, y as u32);
            let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (u + dx, v + dy)));
            let inside = around.filter(|&(u, v)| u >= 0 && v >= 0 && u < width && v < height);
            let differences = inside.map(|(u, v)| {
                let there = a.rgb(u as u32, v as u32);
                let channel = |c: usize| {
                    let expected = (f64::from(there[c]) * gain).min(255.0) as i32;
                    (i32::from(here[c]) - expected).abs()
                };
                channel(0).max(channel(1)).max(channel(2))
            });
            differences.min().unwrap_or(0)
        };
        let changed = (0..width * height).map(|i| nearest(i % width, i / width) > MIN_CHANGE);
        Some(Self {
            width: width as usize,
            height: height as usize,
            factor: f64::from(factor),
            changed: changed.collect(),
        })
    }

    /// Returns the share of a circle that changed, less what changed in the ring around it: a ball's
    /// shadow lies at one side of it only.
    fn prior(&self, circle: Circle) -> f64 {
        let centre = (circle.centre + 0.5) / self.factor - 0.5;
        let radius = circle.radius / self.factor;
        let outer = 1.3 * radius;
        let clamp = |v: f64, size: usize| v.clamp(0.0, size as f64 - 1.0) as usize;
        let rows = clamp(centre.y - outer, self.height)..=clamp(centre.y + outer, self.height);
        let columns = clamp(centre.x - outer, self.width)..=clamp(centre.x + outer, self.width);
        // Pixels and changed pixels, inside and around.
        let mut counts = [[0u32; 2]; 2];
        for y in rows {
            for x in columns.clone() {
                let distance = DVec2::new(x as f64, y as f64).distance(centre) / radius;
                let part = match distance {
                    d if d < 0.95 => 0,
                    d if (1.05..1.3).contains(&d) => 1,
                    _ => continue,
                };
                counts[part][0] += 1;
                counts[part][1] += u32::from(self.changed[y * self.width + x]);
            }
        }
        let share = |[all, changed]: [u32; 2]| f64::from(changed) / f64::from(all.max(1));
        (share(counts[0]) - 0.5 * share(counts[1])).max(0.0)
    }
}

/// Returns the factor between the median codes of two pictures.
fn gain(a: &Picture, b: &Picture) -> Option<f64> {
    let median = |picture: &Picture| {
        let mut codes: Vec<u8> = picture.rgba.chunks_exact(4).map(|p| p[1]).collect();
        codes.sort_unstable();
        codes.get(codes.len() / 2).map(|code| f64::from(*code))
    };
    let (a, b) = (median(a)?, median(b)?);
    (a > 0.0 && b > 0.0).then_some(b / a)
}

/// Fits the cone from the camera to the ball's outline near `circle`: the rays d to its points have
/// a·d = 1 with a = axis / cos α, exactly, whatever the perspective. `shift` is subtracted from the
/// points. `None` if too little of the outline is visible.
#[must_use]
pub fn cone(
    picture: &Picture,
    camera: &PinholeCamera,
    circle: Circle,
    shift: IVec2,
) -> Option<FoundBall> {
    let shift = shift.as_dvec2();
    let points: Vec<DVec2> = outline_points(picture, circle, 0.08)
        .into_iter()
        .map(|p| p - shift)
        .collect();
    let rays: Vec<DVec3> = points
        .iter()
        .map(|&p| camera.unproject(p).normalize())
        .collect();
    let circle = Circle {
        centre: circle.centre - shift,
        radius: circle.radius,
    };
    let mut cone = stated(camera, circle);
    let focal = camera.focal.x;
    // Errors in pixels; the scale narrows as the cone improves.
    let mut scale = (0.03 * circle.radius).max(MAX_ERROR);
    for _ in 0..12 {
        let weights = rays.iter().map(|ray| {
            let angle = ray.dot(cone.direction).clamp(-1.0, 1.0).acos();
            let error = (angle - cone.half_angle) * focal / scale;
            1.0 / (1.0 + error * error).powi(2)
        });
        let fitted = weighted_cone(&rays, &weights.collect::<Vec<f64>>())?;
        cone = FoundBall {
            direction: fitted.0,
            half_angle: fitted.1,
            ..cone
        };
        scale = (0.7 * scale).max(0.5 * MAX_ERROR);
    }
    let is_on = |ray: &&DVec3| {
        let angle = ray.dot(cone.direction).clamp(-1.0, 1.0).acos();
        (angle - cone.half_angle).abs() * focal < MAX_ERROR
    };
    cone.support = rays.iter().filter(is_on).count() as f64 / 360.0;
    (cone.support > 0.2).then_some(cone)
}

/// Returns the ball of a circle that was stated.
#[must_use]
pub fn stated(camera: &PinholeCamera, circle: Circle) -> FoundBall {
    let direction = camera.unproject(circle.centre).normalize();
    // Seen off the axis, a circle of the same area covers this angle.
    let side = camera.unproject(circle.centre + DVec2::new(circle.radius, 0.0));
    let up = camera.unproject(circle.centre + DVec2::new(0.0, circle.radius));
    let half_angle = (direction.angle_between(side) * direction.angle_between(up)).sqrt();
    FoundBall {
        circle,
        direction,
        half_angle,
        support: 1.0,
    }
}

/// Solves Σ w (a·d − 1)² → min. Returns the axis and the half angle.
fn weighted_cone(rays: &[DVec3], weights: &[f64]) -> Option<(DVec3, f64)> {
    let mut matrix = DMat3::ZERO;
    let mut sum = DVec3::ZERO;
    for (ray, &w) in rays.iter().zip(weights) {
        matrix += DMat3::from_cols(*ray * ray.x, *ray * ray.y, *ray * ray.z) * w;
        sum += *ray * w;
    }
    let inverse = matrix.inverse();
    let a = inverse * sum;
    let length = a.length();
    (a.is_finite() && length > 1.0).then(|| (a / length, (1.0 / length).acos()))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (u32, u32) = (800, 600);

    fn camera() -> PinholeCamera {
        PinholeCamera {
            width: SIZE.0,
            height: SIZE.1,
            focal: DVec2::splat(640.0),
            centre: DVec2::new(399.5, 299.5),
            distortion: [0.0; 5],
        }
    }

    /// A table with grain, and a ball at `centre` (metres) that mirrors stripes and throws a shadow.
    fn picture(ball: Option<(DVec3, f64)>) -> Picture {
        let camera = camera();
        let rgba = (0..SIZE.0 * SIZE.1).flat_map(|i| {
            let p = DVec2::new(f64::from(i % SIZE.0), f64::from(i / SIZE.0));
            let ray = camera.unproject(p).normalize();
            let grain = 18.0 * (0.11 * p.x).sin() * (0.07 * p.y + 0.02 * p.x).cos();
            let table = 120.0 + grain;
            let code = match ball {
                Some((centre, radius)) => {
                    let angle = ray.angle_between(centre);
                    let half = (radius / centre.length()).asin();
                    let shadow = ray.angle_between(centre + DVec3::new(0.05, 0.03, 0.0)) < half;
                    match angle < half {
                        true if (40.0 * angle).sin() > 0.3 => 210.0,
                        true => 45.0,
                        false if shadow => table * 0.6,
                        false => table,
                    }
                }
                None => table,
            };
            [code as u8, code as u8, (0.9 * code) as u8, 255]
        });
        Picture {
            width: SIZE.0,
            height: SIZE.1,
            rgba: rgba.collect(),
        }
    }

    #[test]
    fn ball_is_found_where_it_stands_also_far_off_the_axis() {
        let empty = picture(None);
        for (x, y) in [(0.0, 0.05), (-0.25, 0.12), (0.28, -0.15)] {
            let (centre, radius) = (DVec3::new(x, y, 0.7), 0.04);
            let with = picture(Some((centre, radius)));
            let circle = find(&with, &empty, IVec2::ZERO).unwrap();
            let found = cone(&with, &camera(), circle, IVec2::ZERO).unwrap();
            let error = found.centre(radius) - centre;
            assert!(
                error.length() < 0.01 * centre.length(),
                "{:?} for {centre:?}",
                found.centre(radius)
            );
        }
    }

    #[test]
    fn nothing_is_found_where_nothing_was_put() {
        let empty = picture(None);
        assert_eq!(find(&empty, &empty, IVec2::ZERO), None);
    }
}
