//! A rig's view of its environment: through a fisheye lens or in a mirrored sphere.

use crate::PinholeCamera;
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;

/// The three kinds of view of the environment (Supan 2006, section III).
#[derive(Clone, Debug)]
pub enum EnvironmentView {
    /// A camera behind an equidistant fisheye lens.
    Fisheye {
        /// The lens.
        lens: FisheyeLens,
        /// Pose of the camera (optical frame) in the world.
        world_from_camera: RigidTransform,
    },
    /// A separate camera that looks at a mirrored sphere.
    Sphere {
        /// The camera's intrinsics.
        camera: PinholeCamera,
        /// Pose of that camera in the world.
        world_from_camera: RigidTransform,
        /// The sphere.
        sphere: MirrorSphere,
    },
    /// A mirrored sphere in the scene camera's picture.
    SphereInScene {
        /// The sphere.
        sphere: MirrorSphere,
    },
}

/// Kannala–Brandt fisheye: r = f · (θ + k1 θ³ + k2 θ⁵ + k3 θ⁷ + k4 θ⁹).
#[derive(Clone, Debug, PartialEq)]
pub struct FisheyeLens {
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// Pixels per radian at the axis.
    pub focal: f64,
    /// Image of the optical axis, pixels.
    pub centre: DVec2,
    /// k1..k4; zero for the ideal equidistant lens.
    pub distortion: [f64; 4],
    /// Half the field of view, radians.
    pub max_theta: f64,
}

/// A mirrored sphere at a fixed position in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct MirrorSphere {
    /// Centre, metres.
    pub centre_in_world: DVec3,
    /// Radius, metres.
    pub radius: f64,
    /// Standard deviation of the centre along each horizontal axis, metres: of a sphere that was
    /// placed by hand. 0 for a measured centre.
    pub position_sigma: f64,
    /// Linear reflectance per channel, 0 to 1.
    pub reflectance: [f32; 3],
    /// The sphere is visible to the scene camera too, and therefore also a phantom object.
    pub in_scene: bool,
}
