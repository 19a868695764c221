//! Cameras, mirrored sphere, tracker and colour chart of a `rig.json`.

use super::document::Marker;
use super::error::RigJsonError;
use super::values::{
    Array, CameraMatrix, Colour, Count, Focal, ImageSize, Latency, List, Number, Pose, Positive,
    Vector,
};
use crate::{EnvironmentCamera, SceneCamera, SphereMarker, TrackerCalibration};
use glam::{DVec2, DVec3};
use penumbra_camera::{
    EnvironmentView, FisheyeLens, MirrorSphere, PinholeCamera, Response as ToneCurve,
};
use penumbra_white_balance::chart::PhotometricChart;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::value::{MapAccessDeserializer, SeqAccessDeserializer};
use serde::de::{Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::{Deserialize, Deserializer};
use std::borrow::Cow;
use std::fmt;

type Result<T> = std::result::Result<T, RigJsonError>;

/// `"srgb"` (the default), `"linear"`, or `{"gamma": 2.2}`.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(
    rename_all = "lowercase",
    expecting = "\"srgb\", \"linear\" or {\"gamma\": number}"
)]
enum Response {
    #[default]
    Srgb,
    Linear,
    Gamma(Positive),
}

impl Response {
    fn tone_curve(self) -> ToneCurve {
        match self {
            Self::Srgb => ToneCurve::srgb(),
            Self::Linear => ToneCurve::linear(),
            Self::Gamma(exponent) => ToneCurve::gamma(exponent.0 as f32),
        }
    }
}

/// k1, k2, p1, p2, k3 of Brown and Conrady, written as `"none"`, as OpenCV's list of four or five,
/// or as an object.
#[derive(Clone, Copy, Debug, Default)]
struct LensDistortion([f64; 5]);

#[derive(Deserialize, JsonSchema)]
struct Coefficients {
    k1: Option<Number>,
    k2: Option<Number>,
    p1: Option<Number>,
    p2: Option<Number>,
    k3: Option<Number>,
}

struct LensDistortionVisitor;

impl<'de> Visitor<'de> for LensDistortionVisitor {
    type Value = LensDistortion;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("\"none\", a list k1, k2, p1, p2, k3, or an object with these keys")
    }

    fn visit_str<E: Error>(self, text: &str) -> std::result::Result<LensDistortion, E> {
        match text {
            "none" => Ok(LensDistortion::default()),
            _ => Err(E::invalid_value(Unexpected::Str(text), &self)),
        }
    }

    fn visit_seq<A: SeqAccess<'de>>(
        self,
        list: A,
    ) -> std::result::Result<LensDistortion, A::Error> {
        let list = List::<Number, 4, 5>::deserialize(SeqAccessDeserializer::new(list))?;
        let mut out = [0.0; 5];
        for (slot, number) in out.iter_mut().zip(list.0) {
            *slot = number.0;
        }
        Ok(LensDistortion(out))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<LensDistortion, A::Error> {
        let c = Coefficients::deserialize(MapAccessDeserializer::new(map))?;
        let all = [c.k1, c.k2, c.p1, c.p2, c.k3];
        Ok(LensDistortion(all.map(|k| k.map_or(0.0, |k| k.0))))
    }
}

impl JsonSchema for LensDistortion {
    fn inline_schema() -> bool {
        true
    }

    fn schema_name() -> Cow<'static, str> {
        "LensDistortion".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "description": "Brown and Conrady: \"none\", a list k1, k2, p1, p2, k3, or an object with these keys.",
            "anyOf": [
                { "const": "none" },
                List::<Number, 4, 5>::json_schema(generator),
                Coefficients::json_schema(generator),
            ],
        })
    }
}

impl<'de> Deserialize<'de> for LensDistortion {
    fn deserialize<D: Deserializer<'de>>(from: D) -> std::result::Result<Self, D::Error> {
        from.deserialize_any(LensDistortionVisitor)
    }
}

