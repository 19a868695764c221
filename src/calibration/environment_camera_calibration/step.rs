//! The step `environment`: what it wants, what it gathers, and what it says in the end.

use super::super::step::{Eye, Finished, Made, Progress, Shown, ShownPicture, Step, Wants};
use super::ball::RoughBall;
use super::bright::Bright;
use super::gathered::{Gathered, SceneView};
use super::pairs::Pair;
use super::solve;
use glam::{DVec2, DVec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::Lens;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::{Detector, Family, Registrar, TagMap};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Marker;
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::environment_file::STEP;

/// Pictures of the environment camera that are enough.
const ENOUGH: f64 = 10.0;

/// How the surroundings are seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Through a fisheye.
    Fisheye,
    /// In a mirrored sphere.
    Sphere,
}

/// What the user asks for and knows.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Asked {
    /// What `rig.json` says is taken where this is none; a fisheye where that says nothing.
    pub kind: Option<Kind>,
    /// The fisheye's field of view, radians.
    pub fov: Option<f64>,
    /// Where the sphere is in the picture.
    pub click: Option<RoughBall>,
    /// Clicks on known things.
    pub pairs: Vec<Pair>,
    /// Where the environment camera stands, world, metres.
    pub at: Option<DVec3>,
    /// Families of fiducials that are not in `rig.json` but stand still before both cameras.
    pub families: Vec<Family>,
    /// The orientation that `rig.json` says may be off by this much, radians.
    pub rough: Option<f64>,
}

/// What is known of the rig.
#[derive(Clone, Debug)]
pub struct KnownRig {
    /// Calibration and markers.
    pub rig: RigDocument,
    /// The environment camera's own lens, if it was calibrated.
    pub lens: Option<Lens>,
}

/// The step cannot begin.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NotReady {
    /// No intrinsics.
    #[error(
        "the camera before the sphere needs its lens: write environment_camera with K into rig.json, or calibrate with `penumbra calibrate intrinsics --camera environment --model brown`"
    )]
    NoLens,
    /// No size.
    #[error("the sphere's radius is not known: write mirror_sphere into rig.json")]
    NoSphere,
    /// A family that is not known, or a number twice.
    #[error("rig.json: `markers`: {reason}")]
    Markers {
        /// Why.
        reason: String,
    },
}

/// The step.
pub struct EnvironmentStep {
    pub(super) known: KnownRig,
    pub(super) asked: Asked,
    pub(super) kind: Kind,
    /// Of the camera before a sphere.
    pub(super) camera: Option<PinholeCamera>,
    pub(super) map: TagMap,
    pub(super) families: Vec<Family>,
    pub(super) gathered: Gathered,
    registrar: Registrar,
    detector: Detector,
    marks: Vec<DVec2>,
}

impl EnvironmentStep {
    /// Of this rig.
    ///
    /// # Errors
    /// [`NotReady`].
    pub fn new(known: KnownRig, asked: Asked) -> Result<Self, NotReady> {
        let view = known.rig.calibration.environment.as_ref().map(|e| &e.view);
        let said = match view {
            Some(EnvironmentView::Sphere { .. }) => Kind::Sphere,
            _ => Kind::Fisheye,
        };
        let kind = asked.kind.unwrap_or(said);
        let camera = match (kind, view, &known.lens) {
            (Kind::Fisheye, ..) => None,
            (Kind::Sphere, Some(EnvironmentView::Sphere { camera, .. }), _) => Some(camera.clone()),
            (Kind::Sphere, _, Some(lens)) => lens.as_pinhole(),
            (Kind::Sphere, ..) => None,
        };
        if kind == Kind::Sphere && camera.is_none() {
            return Err(NotReady::NoLens);
        }
        if kind == Kind::Sphere && known.rig.mirror_sphere.is_none() {
            return Err(NotReady::NoSphere);
        }
        let map = map(&known.rig)?;
        let mut families = map.families();
        families.extend(&asked.families);
        families.sort_unstable();
        families.dedup();
        let response = &known.rig.calibration.scene_camera.response;
        Ok(Self {
            detector: Detector::new(&families, response),
            registrar: Registrar::new(map.clone()),
            map,
            families,
            camera,
            kind,
            asked,
            known,
            gathered: Gathered::default(),
            marks: Vec::new(),
        })
    }

    /// Tone curve of the environment camera.
    pub(super) fn response(&self) -> Response {
        let environment = &self.known.rig.calibration.environment;
        environment
            .as_ref()
            .map_or_else(Response::srgb, |e| e.response.clone())
    }

    /// The pose that is written down.
    pub(super) fn rough_pose(&self) -> Option<RigidTransform> {
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

    fn scene(&mut self, shown: &ShownPicture) {
        let calibration = &self.known.rig.calibration;
        let camera = &calibration.scene_camera;
        let fits = (shown.picture.width, shown.picture.height)
            == (camera.camera.width, camera.camera.height);
        if !fits {
            return;
        }
        let at = shown
            .captured_at
            .offset_nanos(camera.latency_nanos.saturating_neg());
        let tags = if self.families.is_empty() {
            Vec::new()
        } else {
            self.detector
                .detect(shown.picture, Some(&camera.camera))
                .to_vec()
        };
        self.marks = tags.iter().flat_map(|t| t.corners).collect();
        let found = self.registrar.register(&camera.camera, &tags, at);
        let sure = found.filter(|f| f.how != penumbra_fiducials::Registration::TagGuessed);
        self.gathered.scene(SceneView {
            at,
            seconds: shown.seconds,
            bright: Bright::of(shown.picture, &camera.response),
            tags,
            by_markers: sure.map(|f| f.map_from_camera),
        });
    }
}

fn map(rig: &RigDocument) -> Result<TagMap, NotReady> {
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

impl Step for EnvironmentStep {
    fn name(&self) -> &'static str {
        STEP
    }

    fn wants(&self) -> Wants {
        Wants {
            scene: true,
            environment: true,
            brackets: false,
            poses: true,
            spacing: 0.06,
        }
    }

    fn look(&mut self, shown: &Shown) {
        match shown {
            Shown::Picture(shown) if shown.eye == Eye::Environment => {
                let response = self.response();
                self.gathered.environment(shown.picture, &response);
            }
            Shown::Picture(shown) => self.scene(shown),
            Shown::Pose(sample) => {
                let tracker = self.known.rig.calibration.tracker.as_ref();
                if let Some(tracker) = tracker.filter(|_| sample.station == 1) {
                    let at = tracker.measured_at(sample.arrived_at);
                    self.gathered.poses.push(at, sample.transmitter_from_sensor);
                }
            }
        }
    }

    fn progress(&self) -> Progress {
        let environment = f64::from(self.gathered.layers.count);
        let placed = self
            .gathered
            .views
            .iter()
            .filter(|v| v.by_markers.is_some());
        let hint = match () {
            () if environment == 0.0 => "let the environment camera see",
            () if self.gathered.views.is_empty() => "let the scene camera see",
            () if self.gathered.views.len() < 10 => "go on; turn the scene camera to the lights",
            () => "",
        };
        Progress {
            share: (environment / ENOUGH).min(1.0),
            message: format!(
                "{environment} pictures of the environment camera, {} of the scene camera, {} with markers",
                self.gathered.views.len(),
                placed.count()
            ),
            hint: hint.to_owned(),
            marks: self.marks.clone(),
            eye: Some(Eye::Scene),
        }
    }

    fn finish(&mut self, made: &Made) -> Finished {
        solve::finish(self, made)
    }
}
