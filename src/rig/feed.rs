//! What arrives becomes paired rig frames.
//!
//! Pairing is a function of what arrives and in which order, a live rig's passing over of
//! pictures comes after it, and both are written into a recording. So a replay pairs as the
//! live rig did, and knows which pictures its light has seen.

use super::latency_watch::{LatencyState, LatencyWatch};
use super::source::Source;
use penumbra_camera::EnvironmentView;
use penumbra_capture::{Delivery, Hub, Next};
use penumbra_interface::{Clock, MonotonicTime, PoseSample, RigidTransform, SystemClock};
use penumbra_picture::Picture;
use penumbra_rig_model::RigCalibration;
use penumbra_session::{Events, LightNote, Session, SessionError, SessionEvent};
use penumbra_sync::{Pairing, PairingConfig, PairingCounts, PoseHistory, RigFrame};
use penumbra_tracker_serial::{AnyDecoder, Counters, Format};
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::Duration;

/// A live rig without pictures says so this often.
const PATIENCE: Duration = Duration::from_millis(200);
/// How far behind a picture the live rig's note about it is looked for.
const NOTE_NANOS: i64 = 2_000_000_000;
/// Bytes that are read ahead for it at most.
const NOTE_BYTES: usize = 64 << 20;

/// Pairs what a recording holds or devices deliver.
pub struct Feed {
    origin: Origin,
    decoder: Option<(Arc<str>, AnyDecoder)>,
    metres_per_unit: Option<f64>,
    pairing: Pairing,
    sphere_in_scene: bool,
    counts: FeedCounts,
    tracker: Counters,
    watch: Option<LatencyWatch>,
}

enum Origin {
    Recorded(Box<Recorded>),
    Live(Arc<Hub>),
}

/// A recording, and what was read of it ahead of time.
struct Recorded {
    session: Session,
    events: Events,
    ahead: VecDeque<Result<SessionEvent, SessionError>>,
    exhausted: bool,
    /// The live rig's notes are looked at.
    as_live: bool,
}

/// What [`Feed::next_picture`] gives.
pub enum Fed {
    /// A picture of the scene camera with what belongs to it.
    Frame(Box<FedFrame>),
    /// Devices have been silent for a while.
    Idle,
    /// No more will come.
    End,
}

/// A paired picture.
pub struct FedFrame {
    /// It.
    pub frame: RigFrame,
    /// Pictures that a live rig passed over for it.
    pub passed_over: u64,
    /// What a live rig noted about it.
    pub noted: Noted,
}

