//! `rig.json`: what the owner of a rig wrote down about it, read into
//! [`RigCalibration`] and the list of what stands in the scene.
//!
//! `T_a_b` in the file maps coordinates in b to a, as `a_from_b` does here. Unknown keys
//! are passed over, because the file also carries notes for other tools.

use super::json_node::Node;
pub use super::json_node::RigJsonError;
use super::rig::{
    EnvironmentCamera, EnvironmentView, FisheyeLens, MirrorSphere, PhotometricChart,
    RigCalibration, SceneCamera, TrackerCalibration,
};
use super::{PinholeCamera, Response};
use glam::{DMat4, DVec2, DVec3, Vec3};
use penumbra_interface::RigidTransform;

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

/// A large plane `normal · p = offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Unit normal, world.
    pub normal: DVec3,
    /// Metres along the normal.
    pub offset: f64,
    /// Edge of the square that is drawn, metres.
    pub size: f64,
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

/// A lamp that exists in the picture only.
#[derive(Clone, Debug, PartialEq)]
pub struct VirtualLight {
    /// For messages.
    pub name: String,
    /// How it spreads its light.
    pub kind: VirtualLightKind,
    /// Linear, scene camera units: a white diffuse surface at r metres shows
    /// `intensity · cos θ / (π r²)`.
    pub intensity: Vec3,
    /// Path in time, eased with smoothstep between keys.
    pub keys: Vec<VirtualLightKey>,
}

/// How a virtual light spreads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum VirtualLightKind {
    /// The same in all directions.
    Point,
    /// Full inside `beam`, falling linearly in angle to zero at `cutoff`.
    Spot {
        /// Half angle, radians.
        beam: f64,
        /// Half angle, radians.
        cutoff: f64,
    },
}

/// Where a virtual light is at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualLightKey {
    /// Seconds from the session's start.
    pub seconds: f64,
    /// World, metres.
    pub position: DVec3,
    /// What a spot points at, world.
    pub target: Option<DVec3>,
    /// Multiplies the intensity.
    pub gain: f64,
}

