//! Where camera, ground and ball are, from the ball's outline and a printed tag or the camera's tilt.
//!
//! The world has its origin where the ball touches the ground, +Z up, and +Y away from the camera.

use crate::ball::FoundBall;
use crate::error::PhotoError;
use crate::photograph::Photograph;
use glam::{DMat3, DQuat, DVec3};
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
    /// The user states how far the camera looked down.
    Stated,
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
                centre: glam::DVec2::ZERO,
                radius: 1.0,
            },
            direction: centre.normalize(),
            half_angle: (radius / centre.length()).asin(),
            support: 1.0,
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
    fn ball_above_the_horizon_is_refused() {
        let seen = ball(DVec3::new(0.0, -0.4, 0.7), 0.04);
        let refused = by_tilt(&seen, 0.04, 5.0, GroundFrom::Assumed).unwrap_err();
        assert!(refused.to_string().contains("--tilt"), "{refused}");
    }
}