/// What the recording of a live rig says about a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Noted {
    /// Nothing: no rig has composed it before.
    Nothing,
    /// The rig passed it over, and its light has not seen it.
    PassedOver,
    /// It was composed; older recordings do not say in which light.
    Composed(Option<LightNote>),
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
    /// From the beginning. `as_live` follows what a live rig noted in its recording.
    #[must_use]
    pub fn new(
        source: &Source,
        rig: &RigCalibration,
        config: PairingConfig,
        as_live: bool,
    ) -> Self {
        let origin = match source {
            Source::Recorded(session) => Origin::Recorded(Box::new(Recorded {
                events: session.events(),
                session: session.clone(),
                ahead: VecDeque::new(),
                exhausted: false,
                as_live: as_live && session.has_journal(),
            })),
            Source::Live(live) => Origin::Live(Arc::clone(&live.hub)),
        };
        Self {
            decoder: None,
            metres_per_unit: rig.tracker.as_ref().map(|t| t.metres_per_unit),
            sphere_in_scene: is_sphere_in_scene(rig),
            pairing: Pairing::new(origin.with_recorded_poses(config)),
            origin,
            counts: FeedCounts::default(),
            tracker: Counters::default(),
            watch: None,
        }
    }

    /// With somebody who is told the tracker's readings, to measure its latency.
    #[must_use]
    pub(super) fn watched_by(mut self, watch: Option<LatencyWatch>) -> Self {
        self.watch = watch;
        self
    }

    /// Shows the scene camera's picture to whoever measures the latency, and lets what is
    /// measured come into force where that is wished.
    pub(super) fn watch_picture(
        &mut self,
        captured_at: MonotonicTime,
        picture: &Picture,
        by_markers: Option<RigidTransform>,
    ) {
        if let Some(watch) = &mut self.watch {
            watch.look(captured_at, picture, by_markers);
            if let Some(latency) = watch.wished_latency() {
                self.pairing.wish_tracker_latency(latency);
            }
        }
    }

    /// The tracker's readings.
    pub(super) const fn history(&self) -> &PoseHistory {
        self.pairing.history()
    }

    /// From their measurement to their arrival, nanoseconds.
    pub(super) const fn tracker_latency(&self) -> i64 {
        self.pairing.tracker_latency()
    }

    /// What was measured of the tracker's latency; all that is known once a recording is over.
    pub(super) fn latency(&mut self, over: bool) -> LatencyState {
        let watch = self.watch.as_mut();
        let followed = watch.map(|w| if over { w.finish() } else { w.known() });
        LatencyState {
            in_force_nanos: self.pairing.tracker_latency(),
            followed,
        }
    }

    /// Begins again, as a loop does: what is paired next has nothing to do with what was.
    pub fn rewind(&mut self, config: PairingConfig) {
        if let Origin::Recorded(recorded) = &mut self.origin {
            recorded.events = recorded.session.events();
            recorded.ahead.clear();
            recorded.exhausted = false;
        }
        self.retire_decoder();
        self.pairing = Pairing::new(self.origin.with_recorded_poses(config));
        if let Some(watch) = &mut self.watch {
            watch.restart();
        }
    }

    /// The next picture of the scene camera with what belongs to it.
    pub fn next_picture(&mut self) -> Fed {
        match &self.origin {
            Origin::Recorded(_) => self.next_recorded(),
            Origin::Live(hub) => {
                let hub = Arc::clone(hub);
                self.next_live(&hub)
            }
        }
    }

    fn next_recorded(&mut self) -> Fed {
        loop {
            let Origin::Recorded(recorded) = &mut self.origin else {
                return Fed::End;
            };
            if let Some(frame) = self.pairing.pop() {
                return Fed::Frame(Box::new(FedFrame {
                    noted: recorded.note_about(frame.scene.arrived_at),
                    passed_over: 0,
                    frame,
                }));
            }
            if recorded.exhausted {
                return Fed::End;
            }
            match recorded.next() {
                Some(Ok(event)) => self.take(event),
                // The reader has left the damaged stretch behind; status counts it.
                Some(Err(_)) => self.counts.damaged += 1,
                None => {
                    recorded.exhausted = true;
                    self.pairing.finish();
                }
            }
        }
    }

    /// Everything that waits is paired, and the newest picture wins.
    fn next_live(&mut self, hub: &Hub) -> Fed {
        let (mut newest, mut passed_over) = (None, 0);
        // A tracker alone keeps things arriving, but no picture ever comes of it.
        let longest = SystemClock.now() + PATIENCE;
        loop {
            while let Some(frame) = self.pairing.pop() {
                passed_over += u64::from(newest.replace(frame).is_some());
            }
            let delivery = match &newest {
                Some(_) => match hub.take_waiting() {
                    Some(delivery) => delivery,
                    None => break,
                },
                None if SystemClock.now() >= longest => return Fed::Idle,
                None => match hub.take(self.pairing.deadline(), PATIENCE) {
                    Next::Item(delivery) => delivery,
                    Next::Idle => return Fed::Idle,
                    Next::Ended => return Fed::End,
                },
            };
            match delivery {
                Delivery::Event(event) => self.take(event),
                Delivery::Superseded { arrived_at } => {
                    self.counts.scene_frames += 1;
                    self.pairing.pass_over(arrived_at);
                    passed_over += 1;
                }
            }
        }
        let Some(frame) = newest else {
            return Fed::Idle;
        };
        Fed::Frame(Box::new(FedFrame {
            frame,
            passed_over,
            noted: Noted::Nothing,
        }))
    }

    /// Notes for a recording that the picture of this arrival is composed, in which light.
    pub fn note(&self, arrived_at: MonotonicTime, light: LightNote) {
        if let Origin::Live(hub) = &self.origin {
            hub.journal(&SessionEvent::Prepared {
                at: SystemClock.now(),
                arrived_at,
                light: Some(light),
            });
        }
    }

    fn take(&mut self, event: SessionEvent) {
        let arrived_at = event.arrived_at();
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
            SessionEvent::TrackerBytes {
                protocol, bytes, ..
            } => self.decode(&protocol, &bytes, arrived_at),
            SessionEvent::Pose(sample) => {
                self.counts.poses += 1;
                self.pairing.push_pose(&sample);
                if let Some(watch) = &mut self.watch {
                    watch.reading(&sample);
                }
            }
            SessionEvent::Tick(_) => (),
            // A note about what was paired before, not an arrival.
            SessionEvent::Prepared { .. } => return,
        }
        self.pairing.advance(arrived_at);
    }

    fn decode(&mut self, protocol: &Arc<str>, bytes: &[u8], arrived_at: MonotonicTime) {
        if self
            .decoder
            .as_ref()
            .is_none_or(|(known, _)| known != protocol)
        {
            self.retire_decoder();
            let decoder = decoder_for(protocol, self.metres_per_unit);
            self.decoder = Some((Arc::clone(protocol), decoder));
        }
        let Some((_, decoder)) = &mut self.decoder else {
            return;
        };
        let (pairing, counts) = (&mut self.pairing, &mut self.counts);
        let watch = &mut self.watch;
        decoder.push(bytes, arrived_at, |sample: PoseSample| {
            counts.poses += 1;
            pairing.push_pose(&sample);
            if let Some(watch) = watch {
                watch.reading(&sample);
            }
        });
    }

    fn retire_decoder(&mut self) {
        self.tracker = self.tracker_counters();
        self.decoder = None;
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

    /// What the tracker's decoders have met.
    #[must_use]
    pub fn tracker_counters(&self) -> Counters {
        let mut sum = self.tracker;
        if let Some((_, decoder)) = &self.decoder {
            let new = decoder.counters();
            sum.records += new.records;
            sum.skipped_bytes += new.skipped_bytes;
        }
        sum
    }
}

