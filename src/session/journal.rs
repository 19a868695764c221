//! The journal, which records how the live rig processed the streams so that a replay can repeat it,
//! and the cameras' controls.

use penumbra_interface::{ControlsInForce, MonotonicTime};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The live rig's record of a picture's light, which is estimated asynchronously.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LightRecord {
    /// The light estimator used the picture.
    pub seen: bool,
    /// Arrival of the picture in whose light this one was rendered; `None` before the first estimate.
    pub lit_by: Option<MonotonicTime>,
}

/// JSON of a `/rig/journal` message; its log time is the time of the event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum JournalMessage {
    /// The time of pairing was advanced without an arrival.
    Tick {},
    /// A picture of the scene camera was prepared for the compositor. Pictures between two of these
    /// messages were skipped.
    Prepared {
        /// Arrival of the picture, nanoseconds.
        arrived_at: i64,
        /// The light estimator used the picture. Missing in recordings of older rigs, which used
        /// each of these pictures and rendered each in the light of the previous one.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        seen: Option<bool>,
        /// Arrival of the picture in whose light this one was rendered, nanoseconds.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        lit_by: Option<i64>,
    },
}

/// JSON schema of [`JournalMessage`].
pub(super) const JOURNAL_SCHEMA: &[u8] = br#"{"title":"penumbra.Journal","type":"object","properties":{"tick":{"type":"object","description":"the time of pairing was advanced without an arrival"},"prepared":{"type":"object","description":"a picture of the scene camera was prepared for the compositor","properties":{"arrived_at":{"type":"integer","description":"its arrival, nanoseconds"},"seen":{"type":"boolean","description":"the light estimator used it"},"lit_by":{"type":"integer","description":"arrival of the picture in whose light it was rendered, nanoseconds"}}}}}"#;

/// JSON of a `.../controls` message, in the device's own units.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct ControlsMessage {
    pub controls: BTreeMap<String, i64>,
}

/// JSON schema of [`ControlsMessage`].
pub(super) const CONTROLS_SCHEMA: &[u8] = br#"{"title":"penumbra.Controls","type":"object","properties":{"controls":{"type":"object","description":"controls in force from the next image on, in the device's units","additionalProperties":{"type":"integer"}}}}"#;

impl ControlsMessage {
    pub fn from_controls(controls: &ControlsInForce) -> Self {
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
    pub fn prepared(arrived_at: MonotonicTime, light: Option<LightRecord>) -> Self {
        Self::Prepared {
            arrived_at: arrived_at.as_nanos(),
            seen: light.map(|light| light.seen),
            lit_by: light.and_then(|light| light.lit_by.map(MonotonicTime::as_nanos)),
        }
    }
}
