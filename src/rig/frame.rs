//! A frame that is ready for the compositor.

use crate::display::DisplayPrediction;
use crate::feed::FeedCounts;
use crate::latency_monitor::LatencyState;
use crate::light::state::LightState;
use penumbra_camera::RollingShutter;
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use penumbra_status::RegistrationStatus;
use penumbra_sync::{PairingCounts, RigFrame};
use std::sync::Arc;
use std::time::Duration;

/// One frame with everything that it is made of.
pub struct PreparedFrame {
    /// Number of its picture in the recording.
    pub index: u64,
    /// What was paired. Its picture's bytes are decoded already.
    pub frame: RigFrame,
    /// The scene camera's picture.
    pub picture: Picture,
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// Where that pose comes from.
    pub registration: RegistrationStatus,
    /// The camera's motion during the readout, if it has a rolling shutter.
    pub rolling_shutter: Option<RollingShutter>,
    /// The predicted pose at the instant of display, if prediction is configured.
    pub display: Option<DisplayPrediction>,
    /// Error of the tracker's own pose at this instant: millimetres, degrees, and pixels amid
    /// the virtual objects.
    pub tracker_sigma: Option<[f64; 3]>,
    /// Seconds since the recording's first picture.
    pub seconds: f64,
    /// The light, and what is known of it.
    pub light: LightState,
    /// How long decoding took.
    pub decoding: Duration,
    /// How long the light took that it is drawn in.
    pub lighting: Duration,
    /// A new preview of the environment.
    pub preview: Option<Arc<Picture>>,
    /// What is wrong with the environment's picture.
    pub warning: Option<String>,
    /// What came in so far during this pass.
    pub counts: Counts,
    /// Pictures that a live rig passed over for this one.
    pub skipped: u64,
}

/// What came in.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// By the feed.
    pub feed: FeedCounts,
    /// By the pairing.
    pub pairing: PairingCounts,
    /// Tracker bytes that belonged to no record.
    pub skipped_tracker_bytes: u64,
    /// The tracker's latency.
    pub latency: LatencyState,
}
