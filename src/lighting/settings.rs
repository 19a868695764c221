//! What can be chosen, what is given for each instant, and what can go wrong.

use super::clipped::ClippedEnergy;
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

/// What can be chosen.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvironmentSettings {
    /// Texels a side of the cube map, a power of two.
    pub cube_size: u32,
    /// Where dome lights are put.
    pub placement: LightPlacement,
    /// Dome lights at most.
    pub lights: usize,
    /// There is phantom ground: no light comes from below.
    pub ground: bool,
    /// How irradiance is computed.
    pub irradiance: IrradianceMethod,
    /// What is done about sources that every exposure clips.
    pub clipped: ClippedEnergy,
    /// What counts as a compact source.
    pub sources: SourceSettings,
    /// Reflectance of the ground where nothing shows its radiance.
    pub fallback_ground_albedo: f32,
    /// World height of the ground, metres, for what is read from the shadows on it.
    pub ground_height: f64,
    /// Carries light from where it is seen to where it is needed.
    pub parallax: Option<Parallax>,
    /// Seconds for which a direction seen last on a sphere in the scene outweighs a new,
    /// worse view of it.
    pub memory_seconds: f32,
    /// Frequency of the geodesic dome whose faces are lit, for shadowing planes.
    pub faces: Option<u32>,
    /// How reflections are filtered.
    pub filtering: Filtering,
    /// Lobes of Phong's model are filtered, too.
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

/// Why there is no light from a picture.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum EnvironmentError {
    /// The picture and the calibration disagree.
    #[error(
        "environment picture is {got_width}x{got_height}, its calibration says {width}x{height}: calibrate the camera at the size it records, or set its size to the calibration's"
    )]
    PictureSize {
        /// Calibrated.
        width: u32,
        /// Calibrated.
        height: u32,
        /// The picture's.
        got_width: u32,
        /// The picture's.
        got_height: u32,
    },
    /// Nothing to go by.
    #[error("no environment picture was given")]
    NoPicture,
    /// The sphere is in the scene camera's picture, and where that looks is unknown.
    #[error(
        "the mirrored sphere is in the scene camera's picture, and that camera's pose is not known"
    )]
    NoScenePose,
    /// Impossible geometry.
    #[error(
        "the camera is inside the mirrored sphere: check centre and radius (metres) of the sphere and the camera's pose"
    )]
    InsideSphere,
    /// The cube's size.
    #[error("cube size {0} is not a power of two between 16 and 512")]
    CubeSize(u32),
}

/// Where the mirrored sphere is, and how well that is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BallSeen {
    /// Its centre, world, metres.
    pub centre_in_world: DVec3,
    /// Standard deviation of its picture, each way, pixels.
    pub sigma: f64,
}

/// One instant's pictures and what else is known.
pub struct EnvironmentInput<'a> {
    /// Exposures of the instant, in any order.
    pub brackets: &'a [Bracket<'a>],
    /// Pose and intrinsics of the scene camera, for a sphere in its picture.
    pub scene: Option<(RigidTransform, &'a PinholeCamera)>,
    /// From the environment camera's linear values to the scene camera's.
    pub gains: Mat3,
    /// Mean radiance of the ground around the objects, scene camera units.
    pub ground_radiance: Option<Vec3>,
    /// Irradiance of the ground as measured elsewhere, scene camera units.
    pub measured_ground_irradiance: Option<Vec3>,
    /// Rays that end on a phantom other than the mirrored sphere itself, for a sphere in
    /// the scene camera's picture (the camera's rays and the mirror's). Views that stand still take theirs at the start.
    pub hidden: Option<&'a Hidden<'a>>,
    /// Mean radiance of those phantoms in the scene camera's picture, scene camera units.
    pub hider_radiance: Option<Vec3>,
    /// Where a sphere in the scene camera's picture is at this instant. Given, it is looked for
    /// near there; else it is taken to be exactly where the calibration says.
    pub ball: Option<BallSeen>,
    /// Middle of the exposure.
    pub captured_at: MonotonicTime,
}

impl<'a> EnvironmentInput<'a> {
    /// Pictures alone: no scene camera, gains of one, nothing measured elsewhere.
    #[must_use]
    pub fn new(brackets: &'a [Bracket<'a>], captured_at: MonotonicTime) -> Self {
        Self {
            brackets,
            scene: None,
            gains: Mat3::IDENTITY,
            ground_radiance: None,
            measured_ground_irradiance: None,
            hidden: None,
            hider_radiance: None,
            ball: None,
            captured_at,
        }
    }
}
