//! What the live rig made of the streams, so that a replay can make the same of them; and
//! the controls that were in force.

use super::events::LightNote;
use penumbra_interface::{ControlsInForce, MonotonicTime};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// JSON of a `/rig/journal` message; its log time is when it happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum JournalMessage {
    /// Nothing came, and pairing was told the time.
    Tick {},
    /// The scene camera's picture with this arrival was made ready for the compositor.
    /// Pictures between two of these were passed over.
    Prepared {
        /// Nanoseconds.
        arrived_at: i64,
        /// The light saw the picture. Not said by a rig whose light saw each of these
        /// pictures, and that drew each in the light of the one before.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seen: Option<bool>,
        /// Arrival of the picture in whose light this one was drawn, nanoseconds.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lit_by: Option<i64>,
    },
}

/// JSON schema of [`JournalMessage`].
pub(super) const JOURNAL_SCHEMA: &[u8] = br#"{"title":"penumbra.Journal","type":"object","properties":{"tick":{"type":"object","description":"nothing came, and pairing was told the time"},"prepared":{"type":"object","description":"a picture of the scene camera was made ready to be composed","properties":{"arrived_at":{"type":"integer","description":"its arrival, nanoseconds"},"seen":{"type":"boolean","description":"its light was worked out"},"lit_by":{"type":"integer","description":"arrival of the picture in whose light it was drawn, nanoseconds"}}}}}"#;

/// JSON of a `.../controls` message, in the device's own units.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ControlsMessage {
    pub controls: BTreeMap<String, i64>,
}

/// JSON schema of [`ControlsMessage`].
pub(super) const CONTROLS_SCHEMA: &[u8] = br#"{"title":"penumbra.Controls","type":"object","properties":{"controls":{"type":"object","description":"controls in force from the next image on, in the device's units","additionalProperties":{"type":"integer"}}}}"#;

impl ControlsMessage {
    pub fn of(controls: &ControlsInForce) -> Self {
        let named = |(name, value): &(Arc<str>, i64)| (name.to_string(), *value);
        Self {
            controls: controls.iter().map(named).collect(),
        }
    }

    pub fn in_force(self) -> ControlsInForce {
        let shared = |(name, value): (String, i64)| (Arc::from(name), value);
        self.controls.into_iter().map(shared).collect()
    }
}

impl JournalMessage {
    pub fn prepared(arrived_at: MonotonicTime, light: Option<LightNote>) -> Self {
        Self::Prepared {
            arrived_at: arrived_at.as_nanos(),
            seen: light.map(|light| light.seen),
            lit_by: light.and_then(|light| light.lit_by.map(MonotonicTime::as_nanos)),
        }
    }
}
