//! The report of a replay, written by `--report FILE.json`.

use crate::damage::DamagedPart;
use crate::picture_problems::PictureProblem;
use penumbra_config::{PoseSource, Quality};
use penumbra_status::StageTimes;
use penumbra_sync::PairingCounts;
use penumbra_white_balance::MatchStatus;
use serde::Serialize;

/// The report of one replay.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of this format.
    pub version: u32,
    /// The session's file name.
    pub session: String,
    /// Whether the file ended before its footer, because the recorder was killed.
    pub truncated: bool,
    /// Adapter name.
    pub adapter: String,
    /// Quality of the pictures.
    pub quality: Quality,
    /// Source of the scene camera's pose.
    pub pose: PoseSource,
    /// Picture width and height, pixels.
    pub resolution: [u32; 2],
    /// Frame counts.
    pub frames: FrameCounts,
    /// Tracker and environment counts.
    pub inputs: InputCounts,
    /// The damaged parts of the file, at most 256, and what they held.
    pub damage: Vec<DamagedPart>,
    /// Problems of single pictures: damaged ones of either camera, wrong sizes.
    pub picture_problems: Vec<PictureProblem>,
    /// Age of the environment picture at the exposure of the scene picture, milliseconds.
    pub skew_ms: Skew,
    /// The tracker's latency; null if it was not measured.
    pub tracker_latency: Option<LatencyReport>,
    /// White balance between the cameras; null without an environment camera.
    pub white_balance: Option<MatchStatus>,
    /// Number of dome lights in the last frame.
    pub lights: u32,
    /// Number of these that represent compact sources.
    pub compact_lights: u32,
    /// Duration of each stage.
    pub stages: StageTimes,
    /// Seconds from the first frame to the last.
    pub wall_seconds: f64,
}

/// The tracker's latency, milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatencyReport {
    /// Active at the end.
    pub used_ms: f64,
    /// Last measured value; null if no measurement succeeded.
    pub measured_ms: Option<f64>,
    /// Its standard deviation.
    pub sigma_ms: Option<f64>,
    /// Method of the measurement: `poses` or `image motion`.
    pub by: Option<&'static str>,
    /// Why the last seconds gave no measurement.
    pub note: Option<String>,
}

/// Counts of scene camera pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameCounts {
    /// Pictures in the recording, times the number of loops.
    pub in_session: u64,
    /// Pictures composed.
    pub composed: u64,
    /// Skipped because the machine was too slow.
    pub skipped: u64,
    /// Skipped because they were damaged.
    pub damaged: u64,
    /// Lost in damaged parts of the recording.
    pub lost: u64,
    /// Composed without a pose: the camera's picture without virtual objects.
    pub without_pose: u64,
    /// Composed with a predicted pose.
    pub predicted_pose: u64,
    /// Composed before the first environment picture.
    pub without_environment: u64,
}

/// Counts of environment and tracker data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InputCounts {
    /// Pictures of the environment camera, brackets included.
    pub environment_frames: u64,
    /// Complete environment sets: all exposures of one instant.
    pub environment_sets: u64,
    /// Environment sets with a missing exposure.
    pub incomplete_sets: u64,
    /// Tracker readings.
    pub poses: u64,
    /// Tracker readings rejected as implausible.
    pub rejected_poses: u64,
    /// Estimated number of tracker readings lost on their way.
    pub lost_poses: u64,
    /// Tracker bytes that belonged to no record.
    pub skipped_tracker_bytes: u64,
    /// Number of times that the clock went back.
    pub time_jumps: u64,
    /// Pictures of the environment camera lost in damaged parts of the recording.
    pub lost_environment_frames: u64,
    /// Messages of the tracker lost in damaged parts of the recording.
    pub lost_tracker_messages: u64,
    /// Parts of the file that could not be read.
    pub damaged_stretches: u64,
}

/// Age of the environment picture relative to the scene picture, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Skew {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Computes the running mean and maximum of the skew.
#[derive(Clone, Copy, Debug, Default)]
pub struct SkewMeter {
    sum: f64,
    count: u64,
    max: f64,
}

impl SkewMeter {
    /// Adds the skew of a frame, nanoseconds.
    pub fn add(&mut self, nanos: i64) {
        let ms = nanos as f64 * 1e-6;
        self.sum += ms;
        self.count += 1;
        self.max = self.max.max(ms);
    }

    /// Returns mean and maximum.
    #[must_use]
    pub fn skew(&self) -> Skew {
        Skew {
            mean: self.sum / self.count.max(1) as f64,
            max: self.max,
        }
    }
}

impl InputCounts {
    /// Adds the counts of the pairing.
    pub fn add_pairing(&mut self, counts: &PairingCounts) {
        self.environment_sets += counts.environment_sets;
        self.incomplete_sets += counts.incomplete_sets;
        self.rejected_poses += counts.rejected_poses;
        self.time_jumps += counts.time_jumps;
    }
}
