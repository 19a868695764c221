//! `rig.json`: the owner's description of a rig, read into [`RigCalibration`] and the list of
//! objects in the scene.
//!
//! `T_a_b` in the file maps coordinates in b to a, as `a_from_b` does here. Unknown keys are
//! ignored, because the file also carries notes for other tools. serde derives the reading from
//! the structs of `cameras` and `objects`, whose `values` check their ranges; serde_path_to_error
//! adds the complete path of the key to each `error`.

/// Gives a type the schema of another one, from which it is converted.
macro_rules! schema_of {
    ($($type:ty => $fields:ty;)*) => { $(
        impl schemars::JsonSchema for $type {
            fn inline_schema() -> bool {
                true
            }

            fn schema_name() -> std::borrow::Cow<'static, str> {
                <$fields>::schema_name()
            }

            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                <$fields>::json_schema(generator)
            }
        }
    )* };
}

mod cameras;
mod document;
mod error;
mod objects;
mod schema;
mod values;

pub use document::{EnvironmentSource, Marker, ObjectPlacement, PhantomPlacement, RigDocument};
pub use error::RigJsonError;
pub use schema::rig_json_schema;

use crate::RigCalibration;
use cameras::{ChartEntry, EnvironmentCameraEntry, SceneCameraEntry, SphereEntry, TrackerEntry};
use objects::{GroundEntry, LightsEntry, MarkerEntry, ObjectEntry, PhantomEntry};
use schemars::JsonSchema;
use serde::Deserialize;
use values::List;

/// Maximum size of the file, bytes.
const MAX_FILE_BYTES: usize = 16 << 20;

/// The owner's description of a rig. Lengths are metres, the world is right-handed with +Z up; `T_a_b`
/// maps coordinates in b to a. Unknown keys are ignored.
#[derive(Deserialize, JsonSchema)]
#[serde(expecting = "an object with scene_camera")]
#[schemars(title = "rig.json of Penumbra")]
struct RigEntry {
    name: Option<String>,
    scene_camera: SceneCameraEntry,
    environment_camera: Option<EnvironmentCameraEntry>,
    mirror_sphere: Option<SphereEntry>,
    tracker: Option<TrackerEntry>,
    photometric_chart: Option<ChartEntry>,
    object: Option<ObjectEntry>,
    phantoms: Option<List<PhantomEntry, 0, 1000>>,
    ground_plane: Option<GroundEntry>,
    markers: Option<List<MarkerEntry, 0, 10_000>>,
    virtual_lights: Option<LightsEntry>,
}

impl RigDocument {
    /// Reads the bytes of a `rig.json`.
    ///
    /// # Errors
    /// The file is larger than 16 MiB or no JSON; a key is missing; a value has the wrong type, is
    /// out of range or contradicts another.
    pub fn parse(bytes: &[u8]) -> Result<Self, RigJsonError> {
        if bytes.len() > MAX_FILE_BYTES {
            return Err(RigJsonError::TooLarge {
                bytes: bytes.len(),
                limit: MAX_FILE_BYTES,
            });
        }
        let mut json = serde_json::Deserializer::from_slice(bytes);
        let entry: RigEntry = serde_path_to_error::deserialize(&mut json)?;
        json.end().map_err(RigJsonError::not_json)?;
        entry.document()
    }
}

impl RigEntry {
    fn document(self) -> Result<RigDocument, RigJsonError> {
        let markers = self.markers.unwrap_or_default().0;
        let markers: Vec<Marker> = markers.into_iter().map(MarkerEntry::marker).collect();
        let of_camera = self.environment_camera.as_ref();
        let sphere = match of_camera.and_then(|c| c.mirror_sphere.clone()) {
            Some(sphere) => Some(sphere.sphere("environment_camera.mirror_sphere", &markers)?),
            None => {
                let sphere = self
                    .mirror_sphere
                    .map(|s| s.sphere("mirror_sphere", &markers));
                sphere.transpose()?
            }
        };
        let (mirror_sphere, sphere_marker) = sphere.unzip();
        let environment = self.environment_camera;
        let environment = environment.map(|c| c.environment_camera(&markers));
        let lights = self.virtual_lights.unwrap_or_default().lights;
        Ok(RigDocument {
            calibration: RigCalibration {
                name: self.name.unwrap_or_else(|| "rig".to_owned()),
                scene_camera: self.scene_camera.scene_camera(),
                environment: environment.transpose()?,
                sphere_marker: sphere_marker.flatten(),
                tracker: self.tracker.map(TrackerEntry::tracker),
                chart: self.photometric_chart.map(|chart| chart.0),
                gains: None,
            },
            mirror_sphere,
            object: self.object.map(|object| object.0),
            phantoms: self
                .phantoms
                .unwrap_or_default()
                .0
                .into_iter()
                .map(|p| p.0)
                .collect(),
            ground: self.ground_plane.map(GroundEntry::ground_plane),
            markers,
            virtual_lights: lights
                .unwrap_or_default()
                .0
                .into_iter()
                .map(|l| l.0)
                .collect(),
        })
    }
}

#[cfg(test)]
mod tests;