/// `scene_camera`.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with image_size and K")]
pub(super) struct SceneCameraEntry {
    image_size: ImageSize,
    #[serde(rename = "K")]
    matrix: CameraMatrix,
    lens_distortion: Option<LensDistortion>,
    response: Option<Response>,
    latency_s: Option<Latency>,
}

impl SceneCameraEntry {
    pub fn scene_camera(self) -> SceneCamera {
        SceneCamera {
            camera: pinhole(self.image_size, self.matrix, self.lens_distortion),
            response: self.response.unwrap_or_default().tone_curve(),
            vignetting: None,
            noise: None,
            spread: None,
            latency_nanos: nanos(self.latency_s),
        }
    }
}

fn pinhole(
    ImageSize((width, height)): ImageSize,
    matrix: CameraMatrix,
    distortion: Option<LensDistortion>,
) -> PinholeCamera {
    PinholeCamera {
        width,
        height,
        focal: matrix.focal,
        centre: matrix.centre,
        distortion: distortion.unwrap_or_default().0,
    }
}

/// A latency that is not written down counts as none.
fn nanos(latency: Option<Latency>) -> i64 {
    latency.map_or(0, |l| l.0)
}

/// `environment_camera`.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with kind, image_size and T_world_cam")]
pub(super) struct EnvironmentCameraEntry {
    kind: Kind,
    #[serde(rename = "T_world_cam")]
    world_from_camera: Pose,
    image_size: ImageSize,
    /// Of a fisheye.
    projection: Option<Projection>,
    /// Of a camera that looks at a mirrored sphere, as is the distortion.
    #[serde(rename = "K")]
    matrix: Option<CameraMatrix>,
    lens_distortion: Option<LensDistortion>,
    pub mirror_sphere: Option<SphereEntry>,
    response: Option<Response>,
    latency_s: Option<Latency>,
    brackets_ev: Option<List<Number, 0, 16>>,
}

#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase", expecting = "\"fisheye\" or \"sphere\"")]
enum Kind {
    Fisheye,
    Sphere,
}

#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(
    rename_all = "kebab-case",
    expecting = "\"equidistant\", with k1 to k4 where the lens deviates from it"
)]
enum ProjectionModel {
    Equidistant,
    KannalaBrandt,
}

#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(expecting = "an object with f, cx, cy, max_theta_rad")]
struct Projection {
    /// Only checked: both models have the same formula.
    #[serde(rename = "model")]
    _model: Option<ProjectionModel>,
    f: Focal,
    cx: Number,
    cy: Number,
    max_theta_rad: HalfAngle,
    k1: Option<Number>,
    k2: Option<Number>,
    k3: Option<Number>,
    k4: Option<Number>,
}

/// An angle from the optical axis, radians, at most pi.
#[derive(Clone, Copy, Deserialize)]
#[serde(try_from = "Positive")]
struct HalfAngle(f64);

impl TryFrom<Positive> for HalfAngle {
    type Error = &'static str;

    fn try_from(angle: Positive) -> std::result::Result<Self, Self::Error> {
        if angle.0 > std::f64::consts::PI {
            return Err("must be radians, at most pi");
        }
        Ok(Self(angle.0))
    }
}

impl EnvironmentCameraEntry {
    /// # Errors
    /// A key that this kind of camera requires is missing, or its sphere moves about.
    pub fn environment_camera(self, markers: &[Marker]) -> Result<EnvironmentCamera> {
        let brackets = self.brackets_ev.unwrap_or_default().0;
        let world_from_camera = self.world_from_camera.0;
        let missing = |key: &str| RigJsonError::missing(format!("environment_camera.{key}"));
        let view = match self.kind {
            Kind::Fisheye => EnvironmentView::Fisheye {
                lens: self
                    .projection
                    .ok_or_else(|| missing("projection"))?
                    .lens(self.image_size),
                world_from_camera,
            },
            Kind::Sphere => {
                let matrix = self.matrix.ok_or_else(|| missing("K"))?;
                let sphere = self.mirror_sphere.ok_or_else(|| missing("mirror_sphere"))?;
                EnvironmentView::Sphere {
                    camera: pinhole(self.image_size, matrix, self.lens_distortion),
                    world_from_camera,
                    sphere: fixed_sphere(sphere, markers)?,
                }
            }
        };
        Ok(EnvironmentCamera {
            response: self.response.unwrap_or_default().tone_curve(),
            vignetting: None,
            view,
            latency_nanos: nanos(self.latency_s),
            brackets_ev: brackets.into_iter().map(|stops| stops.0).collect(),
        })
    }
}