/// Which of a rig's views of the environment is used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
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
    let mirror_sphere = sphere_node.map(|n| sphere(&n)).transpose()?;
    Ok(RigDocument {
        calibration: RigCalibration {
            name: name_of(root, "rig")?,
            scene_camera: scene_camera(&root.need("scene_camera", "an object")?)?,
            environment: environment.map(|n| environment_camera(&n)).transpose()?,
            tracker: root.find("tracker").map(|n| tracker(&n)).transpose()?,
            chart: root
                .find("photometric_chart")
                .map(|n| chart(&n))
                .transpose()?,
        },
        mirror_sphere,
        object: root.find("object").map(|n| object(&n)).transpose()?,
        phantoms: each(root, "phantoms", 1000, phantom)?,
        ground: root.find("ground_plane").map(|n| ground(&n)).transpose()?,
        markers: each(root, "markers", 10_000, marker)?,
        virtual_lights: match root.find("virtual_lights") {
            Some(n) => each(&n, "lights", 1000, virtual_light)?,
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

fn scene_camera(node: &Node) -> Result<SceneCamera> {
    Ok(SceneCamera {
        camera: pinhole(node)?,
        response: response(node)?,
        latency_nanos: latency(node)?,
    })
}

fn pinhole(node: &Node) -> Result<PinholeCamera> {
    let (width, height) = node
        .need("image_size", "[width, height] in pixels")?
        .image_size()?;
    let (focal, centre) = node.need("K", "the 3x3 camera matrix")?.camera_matrix()?;
    Ok(PinholeCamera {
        width,
        height,
        focal,
        centre,
        distortion: lens_distortion(node)?,
    })
}

/// `lens_distortion`: `"none"`, OpenCV's list k1, k2, p1, p2 and perhaps k3, or an object
/// with these keys.
fn lens_distortion(node: &Node) -> Result<[f64; 5]> {
    let Some(node) = node.find("lens_distortion") else {
        return Ok([0.0; 5]);
    };
    if node.is_list() {
        return match node.numbers::<4>() {
            Ok([k1, k2, p1, p2]) => Ok([k1, k2, p1, p2, 0.0]),
            Err(_) => node.numbers::<5>(),
        };
    }
    if node.is_object() {
        return coefficients(&node, ["k1", "k2", "p1", "p2", "k3"]);
    }
    match node.text() {
        Ok("none") => Ok([0.0; 5]),
        _ => Err(node.wrong("\"none\", a list k1, k2, p1, p2, k3, or an object with these keys")),
    }
}

fn coefficients<const N: usize>(node: &Node, keys: [&str; N]) -> Result<[f64; N]> {
    let mut out = [0.0; N];
    for (slot, key) in out.iter_mut().zip(keys) {
        if let Some(n) = node.find(key) {
            *slot = n.number()?;
        }
    }
    Ok(out)
}

/// `response`: `"srgb"` (the default), `"linear"`, or `{"gamma": 2.2}`.
fn response(node: &Node) -> Result<Response> {
    let Some(node) = node.find("response") else {
        return Ok(Response::srgb());
    };
    if let Some(gamma) = node.find("gamma") {
        return Ok(Response::gamma(gamma.positive()? as f32));
    }
    match node.text() {
        Ok("srgb") => Ok(Response::srgb()),
        Ok("linear") => Ok(Response::linear()),
        _ => Err(node.wrong("\"srgb\", \"linear\" or {\"gamma\": number}")),
    }
}

/// `latency_s` in nanoseconds; absent means none.
fn latency(node: &Node) -> Result<i64> {
    let Some(node) = node.find("latency_s") else {
        return Ok(0);
    };
    let seconds = node.number()?;
    if seconds.abs() > 10.0 {
        return Err(node.wrong("seconds, at most 10"));
    }
    Ok((seconds * 1e9).round() as i64)
}

fn environment_camera(node: &Node) -> Result<EnvironmentCamera> {
    let brackets = match node.find("brackets_ev") {
        Some(list) => list
            .list(16)?
            .iter()
            .map(Node::number)
            .collect::<Result<_>>()?,
        None => Vec::new(),
    };
    Ok(EnvironmentCamera {
        response: response(node)?,
        view: environment_view(node)?,
        latency_nanos: latency(node)?,
        brackets_ev: brackets,
    })
}

fn environment_view(node: &Node) -> Result<EnvironmentView> {
    let kind = node.need("kind", "\"fisheye\" or \"sphere\"")?;
    let pose = node.need("T_world_cam", "the camera's pose in the world")?;
    let world_from_camera = pose.rigid()?;
    match kind.text()? {
        "fisheye" => Ok(EnvironmentView::Fisheye {
            lens: fisheye(node)?,
            world_from_camera,
        }),
        "sphere" => Ok(EnvironmentView::Sphere {
            camera: pinhole(node)?,
            world_from_camera,
            sphere: sphere(&node.need("mirror_sphere", "the mirrored ball")?)?,
        }),
        _ => Err(kind.wrong("\"fisheye\" or \"sphere\"")),
    }
}

fn fisheye(node: &Node) -> Result<FisheyeLens> {
    let (width, height) = node
        .need("image_size", "[width, height] in pixels")?
        .image_size()?;
    let lens = node.need("projection", "an object with f, cx, cy, max_theta_rad")?;
    if let Some(model) = lens.find("model")
        && !matches!(model.text()?, "equidistant" | "kannala-brandt")
    {
        return Err(model.wrong("\"equidistant\" (with k1..k4 where it departs from it)"));
    }
    let max_theta = lens.need("max_theta_rad", "half the field of view, radians")?;
    if max_theta.positive()? > std::f64::consts::PI {
        return Err(max_theta.wrong("radians, at most pi"));
    }
    Ok(FisheyeLens {
        width,
        height,
        focal: lens
            .need("f", "pixels per radian at the axis")?
            .positive()?,
        centre: DVec2::new(
            lens.need("cx", "pixels")?.number()?,
            lens.need("cy", "pixels")?.number()?,
        ),
        distortion: coefficients(&lens, ["k1", "k2", "k3", "k4"])?,
        max_theta: max_theta.positive()?,
    })
}

fn sphere(node: &Node) -> Result<MirrorSphere> {
    let reflectance = match node.find("reflectance_rgb") {
        Some(n) => n.colour()?,
        None => [1.0; 3],
    };
    Ok(MirrorSphere {
        centre_in_world: node.need("center_world", "x, y, z in metres")?.vector()?,
        radius: node.need("radius", "metres")?.positive()?,
        reflectance,
        in_scene: flag(node, "in_scene_camera_images")?,
    })
}

fn flag(node: &Node, key: &str) -> Result<bool> {
    node.find(key).map_or(Ok(false), |n| n.flag())
}

fn tracker(node: &Node) -> Result<TrackerCalibration> {
    Ok(TrackerCalibration {
        world_from_transmitter: node
            .need("T_world_source", "the transmitter's pose in the world")?
            .rigid()?,
        sensor_from_scene_camera: node
            .need(
                "T_sensor_cam",
                "the scene camera's pose in the sensor's frame",
            )?
            .rigid()?,
        latency_nanos: latency(node)?,
        metres_per_unit: match node.find("fastrak").and_then(|f| f.find("units")) {
            Some(units) => metres_per_unit(&units)?,
            // A FASTRAK sends inches unless it is told otherwise.
            None => 0.0254,
        },
    })
}

fn metres_per_unit(units: &Node) -> Result<f64> {
    match units.text()? {
        "inches" => Ok(0.0254),
        "centimetres" | "centimeters" => Ok(0.01),
        "millimetres" | "millimeters" => Ok(0.001),
        "metres" | "meters" => Ok(1.0),
        _ => Err(units.wrong("\"inches\", \"centimetres\", \"millimetres\" or \"metres\"")),
    }
}

fn chart(node: &Node) -> Result<PhotometricChart> {
    let patches = node.need("patches_xywh", "a list of [x, y, width, height]")?;
    let patches = patches
        .list(10_000)?
        .iter()
        .map(patch)
        .collect::<Result<_>>()?;
    let reflectance = match node.find("reflectance_linear_rgb") {
        Some(n) => n
            .list(10_000)?
            .iter()
            .map(Node::colour)
            .collect::<Result<_>>()?,
        None => Vec::new(),
    };
    let chart = PhotometricChart {
        scene_picture: node.need("scene", "a file name")?.text()?.to_owned(),
        environment_picture: node.need("environment", "a file name")?.text()?.to_owned(),
        patches,
        reflectance,
    };
    if !chart.reflectance.is_empty() && chart.reflectance.len() != chart.patches.len() {
        return Err(node.wrong("given as many reflectances as patches"));
    }
    Ok(chart)
}

fn patch(node: &Node) -> Result<[u32; 4]> {
    let [x, y, w, h] = node.array::<4>()?;
    let patch = [x.pixels()?, y.pixels()?, w.pixels()?, h.pixels()?];
    if patch[2] == 0 || patch[3] == 0 {
        return Err(node.wrong("x, y, width, height with width and height above 0"));
    }
    Ok(patch)
}

fn object(node: &Node) -> Result<ObjectPlacement> {
    let world_from_glb = match node.find("T_world_glb") {
        Some(n) => n.transform()?,
        None => {
            let world_from_object = node
                .need(
                    "T_world_object",
                    "the object's pose in the world, or T_world_glb",
                )?
                .transform()?;
            world_from_object * z_up_from_y_up()
        }
    };
    Ok(ObjectPlacement {
        file: node.need("glb", "a file name")?.text()?.to_owned(),
        world_from_glb,
    })
}

/// glTF's +Y-up coordinates to Penumbra's +Z-up: x stays, y becomes z, z becomes −y.
#[must_use]
pub fn z_up_from_y_up() -> DMat4 {
    DMat4::from_cols_array_2d(&[
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ])
}

fn albedo(node: &Node) -> Result<Option<Vec3>> {
    let Some(node) = node.find("albedo_linear_rgb") else {
        return Ok(None);
    };
    let rgb = node.colour()?;
    if rgb.iter().any(|c| *c > 1.0) {
        return Err(node.wrong("three numbers between 0 and 1"));
    }
    Ok(Some(Vec3::from(rgb)))
}

fn phantom(node: &Node) -> Result<PhantomPlacement> {
    let in_world = match node.find("ply_frame") {
        Some(frame) => match frame.text()? {
            "world" => true,
            "phantom" | "local" => false,
            _ => return Err(frame.wrong("\"world\" or \"phantom\"")),
        },
        None => true,
    };
    let world_from_file = if in_world {
        DMat4::IDENTITY
    } else {
        node.need("pose", "the phantom's pose in the world")?
            .transform()?
    };
    Ok(PhantomPlacement {
        name: name_of(node, "phantom")?,
        file: node.need("ply", "a file name")?.text()?.to_owned(),
        world_from_file,
        mirror: flag(node, "mirror")?,
        albedo: albedo(node)?,
    })
}

fn ground(node: &Node) -> Result<GroundPlane> {
    let normal = match node.find("normal") {
        Some(n) => n
            .vector()?
            .try_normalize()
            .ok_or_else(|| n.wrong("a direction other than 0, 0, 0"))?,
        None => DVec3::Z,
    };
    Ok(GroundPlane {
        normal,
        offset: node.find("offset").map_or(Ok(0.0), |n| n.number())?,
        size: node.find("size_m").map_or(Ok(10.0), |n| n.positive())?,
        albedo: albedo(node)?,
    })
}

fn marker(node: &Node) -> Result<Marker> {
    let family = node.need("family", "e.g. \"tag36h11\"")?.text()?.to_owned();
    Ok(Marker {
        family,
        id: node.need("id", "a whole number")?.pixels()?,
        size: node.need("size_m", "metres")?.positive()?,
        world_from_marker: node
            .need("T_world_marker", "the marker's pose in the world")?
            .rigid()?,
    })
}

fn virtual_light(node: &Node) -> Result<VirtualLight> {
    let kind = light_kind(node)?;
    let keys = node.need("keys", "a list of t, pos, target, gain")?;
    let keys: Vec<_> = keys
        .list(100_000)?
        .iter()
        .map(light_key)
        .collect::<Result<_>>()?;
    let aimless = keys.iter().any(|k| k.target.is_none());
    if keys.is_empty() || (aimless && kind != VirtualLightKind::Point) {
        return Err(node.wrong("given at least one key, and a target in each if it is a spot"));
    }
    Ok(VirtualLight {
        name: name_of(node, "light")?,
        kind,
        intensity: Vec3::from(node.need("intensity", "linear RGB")?.colour()?),
        keys,
    })
}

fn light_kind(node: &Node) -> Result<VirtualLightKind> {
    let kind = node.need("kind", "\"point\" or \"spot\"")?;
    match kind.text()? {
        "point" => Ok(VirtualLightKind::Point),
        "spot" => Ok(VirtualLightKind::Spot {
            beam: node.need("beam_deg", "degrees")?.positive()?.to_radians(),
            cutoff: node.need("cutoff_deg", "degrees")?.positive()?.to_radians(),
        }),
        _ => Err(kind.wrong("\"point\" or \"spot\"")),
    }
}

fn light_key(node: &Node) -> Result<VirtualLightKey> {
    Ok(VirtualLightKey {
        seconds: node.need("t", "seconds")?.number()?,
        position: node.need("pos", "x, y, z in metres")?.vector()?,
        target: node.find("target").map(|n| n.vector()).transpose()?,
        gain: node.find("gain").map_or(Ok(1.0), |n| n.number())?,
    })
}

#[cfg(test)]
mod tests;
