//! The direction of the ground from the corners of a rectangle that lies on it: a sheet of paper, a tile,
//! a table top.
//!
//! ```text
//! rays to the corners, in order round it:   r₀ r₁ r₂ r₃
//! plane through the camera and a side:      normal rᵢ × rⱼ
//! direction of two parallel sides, which    d = (r₀ × r₁) × (r₃ × r₂)
//! both planes contain:                      e = (r₁ × r₂) × (r₀ × r₃)
//! up:                                       ± d × e
//! ```
//!
//! Nothing is divided, so sides that are parallel in the picture, too, are no exception.

use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;

/// Minimum length of a side, pixels.
const MIN_SIDE: f64 = 4.0;
/// Minimum sine of the angle at a corner in the picture: 2°.
const MIN_SINE: f64 = 0.035;
/// How far a corner may lie outside the picture, in sizes of the picture.
const OUTSIDE: f64 = 1.0;
/// Error of a corner that a person points at, as a share of the picture's longer side.
const CORNER_ERROR: f64 = 5e-4;
/// Maximum error of the ground's direction by such errors, degrees.
const MAX_ERROR_DEGREES: f64 = 10.0;
/// Maximum deviation of the sides from 90°, degrees, beyond three times that by such errors. Of sheets of
/// paper at 0.6 m, 99 % are within 4.4° if corners are wrong by a 1000th of the picture; a focal length that
/// is wrong by 30 % causes up to 15°, and turns the ground by 8°.
const MAX_SKEW_DEGREES: f64 = 6.0;

/// The ground as a rectangle tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RectangleGround {
    /// Unit vector up in the camera's frame (+X right, +Y down, +Z forward).
    pub up: DVec3,
    /// Its standard deviation, degrees, if each corner is wrong by a 2000th of the picture.
    pub sigma_degrees: f64,
}

/// Why corners are not those of a rectangle on the ground.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RectangleError {
    /// A corner is far outside the picture, or no number.
    #[error(
        "--ground: the corner {x:.0},{y:.0} is too far outside the picture, which has {} × {} pixels",
        size.0, size.1
    )]
    Outside {
        /// Pixels.
        x: f64,
        /// Pixels.
        y: f64,
        /// Width and height of the picture, pixels.
        size: (u32, u32),
    },
    /// Three corners lie on a line, or two coincide.
    #[error(
        "--ground: the corner {x:.0},{y:.0} lies on a line with its neighbours, or on one of them; state \
         the four corners of a rectangle"
    )]
    Collinear {
        /// Pixels.
        x: f64,
        /// Pixels.
        y: f64,
    },
    /// The sides cross, or a corner points inwards.
    #[error("--ground: the corners are not in order round a rectangle; state them clockwise")]
    NotConvex,
    /// The error of the corners is too much for a rectangle of this size.
    #[error(
        "--ground: the rectangle is too small in the picture: errors of {pixels:.1} pixels at its corners \
         turn the ground by {degrees:.0}°; choose a larger one"
    )]
    TooSmall {
        /// Error of a corner, pixels.
        pixels: f64,
        /// Error of the ground's direction, degrees.
        degrees: f64,
    },
    /// The sides are not perpendicular.
    #[error(
        "--ground: the sides of the rectangle are {degrees:.0}° away from a right angle: the corners or the \
         lens (--fov) are wrong, or it is no rectangle"
    )]
    Skewed {
        /// Deviation from 90°, degrees.
        degrees: f64,
    },
}

/// Returns the ground's direction from the corners of a rectangle on it, in order round it, pixels. It is
/// seen from above.
///
/// # Errors
/// The corners cannot be those of a rectangle in a picture of this camera, or tell too little.
pub fn ground(
    corners: &[DVec2; 4],
    camera: &PinholeCamera,
) -> Result<RectangleGround, RectangleError> {
    check_outline(corners, camera)?;
    let directions = |corners: &[DVec2; 4]| {
        let [a, b] = sides(corners, camera);
        let up = a.cross(b).normalize_or_zero();
        let middle: DVec3 = corners.iter().map(|&c| camera.unproject(c)).sum();
        let skew = a.dot(b).clamp(-1.0, 1.0).asin().to_degrees();
        (if up.dot(middle) > 0.0 { -up } else { up }, skew)
    };
    let (up, skew) = directions(corners);
    let pixels = CORNER_ERROR * f64::from(camera.width.max(camera.height));
    let mut variances = DVec2::ZERO;
    for k in 0..8 {
        let mut moved = *corners;
        moved[k / 2][k % 2] += pixels;
        let (up_moved, skew_moved) = directions(&moved);
        let turned = up.angle_between(up_moved).to_degrees();
        variances += DVec2::new(turned, skew_moved - skew).powf(2.0);
    }
    let sigma = DVec2::new(variances.x.sqrt(), variances.y.sqrt());
    if sigma.x.is_nan() || sigma.x > MAX_ERROR_DEGREES {
        let degrees = sigma.x.min(90.0);
        return Err(RectangleError::TooSmall { pixels, degrees });
    }
    if skew.abs() > MAX_SKEW_DEGREES + 3.0 * sigma.y {
        let degrees = skew.abs();
        return Err(RectangleError::Skewed { degrees });
    }
    Ok(RectangleGround {
        up,
        sigma_degrees: sigma.x,
    })
}

