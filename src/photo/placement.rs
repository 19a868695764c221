//! Where camera, ground and ball are, from the ball's outline and a printed tag, a rectangle on the ground, or
//! the camera's tilt.
//!
//! The world has its origin where the ball touches the ground, +Z up, and +Y away from the camera.

use crate::ball::FoundBall;
use crate::error::PhotoError;
use crate::photograph::Photograph;
use crate::rectangle;
use glam::{DMat3, DQuat, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::{Detector, Family, Registrar, Tag, TagMap};
use penumbra_interface::{MonotonicTime, RigidTransform};

/// How far the camera looks down if nothing tells: a person who photographs a table, degrees.
pub const ASSUMED_TILT_DEGREES: f64 = 30.0;

/// How the direction of the ground is known.
#[derive(Clone, Debug, PartialEq)]
pub enum GroundFrom {
    /// From a printed tag.
    Tag,
    /// From the corners of a rectangle.
    Rectangle {
        /// Standard deviation of the ground's direction, degrees, if each corner is wrong by a 2000th of the
        /// picture.
        sigma_degrees: f64,
    },
    /// The user states how far the camera looked down.
    Stated,
    /// From where the ball's shadow falls.
    Shadow {
        /// Standard error of the camera's tilt, degrees.
        sigma_degrees: f64,
    },
    /// Assumed: see [`ASSUMED_TILT_DEGREES`].
    Assumed,
}

/// Camera, ground and ball.
#[derive(Clone, Debug, PartialEq)]
pub struct Placement {
    /// `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// The ball's centre in the world, metres.
    pub ball: DVec3,
    /// How far the camera looks down, degrees.
    pub tilt_degrees: f64,
    /// How far the camera is turned clockwise about its axis, as seen from behind it, degrees: 0 unless a tag
    /// or a rectangle tells it. It means little where the camera looks straight down.
    pub roll_degrees: f64,
    /// How the ground is known.
    pub ground: GroundFrom,
}

/// A printed tag that lies on the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PrintedTag {
    /// Its family.
    pub family: Family,
    /// Edge of its black border, metres.
    pub size: f64,
}

/// Returns the direction up in the frame of a camera (+X right, +Y down, +Z forward) that is held
/// upright and looks down by `tilt` radians.
fn up_of(tilt: f64) -> DVec3 {
    DVec3::new(0.0, -tilt.cos(), -tilt.sin())
}

/// Places a ball of `radius` metres by the camera's tilt.
///
/// # Errors
/// The ball is above the horizon.
pub fn by_tilt(
    ball: &FoundBall,
    radius: f64,
    tilt_degrees: f64,
    ground: GroundFrom,
) -> Result<Placement, PhotoError> {
    let up = up_of(tilt_degrees.to_radians());
    let centre = ball.centre(radius);
    let contact = centre - up * radius;
    placed(centre, contact, up, ground)
}

/// Places a ball of `radius` metres by a printed tag in the picture without the ball.
///
/// # Errors
/// The tag is not found, or the ball does not stand on its plane.
pub fn by_tag(
    empty: &Photograph,
    camera: &PinholeCamera,
    response: &Response,
    tag: PrintedTag,
    ball: &FoundBall,
    radius: f64,
) -> Result<Placement, PhotoError> {
    let missing = || PhotoError::NoTag {
        family: tag.family.to_string(),
        path: empty.path.clone(),
    };
    let mut detector = Detector::new(&[tag.family], response);
    let seen = detector.detect(&empty.picture, Some(camera)).to_vec();
    let largest = seen.iter().max_by(|a, b| a.area().total_cmp(&b.area()));
    let largest = largest.ok_or_else(missing)?;
    let map = TagMap::new(vec![Tag {
        family: tag.family,
        id: largest.id,
        size: tag.size,
        map_from_tag: RigidTransform::IDENTITY,
    }]);
    let mut registrar = Registrar::new(map.map_err(|_| missing())?);
    let pose = registrar
        .register(camera, &seen, MonotonicTime::from_nanos(0))
        .ok_or_else(missing)?;
    let camera_from_tag = pose.map_from_camera.inverse();
    // A tag's +Z points into the paper.
    let up = -(camera_from_tag.rotation * DVec3::Z);
    let centre = ball.centre(radius);
    let height = (centre - camera_from_tag.translation).dot(up);
    if (height - radius).abs() > 0.5 * radius {
        return Err(PhotoError::BallAndTag {
            height_mm: 1e3 * height,
            radius_mm: 1e3 * radius,
        });
    }
    placed(centre, centre - up * height, up, GroundFrom::Tag)
}

/// Places a ball of `radius` metres by the corners of a rectangle on the ground, pixels of `camera`, in order
/// round it.
///
/// # Errors
/// The corners are not those of a rectangle, or the ball is above its horizon.
pub fn by_rectangle(
    ball: &FoundBall,
    radius: f64,
    corners: &[DVec2; 4],
    camera: &PinholeCamera,
) -> Result<Placement, PhotoError> {
    let ground = rectangle::ground(corners, camera)?;
    let centre = ball.centre(radius);
    let from = GroundFrom::Rectangle {
        sigma_degrees: ground.sigma_degrees,
    };
    placed(centre, centre - ground.up * radius, ground.up, from).map_err(|error| match error {
        PhotoError::AboveHorizon { degrees } => PhotoError::AboveRectangle { degrees },
        other => other,
    })
}

