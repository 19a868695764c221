//! Objects in the scene of a `rig.json`: virtual object, phantoms, ground, markers, virtual lights.

use super::document::{Marker, ObjectPlacement, PhantomPlacement};
use super::values::{
    Albedo, Colour, Count, Direction, List, NotNegative, Number, Placement, Pose, Positive, Vector,
};
use glam::{DMat4, DVec3, Vec3};
use penumbra_scene::lamps::MAX_LAMPS;
use penumbra_scene::z_up_from_y_up;
use penumbra_scene::{GroundPlane, VirtualLight, VirtualLightKey, VirtualLightKind};
use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::Error;
use serde::de::value::Error as FieldError;

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with glb and T_world_object")]
struct ObjectFields {
    glb: String,
    #[serde(rename = "T_world_glb")]
    world_from_glb: Option<Placement>,
    #[serde(rename = "T_world_object")]
    world_from_object: Option<Placement>,
}

/// `object`.
#[derive(Deserialize)]
#[serde(try_from = "ObjectFields")]
pub(super) struct ObjectEntry(pub ObjectPlacement);

impl TryFrom<ObjectFields> for ObjectEntry {
    type Error = FieldError;

    fn try_from(fields: ObjectFields) -> Result<Self, FieldError> {
        let world_from_glb = match (fields.world_from_glb, fields.world_from_object) {
            (Some(world_from_glb), _) => world_from_glb.0,
            (None, Some(world_from_object)) => world_from_object.0 * z_up_from_y_up(),
            (None, None) => return Err(FieldError::missing_field("T_world_object")),
        };
        Ok(Self(ObjectPlacement {
            file: fields.glb,
            world_from_glb,
        }))
    }
}

#[derive(Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum PlyFrame {
    #[default]
    World,
    #[serde(alias = "local")]
    Phantom,
}

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with name and ply")]
struct PhantomFields {
    name: Option<String>,
    ply: String,
    ply_frame: Option<PlyFrame>,
    pose: Option<Placement>,
    mirror: Option<bool>,
    albedo_linear_rgb: Option<Albedo>,
}

/// An entry of `phantoms`.
#[derive(Deserialize)]
#[serde(try_from = "PhantomFields")]
pub(super) struct PhantomEntry(pub PhantomPlacement);

impl TryFrom<PhantomFields> for PhantomEntry {
    type Error = FieldError;

    fn try_from(fields: PhantomFields) -> Result<Self, FieldError> {
        let world_from_file = match (fields.ply_frame.unwrap_or_default(), fields.pose) {
            (PlyFrame::World, _) => DMat4::IDENTITY,
            (PlyFrame::Phantom, Some(pose)) => pose.0,
            (PlyFrame::Phantom, None) => return Err(FieldError::missing_field("pose")),
        };
        Ok(Self(PhantomPlacement {
            name: fields.name.unwrap_or_else(|| "phantom".to_owned()),
            file: fields.ply,
            world_from_file,
            mirror: fields.mirror.unwrap_or(false),
            albedo: fields.albedo_linear_rgb.map(|a| Vec3::from(a.0)),
        }))
    }
}

/// `ground_plane`.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with normal, offset, size_m")]
pub(super) struct GroundEntry {
    normal: Option<Direction>,
    offset: Option<Number>,
    size_m: Option<Positive>,
    albedo_linear_rgb: Option<Albedo>,
}

impl GroundEntry {
    pub fn ground_plane(self) -> GroundPlane {
        GroundPlane {
            normal: self.normal.map_or(DVec3::Z, |n| n.0),
            offset: self.offset.map_or(0.0, |o| o.0),
            size: self.size_m.map_or(10.0, |s| s.0),
            albedo: self.albedo_linear_rgb.map(|a| Vec3::from(a.0)),
        }
    }
}

/// An entry of `markers`.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with family, id, size_m and T_world_marker")]
pub(super) struct MarkerEntry {
    family: String,
    id: Count,
    size_m: Positive,
    #[serde(rename = "T_world_marker")]
    world_from_marker: Pose,
}

