//! The camera and the tracker that play recordings.

use crate::playback::{Playback, Restart};
use crate::timeline::Timeline;
use penumbra_interface::{
    Camera, CameraReport, DeviceError, Frame, StampSource, StreamMode, Tracker, TrackerBytes,
    TrackerReport,
};
use std::sync::Arc;
use std::time::Duration;

/// A camera that plays recorded frames.
pub struct ReplayCamera {
    playback: Playback<Frame>,
    report: CameraReport,
    /// Sequence number of the newest frame in the recording.
    recorded_sequence: Option<u64>,
    /// Sequence number of the newest frame as passed on.
    sequence: u64,
}

impl ReplayCamera {
    /// A camera that reports the identity `identity`; `restart` opens the recorded frames at
    /// their beginning.
    #[must_use]
    pub fn new(identity: &str, timeline: Arc<Timeline>, restart: Restart<Frame>) -> Self {
        Self {
            playback: Playback::new(timeline, restart),
            report: CameraReport {
                identity: identity.to_owned(),
                stamps: StampSource::Recorded,
                ..CameraReport::default()
            },
            recorded_sequence: None,
            sequence: 0,
        }
    }

    /// Sequence numbers continue when the recording starts again; gaps in it are kept.
    fn next_sequence(&mut self, recorded: u64) -> u64 {
        let step = match self.recorded_sequence.replace(recorded) {
            None => 0,
            Some(before) => recorded.checked_sub(before).unwrap_or(1),
        };
        self.report.counters.lost += step.saturating_sub(1);
        self.sequence = self.sequence.saturating_add(step);
        self.sequence
    }
}

impl Camera for ReplayCamera {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let frame = self.playback.next(timeout);
        self.report.counters.superseded = self.playback.skipped();
        Ok(frame.map(|mut frame| {
            frame.sequence = self.next_sequence(frame.sequence);
            self.report.counters.frames += 1;
            self.report.mode = Some(StreamMode {
                width: frame.width,
                height: frame.height,
                format: frame.format,
                frames_per_second: None,
            });
            frame
        }))
    }

    fn report(&self) -> CameraReport {
        self.report.clone()
    }
}

/// A tracker that plays recorded bytes.
pub struct ReplayTracker {
    playback: Playback<TrackerBytes>,
    report: TrackerReport,
}

impl ReplayTracker {
    /// A tracker that reports the identity `identity`; `protocol` is the protocol of the
    /// recorded bytes, and `restart` opens them at their beginning.
    #[must_use]
    pub fn new(
        identity: &str,
        protocol: &str,
        timeline: Arc<Timeline>,
        restart: Restart<TrackerBytes>,
    ) -> Self {
        Self {
            playback: Playback::new(timeline, restart),
            report: TrackerReport {
                identity: identity.to_owned(),
                protocol: protocol.to_owned(),
                ..TrackerReport::default()
            },
        }
    }
}

impl Tracker for ReplayTracker {
    fn next_bytes(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        let bytes = self.playback.next(timeout);
        self.report.bytes += bytes.as_ref().map_or(0, |b| b.bytes.len() as u64);
        Ok(bytes)
    }

    fn report(&self) -> TrackerReport {
        self.report.clone()
    }
}

#[cfg(test)]
mod tests;
