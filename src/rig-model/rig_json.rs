//! `rig.json`: what the owner of a rig wrote down about it, read into
//! [`RigCalibration`] and the list of what stands in the scene.
//!
//! `T_a_b` in the file maps coordinates in b to a, as `a_from_b` does here. Unknown keys
//! are passed over, because the file also carries notes for other tools.

use super::json_node::Node;
pub use super::json_node::RigJsonError;
use crate::{EnvironmentCamera, RigCalibration, SceneCamera};
use cameras::{chart, environment_camera, scene_camera, sphere, tracker};
use glam::{DMat4, DVec2, Vec3};
use penumbra_camera::{EnvironmentView, MirrorSphere};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_fiducials::{Tag, UnknownFamily};
use penumbra_interface::RigidTransform;
use penumbra_scene::lamps::MOST_LAMPS;
use penumbra_scene::{GroundPlane, VirtualLight};
use things::{ground, marker, object, phantom, virtual_light};

mod cameras;
mod things;

type Result<T> = std::result::Result<T, RigJsonError>;

/// No calibration is larger, bytes.
const LARGEST_FILE: usize = 16 << 20;

/// Everything a `rig.json` says.
#[derive(Clone, Debug)]
pub struct RigDocument {
    /// Cameras, tracker, chart.
    pub calibration: RigCalibration,
    /// The mirrored ball, wherever the file mentions it.
    pub mirror_sphere: Option<MirrorSphere>,
    /// The virtual object, if the session brings one.
    pub object: Option<ObjectPlacement>,
    /// Proxies of real things.
    pub phantoms: Vec<PhantomPlacement>,
    /// The plane that everything stands on.
    pub ground: Option<GroundPlane>,
    /// Fiducials fixed in the world.
    pub markers: Vec<Marker>,
    /// Lights that shine on real things in the picture only.
    pub virtual_lights: Vec<VirtualLight>,
}

/// Where the virtual object's glTF goes.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectPlacement {
    /// Name of the attachment, e.g. `object/object.glb`.
    pub file: String,
    /// Maps the file's own coordinates (+Y up) to the world.
    pub world_from_glb: DMat4,
}

/// One phantom object.
#[derive(Clone, Debug, PartialEq)]
pub struct PhantomPlacement {
    /// For messages.
    pub name: String,
    /// Name of the PLY attachment.
    pub file: String,
    /// Maps the file's coordinates to the world.
    pub world_from_file: DMat4,
    /// The surface mirrors.
    pub mirror: bool,
    /// Linear diffuse reflectance, where known.
    pub albedo: Option<Vec3>,
}

/// A printed fiducial.
#[derive(Clone, Debug, PartialEq)]
pub struct Marker {
    /// E.g. `tag36h11`.
    pub family: String,
    /// Number within the family.
    pub id: u32,
    /// Edge of the black border, metres.
    pub size: f64,
    /// Pose in the world: +Z into the paper.
    pub world_from_marker: RigidTransform,
}

impl Marker {
    /// As the registration has it.
    ///
    /// # Errors
    /// A family that is not known.
    pub fn tag(&self) -> std::result::Result<Tag, UnknownFamily> {
        Ok(Tag {
            family: self.family.parse()?,
            id: self.id,
            size: self.size,
            map_from_tag: self.world_from_marker,
        })
    }
}

/// Which of a rig's views of the environment is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnvironmentSource {
    /// The environment camera if it was recorded, else the sphere in the scene camera's
    /// picture.
    #[default]
    Auto,
    /// The environment camera.
    Camera,
    /// The mirrored sphere in the scene camera's own picture.
    SphereInScene,
}

impl RigDocument {
    /// Of a rig that nobody has calibrated: its picture can be shown, and nothing in it.
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
                        // A usual lens: 60 degrees across.
                        focal: DVec2::splat(w / 2.0 / 30_f64.to_radians().tan()),
                        centre: DVec2::new(w - 1.0, h - 1.0) / 2.0,
                        distortion: [0.0; 5],
                    },
                    response: Response::srgb(),
                    vignetting: None,
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

    /// Reads the bytes of a `rig.json`.
    pub fn parse(bytes: &[u8]) -> Result<Self> {
        if bytes.len() > LARGEST_FILE {
            return Err(RigJsonError::TooLarge {
                bytes: bytes.len(),
                limit: LARGEST_FILE,
            });
        }
        let value = serde_json::from_slice(bytes).map_err(|e| RigJsonError::NotJson {
            line: e.line(),
            column: e.column(),
            reason: e.to_string(),
        })?;
        document(&Node::root(&value))
    }

    /// Chooses the view of the environment. `camera_recorded` says whether there is a
    /// stream of environment pictures. Without any usable view the calibration's
    /// `environment` becomes `None`, unless one was asked for by name: then the missing
    /// key is named.
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

    /// The scene camera as its own environment camera, by way of the sphere it sees.
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

fn document(root: &Node) -> Result<RigDocument> {
    if !root.is_object() {
        return Err(RigJsonError::Missing {
            path: "scene_camera".into(),
            expected: "an object with image_size and K",
        });
    }
    let environment = root.find("environment_camera");
    let sphere_node = environment
        .as_ref()
        .and_then(|e| e.find("mirror_sphere"))
        .or_else(|| root.find("mirror_sphere"));
    let markers = each(root, "markers", 10_000, marker)?;
    let placed = sphere_node.map(|n| sphere(&n, &markers)).transpose()?;
    let (mirror_sphere, sphere_marker) = placed.unzip();
    Ok(RigDocument {
        calibration: RigCalibration {
            name: name_of(root, "rig")?,
            scene_camera: scene_camera(&root.need("scene_camera", "an object")?)?,
            environment: environment
                .map(|n| environment_camera(&n, &markers))
                .transpose()?,
            sphere_marker: sphere_marker.flatten(),
            tracker: root.find("tracker").map(|n| tracker(&n)).transpose()?,
            chart: root
                .find("photometric_chart")
                .map(|n| chart(&n))
                .transpose()?,
            gains: None,
        },
        mirror_sphere,
        object: root.find("object").map(|n| object(&n)).transpose()?,
        phantoms: each(root, "phantoms", 1000, phantom)?,
        ground: root.find("ground_plane").map(|n| ground(&n)).transpose()?,
        markers,
        virtual_lights: match root.find("virtual_lights") {
            Some(n) => each(&n, "lights", MOST_LAMPS, virtual_light)?,
            None => Vec::new(),
        },
    })
}

fn each<T>(node: &Node, key: &str, most: usize, read: fn(&Node) -> Result<T>) -> Result<Vec<T>> {
    match node.find(key) {
        Some(list) => list.list(most)?.iter().map(read).collect(),
        None => Ok(Vec::new()),
    }
}

fn name_of(node: &Node, default: &str) -> Result<String> {
    node.find("name")
        .map_or(Ok(default.to_owned()), |n| n.text().map(str::to_owned))
}

#[cfg(test)]
mod tests;
