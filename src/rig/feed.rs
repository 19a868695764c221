//! A session's events become paired rig frames.

use crate::calibration::rig::TrackerCalibration;
use crate::calibration::{RigCalibration, rig::EnvironmentView};
use crate::session::{Events, Session, SessionEvent};
use crate::sync::{Pairing, PairingConfig, PairingCounts, RigFrame};
use penumbra_interface::{MonotonicTime, PoseSample};
use penumbra_tracker_serial::{AnyDecoder, Counters, Format};

/// Plays a session as if its devices were here.
pub struct Feed {
    session: Session,
    events: Events,
    decoder: AnyDecoder,
    pairing: Pairing,
    exhausted: bool,
    sphere_in_scene: bool,
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
            decoder: decoder_for(&session, rig.tracker.as_ref()),
            sphere_in_scene: is_sphere_in_scene(rig),
            pairing: Pairing::new(with_recorded_poses(config, &session)),
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
        self.pairing = Pairing::new(with_recorded_poses(config, &self.session));
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
                if !self.sphere_in_scene {
                    self.pairing.push_environment(frame);
                }
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

/// The scene camera itself sees the light, on a mirrored sphere.
#[must_use]
pub fn is_sphere_in_scene(rig: &RigCalibration) -> bool {
    let environment = rig.environment.as_ref();
    environment.is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }))
}

/// A session whose poses are no tracker's bytes, such as an imported TUM one, has poses of
/// the scene camera itself, and needs no tracker's calibration for them.
fn with_recorded_poses(config: PairingConfig, session: &Session) -> PairingConfig {
    let recorded = session.tracker_protocol().is_none().then_some(1);
    PairingConfig {
        station: config.station.or(recorded),
        ..config
    }
}

/// What reads the recorded bytes. A protocol that nobody knows is read as a FASTRAK's
/// default; the decoder counts what it cannot read.
fn decoder_for(session: &Session, tracker: Option<&TrackerCalibration>) -> AnyDecoder {
    let decoder = session
        .tracker_protocol()
        .and_then(AnyDecoder::for_protocol)
        .unwrap_or_else(|| AnyDecoder::new(Format::default()));
    match tracker {
        Some(tracker) => decoder.with_metres_per_unit(tracker.metres_per_unit),
        None => decoder,
    }
}