impl Origin {
    /// A session whose poses are no tracker's bytes, such as an imported TUM one, has poses
    /// of the scene camera itself, and needs no tracker's calibration for them.
    fn with_recorded_poses(&self, config: PairingConfig) -> PairingConfig {
        let Self::Recorded(recorded) = self else {
            return config;
        };
        let bytes = recorded.session.tracker_protocol();
        let station = bytes.is_none().then_some(1).filter(|_| !recorded.as_live);
        PairingConfig {
            station: config.station.or(station),
            ..config
        }
    }
}

impl Recorded {
    fn next(&mut self) -> Option<Result<SessionEvent, SessionError>> {
        self.ahead.pop_front().or_else(|| self.events.next())
    }

    /// What the live rig noted about the picture of this arrival. Its note about that, or
    /// about a later picture, comes soon after.
    fn note_about(&mut self, picture_at: MonotonicTime) -> Noted {
        if !self.as_live {
            return Noted::Nothing;
        }
        let (mut i, mut bytes) = (0, 0);
        loop {
            if i == self.ahead.len() {
                match self.events.next() {
                    Some(event) => self.ahead.push_back(event),
                    None => return Noted::PassedOver,
                }
            }
            match self.ahead.get(i) {
                Some(Ok(SessionEvent::Prepared {
                    arrived_at, light, ..
                })) if *arrived_at >= picture_at => {
                    return if *arrived_at == picture_at {
                        Noted::Composed(*light)
                    } else {
                        Noted::PassedOver
                    };
                }
                Some(Ok(event)) => {
                    bytes += event.bytes();
                    let far = event.arrived_at().nanos_since(picture_at) > NOTE_NANOS;
                    if far || bytes > NOTE_BYTES {
                        return Noted::PassedOver;
                    }
                }
                _ => (),
            }
            i += 1;
        }
    }
}

/// The scene camera itself sees the light, on a mirrored sphere.
#[must_use]
pub fn is_sphere_in_scene(rig: &RigCalibration) -> bool {
    let environment = rig.environment.as_ref();
    environment.is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }))
}

/// What reads the bytes. A protocol that nobody knows is read as a FASTRAK's default; the
/// decoder counts what it cannot read.
pub(super) fn decoder_for(protocol: &str, metres_per_unit: Option<f64>) -> AnyDecoder {
    let decoder =
        AnyDecoder::for_protocol(protocol).unwrap_or_else(|| AnyDecoder::new(Format::default()));
    match metres_per_unit {
        Some(metres) => decoder.with_metres_per_unit(metres),
        None => decoder,
    }
}

#[cfg(test)]
mod tests;
