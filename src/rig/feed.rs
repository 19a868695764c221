//! What arrives becomes paired rig frames.
//!
//! Pairing is a function of what arrives and in which order, a live rig's passing over of
//! pictures comes after it, and both are written into a recording. So a replay pairs as the
//! live rig did, and knows which pictures its light has seen.

use crate::journal::JournalEntry;
use crate::latency_monitor::LatencyMonitor;
use crate::source::Source;
use penumbra_camera::EnvironmentView;
use penumbra_capture::{Delivery, Hub, Next};
use penumbra_interface::{Clock, MonotonicTime, PoseSample, SystemClock};
use penumbra_rig_model::RigCalibration;
use penumbra_session::{Events, Session, SessionError, SessionEvent};
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

/// A paired picture.
pub struct JournaledFrame {
    /// It.
    pub frame: RigFrame,
    /// Pictures that a live rig passed over for it.
    pub skipped: u64,
    /// What a live rig noted about it.
    pub entry: JournalEntry,
}

/// The recent poses of the tracker's sensor.
#[derive(Clone, Copy)]
pub(crate) struct TrackerHistory<'a> {
    /// The poses by measurement time.
    pub poses: &'a PoseHistory,
    /// Time from measurement to arrival, nanoseconds.
    pub latency_nanos: i64,
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
        }
    }

    /// Returns the tracker's recent poses and its latency.
    pub(crate) const fn tracker(&self) -> TrackerHistory<'_> {
        TrackerHistory {
            poses: self.pairing.history(),
            latency_nanos: self.pairing.tracker_latency(),
        }
    }

    /// Returns the tracker's latency that pairing uses, nanoseconds.
    pub(crate) const fn tracker_latency(&self) -> i64 {
        self.pairing.tracker_latency()
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
    }

    /// Returns the next picture of the scene camera, paired. The tracker's readings also go to
    /// `monitor`, and the latency that it has found is used for pairing from now on.
    pub(crate) fn next_picture(
        &mut self,
        mut monitor: Option<&mut LatencyMonitor>,
    ) -> Next<Box<JournaledFrame>> {
        if let Some(latency) = monitor.as_ref().and_then(|m| m.requested_latency()) {
            self.pairing.set_target_latency(latency);
        }
        match &self.origin {
            Origin::Recorded(_) => self.next_recorded(monitor.as_deref_mut()),
            Origin::Live(hub) => {
                let hub = Arc::clone(hub);
                self.next_live(&hub, monitor)
            }
        }
    }

    fn next_recorded(
        &mut self,
        mut monitor: Option<&mut LatencyMonitor>,
    ) -> Next<Box<JournaledFrame>> {
        loop {
            let Origin::Recorded(recorded) = &mut self.origin else {
                return Next::Ended;
            };
            if let Some(frame) = self.pairing.pop() {
                return Next::Item(Box::new(JournaledFrame {
                    entry: recorded.note_about(frame.scene.arrived_at),
                    skipped: 0,
                    frame,
                }));
            }
            if recorded.exhausted {
                return Next::Ended;
            }
            match recorded.next() {
                Some(Ok(event)) => self.take(event, monitor.as_deref_mut()),
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
    fn next_live(
        &mut self,
        hub: &Hub,
        mut monitor: Option<&mut LatencyMonitor>,
    ) -> Next<Box<JournaledFrame>> {
        let (mut newest, mut skipped) = (None, 0);
        // A tracker alone keeps things arriving, but no picture ever comes of it.
        let longest = SystemClock.now() + PATIENCE;
        loop {
            while let Some(frame) = self.pairing.pop() {
                skipped += u64::from(newest.replace(frame).is_some());
            }
            let delivery = match &newest {
                Some(_) => match hub.take_waiting() {
                    Some(delivery) => delivery,
                    None => break,
                },
                None if SystemClock.now() >= longest => return Next::Idle,
                None => match hub.take(self.pairing.deadline(), PATIENCE) {
                    Next::Item(delivery) => delivery,
                    Next::Idle => return Next::Idle,
                    Next::Ended => return Next::Ended,
                },
            };
            match delivery {
                Delivery::Event(event) => self.take(event, monitor.as_deref_mut()),
                Delivery::Superseded { arrived_at } => {
                    self.counts.scene_frames += 1;
                    self.pairing.skip_scene(arrived_at);
                    skipped += 1;
                }
            }
        }
        let Some(frame) = newest else {
            return Next::Idle;
        };
        Next::Item(Box::new(JournaledFrame {
            frame,
            skipped,
            entry: JournalEntry::None,
        }))
    }

    fn take(&mut self, event: SessionEvent, monitor: Option<&mut LatencyMonitor>) {
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
            } => self.decode(&protocol, &bytes, arrived_at, monitor),
            SessionEvent::Pose(sample) => {
                self.counts.poses += 1;
                self.pairing.push_pose(&sample);
                if let Some(monitor) = monitor {
                    monitor.reading(&sample);
                }
            }
            SessionEvent::Tick(_) => (),
            // A note about what was paired before, not an arrival.
            SessionEvent::Prepared { .. } => return,
        }
        self.pairing.advance(arrived_at);
    }

    fn decode(
        &mut self,
        protocol: &Arc<str>,
        bytes: &[u8],
        arrived_at: MonotonicTime,
        mut monitor: Option<&mut LatencyMonitor>,
    ) {
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
        decoder.push(bytes, arrived_at, |sample: PoseSample| {
            counts.poses += 1;
            pairing.push_pose(&sample);
            if let Some(monitor) = &mut monitor {
                monitor.reading(&sample);
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
    fn note_about(&mut self, picture_at: MonotonicTime) -> JournalEntry {
        if !self.as_live {
            return JournalEntry::None;
        }
        let (mut i, mut bytes) = (0, 0);
        loop {
            if i == self.ahead.len() {
                match self.events.next() {
                    Some(event) => self.ahead.push_back(event),
                    None => return JournalEntry::Skipped,
                }
            }
            match self.ahead.get(i) {
                Some(Ok(SessionEvent::Prepared {
                    arrived_at, light, ..
                })) if *arrived_at >= picture_at => {
                    return if *arrived_at == picture_at {
                        JournalEntry::Composed(*light)
                    } else {
                        JournalEntry::Skipped
                    };
                }
                Some(Ok(event)) => {
                    bytes += event.bytes();
                    let far = event.arrived_at().nanos_since(picture_at) > NOTE_NANOS;
                    if far || bytes > NOTE_BYTES {
                        return JournalEntry::Skipped;
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
