//! Everything that a `rig.json` states, and the choice between its views of the environment.

use super::error::RigJsonError;
use crate::{EnvironmentCamera, RigCalibration, SceneCamera};
use glam::{DMat4, DVec2, Vec3};
use penumbra_camera::{EnvironmentView, MirrorSphere, PinholeCamera, Response};
use penumbra_fiducials::{Tag, UnknownFamily};
use penumbra_interface::RigidTransform;
use penumbra_scene::{GroundPlane, VirtualLight};

type Result<T> = std::result::Result<T, RigJsonError>;

/// Contents of a `rig.json`.
#[derive(Clone, Debug)]
pub struct RigDocument {
    /// Cameras, tracker, chart.
    pub calibration: RigCalibration,
    /// The mirrored sphere, which the file may hold at its root or in the environment camera.
    pub mirror_sphere: Option<MirrorSphere>,
    /// The virtual object, if the session has one.
    pub object: Option<ObjectPlacement>,
    /// Proxies of real objects.
    pub phantoms: Vec<PhantomPlacement>,
    /// The ground that the objects stand on.
    pub ground: Option<GroundPlane>,
    /// Fiducials at fixed poses in the world.
    pub markers: Vec<Marker>,
    /// Virtual lights: they light real objects in the picture only.
    pub virtual_lights: Vec<VirtualLight>,
}

/// The virtual object's glTF and its placement.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectPlacement {
    /// Name of the attachment, e.g. `object/object.glb`.
    pub file: String,
    /// Maps the file's coordinates (+Y up, metres) to the world.
    pub world_from_glb: DMat4,
}

/// A phantom object: proxy of a real one.
#[derive(Clone, Debug, PartialEq)]
pub struct PhantomPlacement {
    /// Name, for messages.
    pub name: String,
    /// Name of the PLY attachment.
    pub file: String,
    /// Maps the file's coordinates (metres) to the world.
    pub world_from_file: DMat4,
    /// The surface is a mirror.
    pub mirror: bool,
    /// Linear diffuse reflectance, 0 to 1; `None` if unknown.
    pub albedo: Option<Vec3>,
}

/// A printed fiducial.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// Name of the family, e.g. `tag36h11`.
    pub family: String,
    /// Number within the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size: f64,
    /// Pose in the world; the marker's +Z points into the paper.
    pub world_from_marker: RigidTransform,
}

impl Marker {
    /// Returns the marker as a tag of a map in world coordinates.
    ///
    /// # Errors
    /// The family is unknown.
    pub fn tag(&self) -> std::result::Result<Tag, UnknownFamily> {
        Ok(Tag {
            family: self.family.parse()?,
            id: self.id,
            size: self.size,
            map_from_tag: self.world_from_marker,
        })
    }
}

/// The view of the environment that is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnvironmentSource {
    /// The environment camera if it was recorded, otherwise the sphere in the scene camera's
    /// picture.
    #[default]
    Auto,
    /// The environment camera.
    Camera,
    /// The mirrored sphere in the scene camera's picture.
    SphereInScene,
    /// The environment map that the configuration names: light that is stated, not measured.
    Map,
}

impl RigDocument {
    /// Creates the document of an uncalibrated rig with pictures of `width` × `height` pixels: its
    /// pictures can be shown, without virtual objects.
    #[must_use]
    pub fn uncalibrated(width: u32, height: u32) -> Self {
        let (w, h) = (f64::from(width), f64::from(height));
        Self {
            calibration: RigCalibration {
                name: "uncalibrated".to_owned(),
                scene_camera: SceneCamera {
                    camera: PinholeCamera {
                        width,
                        height,
                        // A typical lens: 60 degrees across.
                        focal: DVec2::splat(w / 2.0 / 30_f64.to_radians().tan()),
                        centre: DVec2::new(w - 1.0, h - 1.0) / 2.0,
                        distortion: [0.0; 5],
                    },
                    response: Response::srgb(),
                    vignetting: None,
                    noise: None,
                    spread: None,
                    latency_nanos: 0,
                },
                environment: None,
                sphere_marker: None,
                tracker: None,
                chart: None,
                gains: None,
            },
            mirror_sphere: None,
            object: None,
            phantoms: Vec::new(),
            ground: None,
            markers: Vec::new(),
            virtual_lights: Vec::new(),
        }
    }

    /// Chooses the view of the environment. `camera_recorded`: there is a stream of environment
    /// pictures. With [`EnvironmentSource::Auto`] and no usable view, the calibration's
    /// `environment` becomes `None`.
    ///
    /// # Errors
    /// `rig.json` lacks the view that `source` asks for by name.
    pub fn select_environment(
        &mut self,
        source: EnvironmentSource,
        camera_recorded: bool,
    ) -> Result<()> {
        let has_camera = self.calibration.environment.is_some();
        match source {
            EnvironmentSource::Camera if !has_camera => Err(RigJsonError::Missing {
                path: "environment_camera".into(),
                expected: "the configuration asks for [environment] source = \"camera\"",
            }),
            EnvironmentSource::Camera => Ok(()),
            EnvironmentSource::Auto if has_camera && camera_recorded => Ok(()),
            EnvironmentSource::Auto => {
                self.calibration.environment = self.sphere_in_scene();
                Ok(())
            }
            EnvironmentSource::Map => {
                self.calibration.environment = None;
                Ok(())
            }
            EnvironmentSource::SphereInScene => {
                let view = self.sphere_in_scene().ok_or(RigJsonError::Missing {
                    path: "environment_camera.mirror_sphere".into(),
                    expected: "a sphere with in_scene_camera_images = true, as [environment] source = \"sphere-in-scene\" needs",
                })?;
                self.calibration.environment = Some(view);
                Ok(())
            }
        }
    }

    /// Returns the scene camera as environment camera, through the sphere that it sees.
    fn sphere_in_scene(&self) -> Option<EnvironmentCamera> {
        let sphere = self.mirror_sphere.clone().filter(|s| s.in_scene)?;
        Some(EnvironmentCamera {
            response: self.calibration.scene_camera.response.clone(),
            vignetting: self.calibration.scene_camera.vignetting,
            view: EnvironmentView::SphereInScene { sphere },
            latency_nanos: self.calibration.scene_camera.latency_nanos,
            brackets_ev: Vec::new(),
        })
    }
}
