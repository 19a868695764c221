//! The scene camera's side of a light estimate.

use penumbra_interface::{Exposure, MonotonicTime, RigidTransform};
use penumbra_lighting::SpherePosition;
use penumbra_picture::Picture;

/// Where a mirrored sphere in the scene camera's picture is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SphereAt {
    /// Where the calibration says.
    Calibrated,
    /// There.
    Seen(SpherePosition),
    /// Carried about, and its marker is not seen: this picture shows no light.
    Lost,
}

/// What the scene camera saw at the instant that needs light.
pub struct SceneView<'a> {
    /// Its picture.
    pub picture: &'a Picture,
    /// Its pose, if it is known.
    pub world_from_camera: Option<RigidTransform>,
    /// Where the mirrored sphere is, where the rig has one in its picture.
    pub ball: SphereAt,
    /// Middle of its exposure.
    pub captured_at: MonotonicTime,
    /// As the camera reports it.
    pub exposure: Option<Exposure>,
}