impl MarkerEntry {
    pub fn marker(self) -> Marker {
        Marker {
            family: self.family,
            id: self.id.0,
            size: self.size_m.0,
            world_from_marker: self.world_from_marker.0,
        }
    }
}

/// `virtual_lights`.
#[derive(Default, Deserialize, JsonSchema)]
#[serde(expecting = "an object with lights")]
pub(super) struct LightsEntry {
    pub lights: Option<List<LightEntry, 0, MAX_LAMPS>>,
}

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with kind, intensity and keys")]
struct LightFields {
    name: Option<String>,
    kind: LightKind,
    intensity: Colour,
    beam_deg: Option<Positive>,
    cutoff_deg: Option<Positive>,
    keys: List<LightKey, 0, 100_000>,
}

#[derive(Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase", expecting = "\"point\" or \"spot\"")]
enum LightKind {
    Point,
    Spot,
}

impl LightFields {
    fn kind(&self) -> Result<VirtualLightKind, FieldError> {
        if matches!(self.kind, LightKind::Point) {
            return Ok(VirtualLightKind::Point);
        }
        let missing = FieldError::missing_field;
        let Positive(beam) = self.beam_deg.ok_or_else(|| missing("beam_deg"))?;
        let Positive(cutoff) = self.cutoff_deg.ok_or_else(|| missing("cutoff_deg"))?;
        if cutoff > 180.0 || cutoff < beam {
            let reason = "cutoff_deg must be a half angle of at least beam_deg and at most 180";
            return Err(FieldError::custom(reason));
        }
        Ok(VirtualLightKind::Spot {
            beam: beam.to_radians(),
            cutoff: cutoff.to_radians(),
        })
    }
}

/// An entry of `virtual_lights.lights`.
#[derive(Deserialize)]
#[serde(try_from = "LightFields")]
pub(super) struct LightEntry(pub VirtualLight);

impl TryFrom<LightFields> for LightEntry {
    type Error = FieldError;

    fn try_from(fields: LightFields) -> Result<Self, FieldError> {
        let kind = fields.kind()?;
        let keys: Vec<_> = fields.keys.0.into_iter().map(|key| key.0).collect();
        let lacks_target = keys.iter().any(|k| k.target.is_none());
        if keys.is_empty() || (lacks_target && kind != VirtualLightKind::Point) {
            let reason = "must have at least one key, and a target in each key if it is a spot";
            return Err(FieldError::custom(reason));
        }
        if keys.windows(2).any(|k| k[0].seconds >= k[1].seconds) {
            let reason = "must have its keys in the order of their times, no two at the same time";
            return Err(FieldError::custom(reason));
        }
        Ok(Self(VirtualLight {
            repeat: None,
            screen: None,
            name: fields.name.unwrap_or_else(|| "light".to_owned()),
            kind,
            intensity: Vec3::from(fields.intensity.0),
            keys,
        }))
    }
}

#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with t, pos, target, gain")]
struct LightKeyFields {
    t: Number,
    pos: Vector,
    target: Option<Vector>,
    gain: Option<NotNegative>,
}

#[derive(Deserialize)]
#[serde(try_from = "LightKeyFields")]
struct LightKey(VirtualLightKey);

impl TryFrom<LightKeyFields> for LightKey {
    type Error = &'static str;

    fn try_from(fields: LightKeyFields) -> Result<Self, Self::Error> {
        let key = VirtualLightKey {
            seconds: fields.t.0,
            position: fields.pos.0,
            target: fields.target.map(|t| t.0),
            gain: fields.gain.map_or(1.0, |g| g.0),
        };
        if key.target.is_some_and(|t| t.distance(key.position) < 1e-6) {
            return Err("must have a target other than the light's own position");
        }
        Ok(Self(key))
    }
}

schema_of! {
    ObjectEntry => ObjectFields;
    PhantomEntry => PhantomFields;
    LightEntry => LightFields;
    LightKey => LightKeyFields;
}
