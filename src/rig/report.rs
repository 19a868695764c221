//! What happened, for `--report FILE.json`.

use penumbra_status::StageTimes;
use penumbra_sync::PairingCounts;
use penumbra_white_balance::MatchStatus;
use serde::Serialize;

/// The report of one replay.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Version of this layout.
    pub version: u32,
    /// The session's file name.
    pub session: String,
    /// The file ended before its footer: the recorder was killed.
    pub truncated: bool,
    /// Adapter name.
    pub adapter: String,
    /// Picture width and height, pixels.
    pub resolution: [u32; 2],
    /// Frame counts.
    pub frames: FrameCounts,
    /// Tracker and environment counts.
    pub inputs: InputCounts,
    /// Environment picture's age at the scene picture's exposure, milliseconds.
    pub skew_ms: Skew,
    /// The tracker's latency; null where nobody measured it.
    pub tracker_latency: Option<LatencyReport>,
    /// How the cameras were matched; null without an environment camera.
    pub white_balance: Option<MatchStatus>,
    /// Dome lights in the last frame, and those of compact sources among them.
    pub lights: u32,
    /// LightScheduler that stand for compact sources.
    pub compact_lights: u32,
    /// Times of each stage.
    pub stages: StageTimes,
    /// Seconds from the first frame to the last.
    pub wall_seconds: f64,
}

/// The tracker's latency, milliseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LatencyReport {
    /// In force at the end.
    pub used_ms: f64,
    /// As measured in the end; null where nothing told it.
    pub measured_ms: Option<f64>,
    /// 1σ of that.
    pub sigma_ms: Option<f64>,
    /// By `poses` or `image motion`.
    pub by: Option<&'static str>,
    /// Why the last seconds do not tell.
    pub note: Option<String>,
}

/// What became of the scene camera's pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameCounts {
    /// Pictures in the recording (times loops).
    pub in_session: u64,
    /// Pictures composed.
    pub composed: u64,
    /// Left out because the machine was too slow for the pace.
    pub skipped: u64,
    /// Damaged pictures left out.
    pub damaged: u64,
    /// Composed without a pose: the camera's picture alone.
    pub without_pose: u64,
    /// Composed with a predicted pose.
    pub predicted_pose: u64,
    /// Composed before any environment was seen.
    pub without_environment: u64,
}

/// What else came in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct InputCounts {
    /// Pictures of the environment camera, brackets included.
    pub environment_frames: u64,
    /// Environment instants, each with all its exposures.
    pub environment_sets: u64,
    /// Instants of which an exposure is missing.
    pub incomplete_sets: u64,
    /// Tracker readings.
    pub poses: u64,
    /// Readings that could not be.
    pub rejected_poses: u64,
    /// Tracker bytes that belonged to no record.
    pub skipped_tracker_bytes: u64,
    /// Times the clock went back.
    pub time_jumps: u64,
    /// Stretches of the file that could not be read.
    pub damaged_stretches: u64,
}

/// Skew of the environment behind the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Skew {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
}

/// Running mean and maximum.
#[derive(Clone, Copy, Debug, Default)]
pub struct SkewMeter {
    sum: f64,
    count: u64,
    max: f64,
}

impl SkewMeter {
    /// One frame's skew, nanoseconds.
    pub fn add(&mut self, nanos: i64) {
        let ms = nanos as f64 * 1e-6;
        self.sum += ms;
        self.count += 1;
        self.max = self.max.max(ms);
    }

    /// The result.
    #[must_use]
    pub fn skew(&self) -> Skew {
        Skew {
            mean: self.sum / self.count.max(1) as f64,
            max: self.max,
        }
    }
}

impl InputCounts {
    /// Takes what pairing counted.
    pub fn take(&mut self, counts: &PairingCounts) {
        self.environment_sets += counts.environment_sets;
        self.incomplete_sets += counts.incomplete_sets;
        self.rejected_poses += counts.rejected_poses;
        self.time_jumps += counts.time_jumps;
    }
}
