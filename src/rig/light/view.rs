//! The scene camera's side of a light estimate.

use penumbra_camera::PinholeCamera;
use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_lighting::SpherePosition;
use penumbra_picture::Picture;

/// Position of a mirrored sphere in the scene camera's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SphereAt {
    /// As calibrated.
    Calibrated,
    /// As observed in this picture.
    Seen(SpherePosition),
    /// Unknown: the sphere is movable and its marker is not visible, so this picture gives no
    /// light.
    Lost,
}

/// The scene camera's picture and state at the instant whose light is estimated.
pub struct SceneView<'a> {
    /// Its picture.
    pub picture: &'a Picture,
    /// Pose of the camera, if it is known.
    pub world_from_camera: Option<RigidTransform>,
    /// Its lens.
    pub camera: &'a PinholeCamera,
    /// Position of the mirrored sphere, if the rig has one in the picture.
    pub sphere: SphereAt,
    /// Middle of its exposure.
    pub captured_at: MonotonicTime,
    /// Exposure as reported by the camera.
    pub exposure: Option<Exposure>,
}
