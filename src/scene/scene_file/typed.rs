//! Types of the TOML of a scene file.

use crate::motion::Easing;
use glam::{DVec3, Vec3};
use penumbra_camera::linear_from_srgb;
use serde::de::{self, Deserialize, Deserializer, SeqAccess, Visitor};
use std::fmt;

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SceneFile {
    pub session_phantoms: Option<bool>,
    pub model: Option<Place>,
    pub object: Vec<Entry>,
    pub phantom: Vec<Entry>,
    pub photometry: Option<Photometry>,
    pub lamp: Vec<LampFile>,
    pub plane: Vec<PlaneFile>,
    pub ground: Option<Ground>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Place {
    pub position_m: Option<[f64; 3]>,
    pub rotation_deg: Option<[f64; 3]>,
    pub rotation_wxyz: Option<[f64; 4]>,
}

/// An object or a phantom. Allowed combinations of keys are checked afterwards, because serde cannot
/// refuse unknown keys in flattened structs.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Entry {
    pub name: Option<String>,
    pub file: Option<String>,
    pub shape: Option<Shape>,
    pub size_m: Option<Vec<f64>>,
    pub radius_m: Option<f64>,
    pub tube_radius_m: Option<f64>,
    pub height_m: Option<f64>,
    pub segments: Option<u32>,
    pub position_m: Option<[f64; 3]>,
    pub rotation_deg: Option<[f64; 3]>,
    pub rotation_wxyz: Option<[f64; 4]>,
    pub scale: Option<Scale>,
    pub material: Option<MaterialFile>,
    pub mirror: Option<bool>,
    pub albedo: Option<Colour>,
    pub keys: Vec<ObjectKeyFile>,
    pub repeat_s: Option<f64>,
    pub easing: Option<Easing>,
    pub animation: Option<AnimationFile>,
}

/// Missing values are those of the object.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ObjectKeyFile {
    pub at_s: f64,
    pub position_m: Option<[f64; 3]>,
    pub rotation_deg: Option<[f64; 3]>,
    pub rotation_wxyz: Option<[f64; 4]>,
    pub scale: Option<Scale>,
}

