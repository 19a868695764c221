//! What the step knows and has gathered, for all of its parts.

use super::clicks::Click;
use super::gathered::Gathered;
use super::sphere_outline::RoughSphere;
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_camera::Lens;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::{Family, TagMap};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Marker;
use penumbra_rig_model::RigDocument;

/// How the environment camera sees the surroundings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EnvironmentCameraKind {
    /// Through a fisheye.
    Fisheye,
    /// In a mirrored sphere.
    Sphere,
}

/// The user's options.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EnvironmentOptions {
    /// Kind of camera; by default that of `rig.json`, else a fisheye.
    pub kind: Option<EnvironmentCameraKind>,
    /// The fisheye's field of view, radians.
    pub fov: Option<f64>,
    /// Approximate outline of the sphere in the picture.
    pub rough_sphere: Option<RoughSphere>,
    /// Clicks on known points and directions.
    pub clicks: Vec<Click>,
    /// Position of the environment camera, world, metres.
    pub position: Option<DVec3>,
    /// Families of static fiducials that both cameras see but `rig.json` does not list.
    pub families: Vec<Family>,
    /// Maximum error of the orientation in `rig.json`, radians.
    pub max_rotation_error: Option<f64>,
}

/// The rig as known before the step.
#[derive(Clone, Debug)]
pub struct KnownRig {
    /// Its calibration and markers.
    pub rig: RigDocument,
    /// The environment camera's own lens, if it was calibrated.
    pub lens: Option<Lens>,
}

/// Why the step cannot begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotReady {
    /// The lens of the camera that looks at the sphere is unknown.
    #[error(
        "the lens of the camera that looks at the sphere is unknown; add environment_camera with K to rig.json, or run `penumbra calibrate intrinsics --camera environment --model brown`"
    )]
    NoLens,
    /// The radius of the sphere is unknown.
    #[error("the sphere's radius is unknown; add mirror_sphere to rig.json")]
    NoSphere,
    /// A marker has an unknown family or a duplicate number.
    #[error("rig.json: `markers`: {reason}")]
    Markers {
        /// Description of the error.
        reason: String,
    },
}

/// The rig, the user's options and the pictures.
pub(super) struct Inputs {
    pub known: KnownRig,
    pub options: EnvironmentOptions,
    pub kind: EnvironmentCameraKind,
    /// Lens of the camera that looks at a mirrored sphere.
    pub camera: Option<PinholeCamera>,
    pub map: TagMap,
    pub families: Vec<Family>,
    pub gathered: Gathered,
}

impl Inputs {
    /// Derives the kind of camera, its lens and the map of the markers.
    ///
    /// # Errors
    /// See [`super::EnvironmentStep::new`].
    pub fn new(known: KnownRig, asked: EnvironmentOptions) -> Result<Self, NotReady> {
        let view = known.rig.calibration.environment.as_ref().map(|e| &e.view);
        let kind = asked.kind.unwrap_or(match view {
            Some(EnvironmentView::Sphere { .. }) => EnvironmentCameraKind::Sphere,
            _ => EnvironmentCameraKind::Fisheye,
        });
        let camera = match (kind, view, &known.lens) {
            (EnvironmentCameraKind::Fisheye, ..) => None,
            (EnvironmentCameraKind::Sphere, Some(EnvironmentView::Sphere { camera, .. }), _) => {
                Some(camera.clone())
            }
            (EnvironmentCameraKind::Sphere, _, Some(lens)) => lens.as_pinhole(),
            (EnvironmentCameraKind::Sphere, ..) => None,
        };
        if kind == EnvironmentCameraKind::Sphere && camera.is_none() {
            return Err(NotReady::NoLens);
        }
        if kind == EnvironmentCameraKind::Sphere && known.rig.mirror_sphere.is_none() {
            return Err(NotReady::NoSphere);
        }
        let map = tag_map(&known.rig)?;
        let mut families = map.families();
        families.extend(&asked.families);
        families.sort_unstable();
        families.dedup();
        Ok(Self {
            known,
            options: asked,
            kind,
            camera,
            map,
            families,
            gathered: Gathered::default(),
        })
    }

    /// Returns the tone curve of the environment camera.
    pub fn response(&self) -> Response {
        let environment = &self.known.rig.calibration.environment;
        environment
            .as_ref()
            .map_or_else(Response::srgb, |e| e.response.clone())
    }

    /// Returns the environment camera's pose in `rig.json`, if there is one.
    pub fn rough_pose(&self) -> Option<RigidTransform> {
        match &self.known.rig.calibration.environment.as_ref()?.view {
            EnvironmentView::Fisheye {
                world_from_camera, ..
            }
            | EnvironmentView::Sphere {
                world_from_camera, ..
            } => Some(*world_from_camera),
            EnvironmentView::SphereInScene { .. } => None,
        }
    }
}

fn tag_map(rig: &RigDocument) -> Result<TagMap, NotReady> {
    let tags = rig
        .markers
        .iter()
        .map(Marker::tag)
        .collect::<Result<_, _>>();
    let tags = tags.map_err(|e| NotReady::Markers {
        reason: e.to_string(),
    })?;
    TagMap::new(tags).map_err(|e| NotReady::Markers {
        reason: e.to_string(),
    })
}
