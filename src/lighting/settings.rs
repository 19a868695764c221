//! Settings, inputs and errors of the estimator.

use super::hdr::Bracket;
use super::light::Filtering;
use super::resample::Hidden;
use super::sources::SourceSettings;
use glam::{DVec3, Mat3, Vec3};
use penumbra_camera::Parallax;
use penumbra_camera::PinholeCamera;
use penumbra_interface::{MonotonicTime, RigidTransform};

/// How dome lights are placed.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum LightPlacement {
    /// Compact sources get lights of their own at their true directions; cells of similar
    /// importance share the rest.
    #[default]
    Adaptive,
    /// The texel centres of the downsampled cube map (Supan 2006).
    Grid,
}

/// How irradiance is computed.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum IrradianceMethod {
    /// Spherical harmonics of degree 2 (Ramamoorthi and Hanrahan 2001).
    #[default]
    Harmonics,
    /// The blurred map of the paper (Supan 2006), for comparison.
    Blurred,
}

/// How the energy of clipped pixels is estimated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClippedEnergy {
    /// Clipped pixels keep their clipped value.
    Keep,
    /// Clipped pixels are multiplied by `factor`, up to `max_solid_angle` steradians in total; a
    /// larger clipped region (an overexposed sky) keeps its value.
    Factor {
        /// Factor, at least 1.
        factor: f32,
        /// Maximum solid angle of all clipped pixels, steradians.
        max_solid_angle: f32,
    },
    /// Clipped pixels are raised until the ground's irradiance equals the measured one (see
    /// [`EnvironmentInput::measured_ground_irradiance`]). Without a measurement, and with a sphere
    /// in the scene camera's picture, the factor is estimated from the shadows in that picture;
    /// else clipped pixels keep their value.
    Measured {
        /// Maximum factor.
        max_factor: f32,
    },
}

impl Default for ClippedEnergy {
    fn default() -> Self {
        Self::Measured { max_factor: 1e5 }
    }
}

/// Settings of the estimator.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentSettings {
    /// Texels along a side of the cube map, a power of two.
    pub cube_size: u32,
    /// Placement of the dome lights.
    pub placement: LightPlacement,
    /// Maximum number of dome lights.
    pub lights: usize,
    /// There is phantom ground: no light comes from below.
    pub ground: bool,
    /// How irradiance is computed.
    pub irradiance: IrradianceMethod,
    /// Treatment of sources that every exposure clips.
    pub clipped: ClippedEnergy,
    /// Criteria of a compact source.
    pub sources: SourceSettings,
    /// Reflectance of the ground, used if its radiance is unknown.
    pub fallback_ground_albedo: f32,
    /// World height of the ground, metres, for the analysis of shadows on it.
    pub ground_height: f64,
    /// Translates light from the position where it is seen to the position where it is needed.
    pub parallax: Option<Parallax>,
    /// Time constant, seconds, for which an earlier observation of a direction on a sphere in the
    /// scene outweighs a new, worse one.
    pub memory_seconds: f32,
    /// Frequency of the geodesic dome for shadowing planes, if any.
    pub faces: Option<u32>,
    /// How reflections are filtered.
    pub filtering: Filtering,
    /// Filters for lobes of Phong's model, too.
    pub phong: bool,
}

impl Default for EnvironmentSettings {
    fn default() -> Self {
        Self {
            cube_size: 64,
            placement: LightPlacement::Adaptive,
            lights: 64,
            ground: true,
            irradiance: IrradianceMethod::Harmonics,
            clipped: ClippedEnergy::default(),
            sources: SourceSettings::default(),
            fallback_ground_albedo: 0.3,
            ground_height: 0.0,
            parallax: None,
            memory_seconds: 0.25,
            faces: None,
            filtering: Filtering::Prefiltered,
            phong: false,
        }
    }
}

/// Reasons why no light can be estimated from a picture.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum EnvironmentError {
    /// The size of the picture differs from the calibration.
    #[error(
        "environment picture is {got_width}x{got_height}, but its calibration is for {width}x{height}: calibrate the camera at the size it records, or set its size to the calibration's"
    )]
    PictureSize {
        /// Calibrated width, pixels.
        width: u32,
        /// Calibrated height, pixels.
        height: u32,
        /// Width of the picture, pixels.
        got_width: u32,
        /// Height of the picture, pixels.
        got_height: u32,
    },
    /// No picture was given.
    #[error("no environment picture was given")]
    NoPicture,
    /// The sphere is in the scene camera's picture, and that camera's pose is unknown.
    #[error(
        "the mirrored sphere is in the scene camera's picture, and that camera's pose is unknown: check the tracker and its calibration"
    )]
    NoScenePose,
    /// The camera is inside the sphere.
    #[error(
        "the camera is inside the mirrored sphere: check centre and radius (metres) of the sphere and the camera's pose"
    )]
    InsideSphere,
    /// The size of the cube is not supported.
    #[error("cube size {0} is not a power of two between 16 and 512")]
    CubeSize(u32),
}

/// Position of the mirrored sphere and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpherePosition {
    /// Its centre, world, metres.
    pub centre_in_world: DVec3,
    /// Standard deviation of its position in the picture, along each axis, pixels.
    pub sigma: f64,
}

/// One instant's pictures and other known quantities.
pub struct EnvironmentInput<'a> {
    /// Exposures of the instant, in any order.
    pub brackets: &'a [Bracket<'a>],
    /// Pose and intrinsics of the scene camera, for a sphere in its picture.
    pub scene: Option<(RigidTransform, &'a PinholeCamera)>,
    /// Matrix from the environment camera's linear values to the scene camera's.
    pub gains: Mat3,
    /// Mean radiance of the ground around the objects, scene camera units.
    pub ground_radiance: Option<Vec3>,
    /// Irradiance of the ground as measured by other means, scene camera units.
    pub measured_ground_irradiance: Option<Vec3>,
    /// Tests whether a ray ends on a phantom other than the mirrored sphere itself, for a sphere in
    /// the scene camera's picture (the camera's rays and the reflected ones). Static views take
    /// theirs at the start.
    pub hidden: Option<&'a Hidden<'a>>,
    /// Mean radiance of those phantoms in the scene camera's picture, scene camera units.
    pub occluder_radiance: Option<Vec3>,
    /// Position of a sphere in the scene camera's picture at this instant. If given, its rim is
    /// searched near it; else the calibrated position is used unchanged.
    pub sphere_position: Option<SpherePosition>,
    /// Middle of the exposure.
    pub captured_at: MonotonicTime,
}

impl<'a> EnvironmentInput<'a> {
    /// Creates an input of pictures alone: no scene camera, gains of one, no other measurements.
    #[must_use]
    pub fn new(brackets: &'a [Bracket<'a>], captured_at: MonotonicTime) -> Self {
        Self {
            brackets,
            scene: None,
            gains: Mat3::IDENTITY,
            ground_radiance: None,
            measured_ground_irradiance: None,
            hidden: None,
            occluder_radiance: None,
            sphere_position: None,
            captured_at,
        }
    }
}