/// Selection of an animation of the model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum AnimationFile {
    Plays(bool),
    Named(String),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Shape {
    Plane,
    Box,
    Cylinder,
    Cone,
    Sphere,
    Torus,
    TempleGate,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct MaterialFile {
    pub base_colour: Option<Colour>,
    pub metallic: Option<f64>,
    pub roughness: Option<f64>,
    pub specular: Option<f64>,
    pub phong: Option<PhongFile>,
    pub emissive: Option<Colour>,
    pub base_colour_texture: Option<String>,
    pub metallic_roughness_texture: Option<String>,
    pub normal_texture: Option<String>,
    pub normal_scale: Option<f64>,
    pub occlusion_texture: Option<String>,
    pub emissive_texture: Option<String>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PhongFile {
    pub diffuse: Option<Colour>,
    pub specular: Option<Colour>,
    pub exponent: Option<f64>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Ground {
    pub height_m: Option<f64>,
    pub size_m: Option<f64>,
    pub albedo: Option<Colour>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct LampFile {
    pub name: Option<String>,
    pub kind: Option<LampKind>,
    pub attached_to: Option<String>,
    pub position_m: Option<[f64; 3]>,
    pub target_m: Option<[f64; 3]>,
    pub direction: Option<[f64; 3]>,
    pub up: Option<[f64; 3]>,
    pub size_m: Option<[f64; 2]>,
    pub texture: Option<String>,
    pub two_sided: Option<bool>,
    pub visible: Option<bool>,
    pub intensity: Option<Colour>,
    pub candela: Option<f64>,
    pub lumen: Option<f64>,
    pub nit: Option<f64>,
    pub colour: Option<Colour>,
    pub kelvin: Option<f64>,
    pub beam_deg: Option<f64>,
    pub cutoff_deg: Option<f64>,
    pub keys: Vec<LampKeyFile>,
    pub repeat_s: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum LampKind {
    Point,
    Spot,
    Area,
}

/// Missing values are those of the lamp.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct LampKeyFile {
    pub at_s: f64,
    pub position_m: Option<[f64; 3]>,
    pub target_m: Option<[f64; 3]>,
    pub gain: Option<f64>,
}

/// The camera's white in photometric units.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Photometry {
    pub white_cd_m2: Option<f64>,
    pub ev100: Option<f64>,
}

#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PlaneFile {
    pub centre_m: Option<[f64; 3]>,
    pub normal: Option<[f64; 3]>,
    pub up: Option<[f64; 3]>,
    pub size_m: Option<[f64; 2]>,
    pub depth_m: Option<f64>,
    pub layer: Option<PlaneLayer>,
    pub receiver: Option<PlaneReceiver>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PlaneLayer {
    Real,
    Virtual,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PlaneReceiver {
    Plane,
    Surface,
}

/// Linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Colour(pub Vec3);

/// Scale per axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale(pub DVec3);

struct ColourVisitor;

impl<'de> Visitor<'de> for ColourVisitor {
    type Value = Colour;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("\"#rrggbb\" (sRGB) or three linear numbers from 0 up")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Colour, E> {
        let wrong = || E::custom(format!("\"{text}\", expected {}", Expected(&self)));
        let hex = text.strip_prefix('#').filter(|h| h.len() == 6);
        let code = hex
            .and_then(|h| u32::from_str_radix(h, 16).ok())
            .ok_or_else(wrong)?;
        let linear = |shift: u32| linear_from_srgb(((code >> shift) & 255) as f32 / 255.0);
        Ok(Colour(Vec3::new(linear(16), linear(8), linear(0))))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Colour, A::Error> {
        let finite = three(seq)?.filter(|v| v.is_finite());
        let rgb = finite.filter(|v| v.min_element() >= 0.0 && v.max_element() <= 1e6);
        let rgb = rgb.ok_or_else(|| de::Error::custom(format!("expected {}", Expected(&Self))))?;
        Ok(Colour(rgb.as_vec3()))
    }
}

struct AnimationVisitor;

impl Visitor<'_> for AnimationVisitor {
    type Value = AnimationFile;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("true, false or the name of an animation of the model")
    }

    fn visit_bool<E: de::Error>(self, plays: bool) -> Result<AnimationFile, E> {
        Ok(AnimationFile::Plays(plays))
    }

    fn visit_str<E: de::Error>(self, name: &str) -> Result<AnimationFile, E> {
        Ok(AnimationFile::Named(name.to_owned()))
    }
}

struct ScaleVisitor;

impl<'de> Visitor<'de> for ScaleVisitor {
    type Value = Scale;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number from 0.0001 to 10000, or three of them")
    }

    fn visit_f64<E: de::Error>(self, v: f64) -> Result<Scale, E> {
        checked_scale(DVec3::splat(v))
    }

    fn visit_i64<E: de::Error>(self, v: i64) -> Result<Scale, E> {
        checked_scale(DVec3::splat(v as f64))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Scale, A::Error> {
        checked_scale(three(seq)?.unwrap_or(DVec3::NAN))
    }
}

fn checked_scale<E: de::Error>(scale: DVec3) -> Result<Scale, E> {
    if scale.to_array().iter().all(|s| (1e-4..=1e4).contains(s)) {
        return Ok(Scale(scale));
    }
    Err(E::custom(format!("expected {}", Expected(&ScaleVisitor))))
}

/// Reads exactly three numbers.
fn three<'de, A: SeqAccess<'de>>(mut seq: A) -> Result<Option<DVec3>, A::Error> {
    let mut all: Vec<f64> = Vec::new();
    while let Some(x) = seq.next_element()? {
        all.push(x);
    }
    let array: Option<[f64; 3]> = all.try_into().ok();
    Ok(array.map(DVec3::from))
}

/// Displays what a visitor expects.
struct Expected<'a, V>(&'a V);

impl<'de, V: Visitor<'de>> fmt::Display for Expected<'_, V> {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        self.0.expecting(f)
    }
}

impl<'de> Deserialize<'de> for Colour {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(ColourVisitor)
    }
}

impl<'de> Deserialize<'de> for AnimationFile {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(AnimationVisitor)
    }
}

impl<'de> Deserialize<'de> for Scale {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(ScaleVisitor)
    }
}
