//! Everything that differs from frame to frame.

use super::exposure::choice::Exposure;
use super::look::Look;
use super::planes::options::PlanesChoice;
use super::reproject::Reprojection;
use super::shadow_slots::Refresh;
use glam::Vec3;
use penumbra_camera::{PinholeCamera, RollingShutter, Vignetting};
use penumbra_interface::RigidTransform;
use penumbra_lighting::Lighting;
use penumbra_picture::Picture;
use penumbra_scene::{Highlights, IndirectLight, LampResponse, PlacedLamp, ShadowMode};

/// The light of a later picture.
#[derive(Clone, Copy)]
pub struct ComingLight<'a> {
    /// The light.
    pub lighting: &'a Lighting,
    /// Light that virtual objects reflect onto the real scene under it, if that is known.
    pub indirect: Option<&'a IndirectLight>,
}

/// The input of one frame. [`FrameInput::new`] shows the camera picture alone; struct update
/// syntax adds the rest.
#[derive(Clone, Copy)]
pub struct FrameInput<'a> {
    /// Time since the session began, seconds: the instant at which moving parts are shown.
    pub seconds: f64,
    /// The scene camera's picture.
    pub picture: &'a Picture,
    /// The scene camera.
    pub camera: &'a PinholeCamera,
    /// Vignetting of the camera: virtual objects darken towards the edge in the same way.
    pub vignetting: Option<Vignetting>,
    /// Motion of the camera while its rows are read one after the other; `None` for a global
    /// shutter or a camera at rest.
    pub rolling_shutter: Option<RollingShutter>,
    /// Pose of the camera at the middle of the exposure of the middle row; `None` shows the
    /// camera picture alone.
    pub world_from_camera: Option<RigidTransform>,
    /// Pose from which the finished picture is viewed; `None` shows it as it was taken.
    pub reprojection: Option<Reprojection>,
    /// The light; `None` shows the camera picture alone.
    pub lighting: Option<&'a Lighting>,
    /// Light that virtual objects reflect onto the real scene under `lighting`, if it is known.
    pub indirect_light: Option<&'a IndirectLight>,
    /// The light of the next picture, as far as it is known: of what is computed in the background
    /// until then.
    pub coming_light: Option<ComingLight<'a>>,
    /// Whether the picture does not follow the one before in time: nothing that was computed for
    /// earlier pictures is shown with it.
    pub is_start: bool,
    /// Virtual lights; those after the first [`penumbra_scene::lamps::MAX_LAMPS`] are ignored.
    pub lamps: &'a [PlacedLamp],
    /// How real surfaces respond to them.
    pub lamp_response: LampResponse,
    /// Direction to the brightest physical light, world, times its dominance
    /// ([`penumbra_lighting::BrightestLight::vector`]): for [`LampResponse::Paper`].
    pub brightest: Vec3,
    /// How shadows darken the real picture.
    pub shadow_mode: ShadowMode,
    /// Strength of shadows: 0 = none, 1 = as estimated.
    pub shadow_strength: f32,
    /// Which shadow maps are drawn again.
    pub refresh: Refresh,
    /// Whether virtual objects are drawn at all.
    pub show_virtual: bool,
    /// Shadows by shadowing planes instead of shadow maps, where a bake was set
    /// ([`crate::Compositor::set_bake`]).
    pub planes: Option<PlanesChoice>,
    /// The exposure in which the frame is shown.
    pub exposure: Exposure,
    /// How clipped areas are shown in a shorter exposure.
    pub highlights: Highlights,
    /// The camera's look, which virtual objects are given.
    pub look: Look,
}

impl<'a> FrameInput<'a> {
    /// The camera picture alone: no pose, no light; shadows at full strength, all shadow maps
    /// drawn again where they are out of date, virtual objects shown.
    #[must_use]
    pub fn new(picture: &'a Picture, camera: &'a PinholeCamera) -> Self {
        Self {
            seconds: 0.0,
            picture,
            camera,
            vignetting: None,
            rolling_shutter: None,
            world_from_camera: None,
            reprojection: None,
            lighting: None,
            indirect_light: None,
            coming_light: None,
            is_start: false,
            lamps: &[],
            lamp_response: LampResponse::Intrinsic,
            brightest: Vec3::ZERO,
            shadow_mode: ShadowMode::Ratio,
            shadow_strength: 1.0,
            refresh: Refresh::UpTo(usize::MAX),
            show_virtual: true,
            planes: None,
            exposure: Exposure::Camera,
            highlights: Highlights::default(),
            look: Look::default(),
        }
    }
}
