//! A frame prepared for the compositor.

use crate::display::DisplayPrediction;
use crate::feed::FeedCounts;
use crate::latency_monitor::LatencyState;
use crate::light::state::LightState;
use penumbra_camera::{ExposureMotion, PinholeCamera, RollingShutter};
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use penumbra_status::{LensStatus, Levels, RegistrationStatus};
use penumbra_sync::{PairingCounts, RigFrame};
use std::sync::Arc;
use std::time::Duration;

/// One frame with all inputs of its composition.
pub struct PreparedFrame {
    /// Index of its picture in the recording.
    pub index: u64,
    /// The paired data; its picture is decoded in `picture`.
    pub frame: RigFrame,
    /// The scene camera's picture.
    pub picture: Picture,
    /// The scene camera's lens.
    pub camera: PinholeCamera,
    /// Where the lens comes from.
    pub lens: LensStatus,
    /// Brightness of the picture.
    pub levels: Levels,
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// Source and uncertainty of that pose.
    pub registration: RegistrationStatus,
    /// The camera's motion during the readout, if it has a rolling shutter.
    pub rolling_shutter: Option<RollingShutter>,
    /// The camera's motion during the exposure, if that is known and blurs virtual objects.
    pub exposure_motion: Option<ExposureMotion>,
    /// The predicted pose at the instant of display, if prediction is configured.
    pub display: Option<DisplayPrediction>,
    /// Standard deviation of the tracker's pose at this instant: millimetres, degrees, and pixels
    /// at the distance of the virtual objects.
    pub tracker_sigma: Option<[f64; 3]>,
    /// Seconds since the recording's first picture.
    pub seconds: f64,
    /// The light.
    pub light: LightState,
    /// The light at the instant at which the next picture is expected, where pictures are not
    /// reproducible.
    pub coming_light: Option<LightState>,
    /// Whether a recording starts again with it, or goes on at another place.
    pub is_start: bool,
    /// Duration of decoding.
    pub decoding: Duration,
    /// Number of environment pictures that the light has left out since the start.
    pub environments_left_out: u64,
    /// Duration of the estimate of its light.
    pub lighting: Duration,
    /// A new preview of the environment, if one was due.
    pub preview: Option<Arc<Picture>>,
    /// Warning about an unreadable environment picture.
    pub warning: Option<String>,
    /// Counts of the data received so far in this loop of the recording.
    pub counts: Counts,
    /// Number of pictures that were skipped before this one, because they were late.
    pub skipped: u64,
    /// Number of the jump in the recording after which it was read.
    pub jumps: u64,
}

/// Counts of received data, and the tracker's latency.
#[derive(Clone, Copy, Debug)]
pub struct Counts {
    /// Counts of the feed.
    pub feed: FeedCounts,
    /// Counts of the pairing.
    pub pairing: PairingCounts,
    /// Tracker bytes that belonged to no record.
    pub skipped_tracker_bytes: u64,
    /// Estimated number of lost readings of the tracker.
    pub lost_readings: u64,
    /// The tracker's latency.
    pub latency: LatencyState,
}