fn placed(
    centre: DVec3,
    contact: DVec3,
    up: DVec3,
    ground: GroundFrom,
) -> Result<Placement, PhotoError> {
    // The camera must be above the ground, or it would see the ball through it.
    let height = -contact.dot(up);
    if height <= 0.0 {
        let degrees = (contact.normalize().dot(up)).asin().to_degrees();
        return Err(PhotoError::AboveHorizon { degrees });
    }
    let away = |v: DVec3| (v - up * v.dot(up)).normalize_or_zero();
    // A camera that looks straight down has its upper edge away from it.
    let mut y = away(DVec3::Z);
    if DVec3::Z.dot(up).abs() > 0.999 {
        y = away(DVec3::NEG_Y);
    }
    let x = y.cross(up);
    let world_from_camera = DMat3::from_cols(x, y, up).transpose();
    let rotation = DQuat::from_mat3(&world_from_camera).normalize();
    let pose = RigidTransform::new(rotation, -(rotation * contact));
    Ok(Placement {
        world_from_camera: pose,
        ball: pose.transform_point(centre),
        tilt_degrees: (-DVec3::Z.dot(up)).clamp(-1.0, 1.0).asin().to_degrees(),
        roll_degrees: (-up.x).atan2(-up.y).to_degrees(),
        ground,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_lighting::Circle;

    fn ball(centre: DVec3, radius: f64) -> FoundBall {
        FoundBall {
            circle: Circle {
                centre: DVec2::ZERO,
                radius: 1.0,
            },
            direction: centre.normalize(),
            half_angle: (radius / centre.length()).asin(),
            support: 1.0,
            is_fitted: true,
        }
    }

    #[test]
    fn ball_stands_on_the_ground_at_the_origin() {
        let seen = ball(DVec3::new(0.1, 0.05, 0.7), 0.04);
        let placed = by_tilt(&seen, 0.04, 25.0, GroundFrom::Stated).unwrap();
        assert!((placed.ball - DVec3::new(0.0, 0.0, 0.04)).length() < 1e-9);
        assert!((placed.tilt_degrees - 25.0).abs() < 1e-9);
        let forward = placed.world_from_camera.rotation * DVec3::Z;
        let right = placed.world_from_camera.rotation * DVec3::X;
        assert!((forward.z + 25f64.to_radians().sin()).abs() < 1e-9);
        assert!((right - DVec3::X).length() < 1e-9, "{right}");
        // It looks down from above the ground.
        assert!(placed.world_from_camera.translation.z > 0.2);
    }

    #[test]
    fn straight_down_is_a_view_too() {
        let seen = ball(DVec3::new(0.0, 0.0, 0.7), 0.04);
        let placed = by_tilt(&seen, 0.04, 90.0, GroundFrom::Stated).unwrap();
        assert!(
            (placed.world_from_camera.translation - DVec3::new(0.0, 0.0, 0.74)).length() < 1e-9
        );
    }

    #[test]
    fn rectangle_tells_the_camera_s_tilt_and_roll() {
        let camera = PinholeCamera {
            width: 800,
            height: 600,
            focal: DVec2::splat(700.0),
            centre: DVec2::new(399.5, 299.5),
            distortion: [0.0; 5],
        };
        let (tilt, roll) = (0.6_f64, 0.12_f64);
        // A camera that is turned clockwise sees up at the left.
        let up = DQuat::from_rotation_z(-roll) * up_of(tilt);
        let (x, y) = up.any_orthonormal_pair();
        let centre = DVec3::new(0.05, 0.02, 0.7);
        let corners = [(-0.1, -0.15), (0.1, -0.15), (0.1, 0.15), (-0.1, 0.15)]
            .map(|(a, b)| camera.project(centre - up * 0.04 + x * a + y * b).unwrap());
        let placed = by_rectangle(&ball(centre, 0.04), 0.04, &corners, &camera).unwrap();
        assert!((placed.tilt_degrees - tilt.to_degrees()).abs() < 1e-6);
        assert!(
            (placed.roll_degrees - roll.to_degrees()).abs() < 1e-6,
            "{placed:?}"
        );
        assert!((placed.ball - DVec3::new(0.0, 0.0, 0.04)).length() < 1e-9);
        // The corners lie on the ground, and +Y points away from the camera.
        let forward = placed.world_from_camera.rotation * DVec3::Z;
        assert!(forward.x.abs() < 1e-9 && forward.y > 0.5, "{forward}");
        let above = ball(DVec3::new(0.0, -0.6, 0.7), 0.04);
        let refused = by_rectangle(&above, 0.04, &corners, &camera).unwrap_err();
        assert!(refused.to_string().contains("--ground"), "{refused}");
    }

    #[test]
    fn ball_above_the_horizon_is_refused() {
        let seen = ball(DVec3::new(0.0, -0.4, 0.7), 0.04);
        let refused = by_tilt(&seen, 0.04, 5.0, GroundFrom::Assumed).unwrap_err();
        assert!(refused.to_string().contains("--tilt"), "{refused}");
    }
}