impl Projection {
    fn lens(self, ImageSize((width, height)): ImageSize) -> FisheyeLens {
        let coefficients = [self.k1, self.k2, self.k3, self.k4];
        FisheyeLens {
            width,
            height,
            focal: self.f.0,
            centre: DVec2::new(self.cx.0, self.cy.0),
            distortion: coefficients.map(|k| k.map_or(0.0, |k| k.0)),
            max_theta: self.max_theta_rad.0,
        }
    }
}

/// The sphere that an environment camera of its own looks at.
fn fixed_sphere(sphere: SphereEntry, markers: &[Marker]) -> Result<MirrorSphere> {
    const PATH: &str = "environment_camera.mirror_sphere";
    match sphere.sphere(PATH, markers)? {
        (sphere, None) => Ok(sphere),
        (_, Some(_)) => Err(RigJsonError::wrong(
            PATH,
            "must stand still before a camera of its own: name a marker that is among `markers`, \
             or give center_world",
        )),
    }
}

/// `mirror_sphere`, at the root or in the environment camera.
#[derive(Clone, Deserialize, JsonSchema)]
#[serde(expecting = "an object with center_world and radius")]
pub(super) struct SphereEntry {
    radius: Positive,
    center_world: Option<Vector>,
    position_sigma_m: Option<Positive>,
    marker: Option<SphereMarkerEntry>,
    reflectance_rgb: Option<Colour>,
    in_scene_camera_images: Option<bool>,
}

#[derive(Clone, Deserialize, JsonSchema)]
#[serde(expecting = "an object with family, id and center")]
struct SphereMarkerEntry {
    family: String,
    id: Count,
    center: Vector,
    size_m: Option<Positive>,
}

impl SphereEntry {
    /// The sphere at `path`, and the marker that carries it if it moves about. A marker that is
    /// among `markers` stands still, and its sphere with it.
    ///
    /// # Errors
    /// The position is missing, or the marker that carries the sphere is not described completely.
    pub fn sphere(
        self,
        path: &str,
        markers: &[Marker],
    ) -> Result<(MirrorSphere, Option<SphereMarker>)> {
        let (centre_in_world, carrier) = match (self.marker, self.center_world) {
            (Some(marker), _) => marker.centre(&format!("{path}.marker"), markers)?,
            (None, Some(centre)) => (centre.0, None),
            (None, None) => return Err(RigJsonError::missing(format!("{path}.center_world"))),
        };
        let sphere = MirrorSphere {
            centre_in_world,
            radius: self.radius.0,
            position_sigma: self.position_sigma_m.map_or(0.0, |sigma| sigma.0),
            reflectance: self.reflectance_rgb.map_or([1.0; 3], |c| c.0),
            in_scene: carrier.is_some() || self.in_scene_camera_images.unwrap_or(false),
        };
        Ok((sphere, carrier))
    }
}

