//! A session's events become paired rig frames.

use crate::calibration::rig::TrackerCalibration;
use crate::calibration::{RigCalibration, rig::EnvironmentView};
use crate::session::{Events, Session, SessionEvent};
use crate::sync::{Pairing, PairingConfig, PairingCounts, RigFrame};
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::fastrak::{Counters, Decoder, Encoding, Ending, Format, Orientation};

/// Plays a session as if its devices were here.
pub struct Feed {
    session: Session,
    events: Events,
    decoder: Decoder,
    pairing: Pairing,
    exhausted: bool,
    last_arrival: MonotonicTime,
    counts: FeedCounts,
}

/// What came in.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Pictures of the scene camera.
    pub scene_frames: u64,
    /// Pictures of the environment camera, brackets included.
    pub environment_frames: u64,
    /// Readings of the tracker.
    pub poses: u64,
    /// Stretches of the file that could not be read.
    pub damaged: u64,
}

impl Feed {
    /// From the session's beginning.
    #[must_use]
    pub fn new(session: Session, rig: &RigCalibration, config: PairingConfig) -> Self {
        Self {
            events: session.events(),
            decoder: Decoder::new(record_format(rig.tracker.as_ref())),
            pairing: Pairing::new(config),
            session,
            exhausted: false,
            last_arrival: MonotonicTime::default(),
            counts: FeedCounts::default(),
        }
    }

    /// Begins again, as a loop does: what is paired next has nothing to do with what was.
    pub fn rewind(&mut self, config: PairingConfig) {
        self.events = self.session.events();
        self.decoder.reset();
        self.pairing = Pairing::new(config);
        self.exhausted = false;
    }

    /// The next frame of the scene camera with what belongs to it; `None` at the end.
    pub fn next_frame(&mut self) -> Option<RigFrame> {
        loop {
            if let Some(frame) = self.pairing.pop() {
                return Some(frame);
            }
            if self.exhausted {
                return None;
            }
            match self.events.next() {
                Some(Ok(event)) => self.take(event),
                // The reader has left the damaged stretch behind; status counts it.
                Some(Err(_)) => self.counts.damaged += 1,
                None => {
                    self.pairing.finish();
                    self.exhausted = true;
                }
            }
        }
    }

    fn take(&mut self, event: SessionEvent) {
        self.last_arrival = event.arrived_at();
        match event {
            SessionEvent::Scene(frame) => {
                self.counts.scene_frames += 1;
                self.pairing.push_scene(frame);
            }
            SessionEvent::Environment(frame) => {
                self.counts.environment_frames += 1;
                self.pairing.push_environment(frame);
            }
            SessionEvent::TrackerBytes { bytes, arrived_at } => {
                let (pairing, counts) = (&mut self.pairing, &mut self.counts);
                self.decoder.push(&bytes, arrived_at, |sample: PoseSample| {
                    counts.poses += 1;
                    pairing.push_pose(&sample);
                });
            }
            SessionEvent::Pose(sample) => {
                self.counts.poses += 1;
                self.pairing.push_pose(&sample);
            }
        }
        self.pairing.advance(self.last_arrival);
    }

    /// What came in so far.
    #[must_use]
    pub const fn counts(&self) -> FeedCounts {
        self.counts
    }

    /// What was paired so far.
    #[must_use]
    pub fn pairing_counts(&self) -> PairingCounts {
        self.pairing.counts()
    }

    /// What the tracker's decoder has met.
    #[must_use]
    pub const fn tracker_counters(&self) -> Counters {
        self.decoder.counters()
    }
}

/// Brackets to wait for: none where the scene camera sees the sphere itself.
#[must_use]
pub fn pairing_config(rig: &RigCalibration) -> PairingConfig {
    let mut config = PairingConfig::for_rig(rig);
    let in_scene = rig
        .environment
        .as_ref()
        .is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }));
    if in_scene {
        config.brackets = 0;
    }
    config
}

/// The recorded FASTRAK speaks ASCII with Euler angles, in the calibration's unit.
fn record_format(tracker: Option<&TrackerCalibration>) -> Format {
    Format {
        encoding: Encoding::Ascii,
        orientation: Orientation::Euler,
        ending: Ending::CrLf,
        metres_per_unit: tracker.map_or(0.0254, |t| t.metres_per_unit),
        ..Format::default()
    }
}