/// Returns the unit vectors along both pairs of sides, in the camera's frame.
fn sides(corners: &[DVec2; 4], camera: &PinholeCamera) -> [DVec3; 2] {
    let [r0, r1, r2, r3] = corners.map(|c| camera.unproject(c));
    let along = |a: DVec3, b: DVec3, c: DVec3, d: DVec3| {
        // Unit vectors, because the product of two nearly equal planes is small.
        let (one, other) = (
            a.cross(b).normalize_or_zero(),
            c.cross(d).normalize_or_zero(),
        );
        one.cross(other).normalize_or_zero()
    };
    [along(r0, r1, r3, r2), along(r1, r2, r0, r3)]
}

/// Checks that the corners go round a convex quadrilateral near the picture.
fn check_outline(corners: &[DVec2; 4], camera: &PinholeCamera) -> Result<(), RectangleError> {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    for &DVec2 { x, y } in corners {
        let share = DVec2::new(x, y) / size;
        let range = -OUTSIDE..=1.0 + OUTSIDE;
        if !range.contains(&share.x) || !range.contains(&share.y) {
            let size = (camera.width, camera.height);
            return Err(RectangleError::Outside { x, y, size });
        }
    }
    let mut turns = 0.0;
    for k in 0..4 {
        let [before, here, after] = [k + 3, k, k + 1].map(|i| corners[i % 4]);
        let (a, b) = (here - before, after - here);
        let sine = a.normalize_or_zero().perp_dot(b.normalize_or_zero());
        if a.length() < MIN_SIDE || sine.abs() < MIN_SINE {
            let DVec2 { x, y } = here;
            return Err(RectangleError::Collinear { x, y });
        }
        turns += sine.signum();
    }
    match f64::abs(turns) {
        4.0 => Ok(()),
        _ => Err(RectangleError::NotConvex),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;
    use penumbra_numerics::Random;

    fn camera() -> PinholeCamera {
        PinholeCamera {
            width: 4000,
            height: 3000,
            focal: DVec2::splat(3000.0),
            centre: DVec2::new(1999.5, 1499.5),
            distortion: [0.0; 5],
        }
    }

    /// A rectangle of `sides` metres on the ground, `distance` metres before a camera that is tilted, rolled
    /// and turned (radians): its corners, pixels, and the true direction up.
    fn drawn(
        [tilt, roll, turn]: [f64; 3],
        sides: [f64; 2],
        middle: DVec3,
        camera: &PinholeCamera,
    ) -> ([DVec2; 4], DVec3) {
        let upright = DVec3::new(0.0, -tilt.cos(), -tilt.sin());
        let up = DQuat::from_rotation_z(roll) * upright;
        let (x, y) = up.any_orthonormal_pair();
        let a = x * turn.cos() + y * turn.sin();
        let b = up.cross(a);
        let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)].map(|(s, t)| {
            let at = middle + a * (s * sides[0]) + b * (t * sides[1]);
            camera.project(at).unwrap()
        });
        (corners, up)
    }

    #[test]
    fn ground_is_that_of_the_drawn_rectangle_with_its_roll() {
        let camera = camera();
        let mut random = Random::new(7);
        for k in 0..2000 {
            let angles = [
                random.between(0.35, 1.5),
                random.between(-0.6, 0.6),
                random.between(0.0, 6.3),
            ];
            let middle = DVec3::new(random.between(-0.2, 0.2), random.between(-0.1, 0.2), 0.7);
            let (mut corners, up) = drawn(angles, [0.297, 0.21], middle, &camera);
            // In either order, from any corner.
            corners.rotate_left(k % 4);
            if k % 2 == 0 {
                corners.reverse();
            }
            let found = ground(&corners, &camera).unwrap();
            assert!(found.up.distance(up) < 1e-9, "{found:?} for {up}");
        }
    }

    #[test]
    fn errors_of_the_corners_turn_the_ground_as_stated() {
        let camera = camera();
        let pixels = CORNER_ERROR * 4000.0;
        let mut random = Random::new(8);
        let mut ratios = Vec::new();
        for _ in 0..2000 {
            let angles = [
                random.between(0.25, 1.55),
                random.between(-0.3, 0.3),
                random.between(0.0, 6.3),
            ];
            let middle = DVec3::new(random.between(-0.2, 0.2), random.between(-0.1, 0.2), 0.8);
            let (corners, up) = drawn(angles, [0.297, 0.21], middle, &camera);
            let mut noise = || DVec2::new(random.normal(), random.normal()) * pixels;
            let found = ground(&corners.map(|c| c + noise()), &camera).unwrap();
            let turned = found.up.angle_between(up).to_degrees();
            ratios.push(turned / found.sigma_degrees);
            assert!(turned < 5.0 * found.sigma_degrees, "{turned}: {found:?}");
        }
        let mean = ratios.iter().map(|r| r * r).sum::<f64>() / ratios.len() as f64;
        assert!((0.7..1.4).contains(&mean), "{mean}");
    }

    #[test]
    fn straight_down_both_pairs_of_sides_are_parallel_in_the_picture() {
        let corners = [
            (1000.0, 1000.0),
            (3000.0, 1000.0),
            (3000.0, 2400.0),
            (1000.0, 2400.0),
        ];
        let found = ground(&corners.map(DVec2::from), &camera()).unwrap();
        assert!(found.up.distance(DVec3::NEG_Z) < 1e-12, "{found:?}");
        // One pair only: the camera looks along the other.
        let corners = [
            (1500.0, 1200.0),
            (2499.0, 1200.0),
            (2999.0, 2400.0),
            (1000.0, 2400.0),
        ];
        let found = ground(&corners.map(DVec2::from), &camera()).unwrap();
        assert!(found.up.x.abs() < 1e-12 && found.up.y < -0.1, "{found:?}");
    }

    fn refused(corners: [(f64, f64); 4], camera: &PinholeCamera) -> String {
        let message = ground(&corners.map(DVec2::from), camera)
            .unwrap_err()
            .to_string();
        assert!(message.starts_with("--ground: ") && !message.contains('\n'));
        message
    }

    #[test]
    fn corners_that_cannot_be_a_rectangles_are_refused() {
        let camera = camera();
        let with = |change: fn(&mut [(f64, f64); 4])| {
            let mut corners = [
                (1000.0, 1000.0),
                (3000.0, 1000.0),
                (3200.0, 2400.0),
                (800.0, 2400.0),
            ];
            change(&mut corners);
            refused(corners, &camera)
        };
        assert!(with(|c| c.swap(0, 1)).contains("in order"));
        assert!(with(|c| c[2] = (1200.0, 1100.0)).contains("in order"));
        assert!(with(|c| c[1] = (1000.0, 1000.0)).contains("lies on a line"));
        assert!(with(|c| c[1] = (4200.0, 1000.0)).contains("away from a right angle"));
        assert!(with(|c| c[2] = (900.0, 1700.0)).contains("lies on a line"));
        assert!(with(|c| c[1] = (9000.0, 1000.0)).contains("too far outside"));
        assert!(with(|c| c[3].1 = f64::NAN).contains("too far outside"));
        assert!(with(|c| c[0].0 = f64::INFINITY).contains("too far outside"));
        let small = [
            (100.0, 100.0),
            (140.0, 100.0),
            (142.0, 125.0),
            (98.0, 125.0),
        ];
        assert!(refused(small, &camera).contains("too small"));
    }

    #[test]
    fn wrong_lens_is_noticed_where_the_rectangle_stands_on_a_corner() {
        let camera = camera();
        let middle = DVec3::new(0.0, 0.05, 0.7);
        let (corners, _) = drawn([0.5, 0.0, 0.8], [0.297, 0.21], middle, &camera);
        let wrong = PinholeCamera {
            focal: camera.focal * 0.7,
            ..camera
        };
        let message = refused(corners.map(Into::into), &wrong);
        assert!(message.contains("--fov"), "{message}");
    }
}