impl SphereMarkerEntry {
    fn centre(self, path: &str, markers: &[Marker]) -> Result<(DVec3, Option<SphereMarker>)> {
        let (id, centre_in_marker) = (self.id.0, self.center.0);
        let is_this = |m: &&Marker| m.family == self.family && m.id == id;
        if let Some(fixed) = markers.iter().find(is_this) {
            let centre = fixed.world_from_marker.transform_point(centre_in_marker);
            return Ok((centre, None));
        }
        let family = self.family.parse();
        let carrier = SphereMarker {
            family: family.map_err(|_| {
                let reason = "must be \"tag36h11\", \"tag25h9\" or \"tag16h5\"";
                RigJsonError::wrong(&format!("{path}.family"), reason)
            })?,
            id,
            size: self
                .size_m
                .ok_or_else(|| RigJsonError::missing(format!("{path}.size_m")))?
                .0,
            centre_in_marker,
        };
        Ok((DVec3::ZERO, Some(carrier)))
    }
}

/// `tracker`.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with T_world_source and T_sensor_cam")]
pub(super) struct TrackerEntry {
    #[serde(rename = "T_world_source")]
    world_from_transmitter: Pose,
    #[serde(rename = "T_sensor_cam")]
    sensor_from_scene_camera: Pose,
    latency_s: Option<Latency>,
    fastrak: Option<Fastrak>,
}

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with units")]
struct Fastrak {
    units: Option<Units>,
}

/// Unit of the positions that the tracker sends. A FASTRAK's default is inches.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum Units {
    #[default]
    Inches,
    #[serde(alias = "centimeters")]
    Centimetres,
    #[serde(alias = "millimeters")]
    Millimetres,
    #[serde(alias = "meters")]
    Metres,
}

impl Units {
    const fn metres(self) -> f64 {
        match self {
            Self::Inches => 0.0254,
            Self::Centimetres => 0.01,
            Self::Millimetres => 0.001,
            Self::Metres => 1.0,
        }
    }
}

impl TrackerEntry {
    pub fn tracker(self) -> TrackerCalibration {
        let units = self.fastrak.and_then(|f| f.units).unwrap_or_default();
        TrackerCalibration {
            world_from_transmitter: self.world_from_transmitter.0,
            sensor_from_scene_camera: self.sensor_from_scene_camera.0,
            latency_nanos: nanos(self.latency_s),
            metres_per_unit: units.metres(),
            field: None,
        }
    }
}

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with scene, environment and patches_xywh")]
struct ChartFields {
    scene: String,
    environment: String,
    patches_xywh: List<Patch, 0, 10_000>,
    reflectance_linear_rgb: Option<List<Colour, 0, 10_000>>,
}

/// x, y, width, height, pixels.
#[derive(Clone, Copy, Deserialize)]
#[serde(try_from = "Array<Count, 4>")]
struct Patch([u32; 4]);

impl TryFrom<Array<Count, 4>> for Patch {
    type Error = &'static str;

    fn try_from(patch: Array<Count, 4>) -> std::result::Result<Self, Self::Error> {
        let patch = patch.0.map(|n| n.0);
        if patch[2] == 0 || patch[3] == 0 {
            return Err("must be x, y, width, height with width and height above 0");
        }
        Ok(Self(patch))
    }
}

/// `photometric_chart`.
#[derive(Deserialize)]
#[serde(try_from = "ChartFields")]
pub(super) struct ChartEntry(pub PhotometricChart);

impl TryFrom<ChartFields> for ChartEntry {
    type Error = &'static str;

    fn try_from(fields: ChartFields) -> std::result::Result<Self, Self::Error> {
        let patches = fields.patches_xywh.0;
        let reflectance = fields.reflectance_linear_rgb.unwrap_or_default().0;
        if !reflectance.is_empty() && reflectance.len() != patches.len() {
            return Err("must have as many reflectances as patches");
        }
        Ok(Self(PhotometricChart {
            scene_picture: fields.scene,
            environment_picture: fields.environment,
            patches: patches.into_iter().map(|p| p.0).collect(),
            reflectance: reflectance.into_iter().map(|c| c.0).collect(),
        }))
    }
}

schema_of! {
    ChartEntry => ChartFields;
    HalfAngle => Positive;
    Patch => Array<Count, 4>;
}
