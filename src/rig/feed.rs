//! Pairs arriving pictures and tracker readings into rig frames.
//!
//! Pairing depends only on the arrivals and their order. A live rig skips pictures after pairing.
//! A recording holds both the arrivals and the skips, so a replay pairs as the live rig did and
//! knows which pictures the live light estimate used.

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

/// Time without a picture after which a live rig reports [`Next::Idle`].
const IDLE_TIMEOUT: Duration = Duration::from_millis(200);
/// Maximum time from a picture's arrival to its journal entry, nanoseconds.
const MAX_ENTRY_DELAY_NANOS: i64 = 2_000_000_000;
/// Maximum number of bytes read ahead in search of a journal entry.
const MAX_READ_AHEAD_BYTES: usize = 64 << 20;

/// Maximum number of damaged parts that wait to be taken.
const MAX_DAMAGE: usize = 1024;

/// Pairs the events of a recording or of live devices.
pub struct Feed {
    origin: Origin,
    decoder: Option<(Arc<str>, AnyDecoder)>,
    metres_per_unit: Option<f64>,
    pairing: Pairing,
    sphere_in_scene: bool,
    counts: FeedCounts,
    tracker: Counters,
    /// Damaged parts of the recording that nobody has taken yet.
    damage: Vec<SessionError>,
}

enum Origin {
    Recorded(Box<Recorded>),
    Live(Arc<Hub>),
}

/// A recording and the events that were read ahead.
struct Recorded {
    session: Session,
    events: Events,
    ahead: VecDeque<Result<SessionEvent, SessionError>>,
    is_exhausted: bool,
    /// Whether the live rig's journal entries are read.
    follows_journal: bool,
}

/// A paired picture with its journal entry.
pub struct JournaledFrame {
    /// The paired picture.
    pub frame: RigFrame,
    /// Number of older pictures that a live rig skipped in favour of this one.
    pub skipped: u64,
    /// The live rig's journal entry of the picture.
    pub entry: JournalEntry,
}

/// The recent poses of the tracker's sensor.
#[derive(Clone, Copy)]
pub(crate) struct TrackerHistory<'a> {
    /// The poses, by measurement time.
    pub poses: &'a PoseHistory,
    /// Time from measurement to arrival, nanoseconds.
    pub latency_nanos: i64,
}

/// Counts of received data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FeedCounts {
    /// Pictures of the scene camera.
    pub scene_frames: u64,
    /// Pictures of the environment camera, brackets included.
    pub environment_frames: u64,
    /// Readings of the tracker.
    pub poses: u64,
    /// Bytes of the tracker.
    pub tracker_bytes: u64,
    /// Unreadable sections of the recording.
    pub damaged: u64,
    /// When this was counted, by the system clock.
    pub counted_at: MonotonicTime,
}

impl Feed {
    /// Creates a feed that starts at the beginning of `source`. `follow_journal` reads the journal
    /// entries of the live rig from its recording.
    #[must_use]
    pub fn new(
        source: &Source,
        rig: &RigCalibration,
        config: PairingConfig,
        follow_journal: bool,
    ) -> Self {
        let origin = match source {
            Source::Recorded(session) => Origin::Recorded(Box::new(Recorded {
                events: session.events(),
                session: session.clone(),
                ahead: VecDeque::new(),
                is_exhausted: false,
                follows_journal: follow_journal && session.has_journal(),
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
            damage: Vec::new(),
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

    /// Restarts the recording for another loop, with empty pairing state.
    pub fn rewind(&mut self, config: PairingConfig) {
        if let Origin::Recorded(recorded) = &mut self.origin {
            recorded.events = recorded.session.events();
            recorded.ahead.clear();
            recorded.is_exhausted = false;
        }
        self.retire_decoder();
        self.pairing = Pairing::new(self.origin.with_recorded_poses(config));
    }

    /// Returns the next paired picture of the scene camera. Passes the tracker's readings to
    /// `monitor` as well, and pairs with the latency that `monitor` has measured.
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
                    entry: recorded.journal_entry(frame.scene.arrived_at),
                    skipped: 0,
                    frame,
                }));
            }
            if recorded.is_exhausted {
                return Next::Ended;
            }
            match recorded.next() {
                Some(Ok(event)) => self.push(event, monitor.as_deref_mut()),
                // The reader continues behind the damaged section.
                Some(Err(error)) => {
                    self.counts.damaged += 1;
                    if self.damage.len() < MAX_DAMAGE {
                        self.damage.push(error);
                    }
                }
                None => {
                    recorded.is_exhausted = true;
                    self.pairing.finish();
                }
            }
        }
    }

    /// Pairs all waiting deliveries and returns the newest picture.
    fn next_live(
        &mut self,
        hub: &Hub,
        mut monitor: Option<&mut LatencyMonitor>,
    ) -> Next<Box<JournaledFrame>> {
        let (mut newest, mut skipped) = (None, 0);
        // Tracker readings alone keep `hub.take` from timing out, but yield no picture.
        let deadline = SystemClock.now() + IDLE_TIMEOUT;
        loop {
            while let Some(frame) = self.pairing.pop() {
                skipped += u64::from(newest.replace(frame).is_some());
            }
            let delivery = match &newest {
                Some(_) => match hub.take_waiting() {
                    Some(delivery) => delivery,
                    None => break,
                },
                None if SystemClock.now() >= deadline => return Next::Idle,
                None => match hub.take(self.pairing.deadline(), IDLE_TIMEOUT) {
                    Next::Item(delivery) => delivery,
                    Next::Idle => return Next::Idle,
                    Next::Ended => return Next::Ended,
                },
            };
            match delivery {
                Delivery::Event(event) => self.push(event, monitor.as_deref_mut()),
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

    fn push(&mut self, event: SessionEvent, monitor: Option<&mut LatencyMonitor>) {
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
            // The journal entry of an earlier picture; nothing has arrived.
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
        counts.tracker_bytes += bytes.len() as u64;
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

    /// Takes the damaged parts of the recording that were skipped since the last call.
    pub fn take_damage(&mut self) -> Vec<SessionError> {
        std::mem::take(&mut self.damage)
    }

    /// Returns the counts of received data so far.
    #[must_use]
    pub fn counts(&self) -> FeedCounts {
        FeedCounts {
            counted_at: SystemClock.now(),
            ..self.counts
        }
    }

    /// Returns the counts of the pairing so far.
    #[must_use]
    pub fn pairing_counts(&self) -> PairingCounts {
        self.pairing.counts()
    }

    /// Returns the estimated number of lost readings: by the tracker's rate, or by the bytes that
    /// belonged to no record. The rate misses many if a quarter is lost; bytes miss whole records.
    #[must_use]
    pub fn lost_readings(&self) -> u64 {
        let decoded = self.tracker_counters();
        let intact = self
            .counts
            .tracker_bytes
            .saturating_sub(decoded.skipped_bytes);
        let lost_bytes = decoded.skipped_bytes.saturating_mul(decoded.records);
        let by_bytes = lost_bytes.checked_div(intact).unwrap_or(0);
        self.pairing.counts().lost_readings.max(by_bytes)
    }

    /// Returns the counters of the tracker's decoders so far, summed.
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
    /// Returns `config` with a station for recorded poses. A session that holds poses instead of a
    /// tracker's bytes, e.g. an imported TUM session, has poses of the scene camera itself, which
    /// need no calibration of a tracker.
    fn with_recorded_poses(&self, config: PairingConfig) -> PairingConfig {
        let Self::Recorded(recorded) = self else {
            return config;
        };
        let bytes = recorded.session.tracker_protocol();
        let station = bytes
            .is_none()
            .then_some(1)
            .filter(|_| !recorded.follows_journal);
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

    /// Returns the live rig's journal entry of the picture that arrived at `picture_at`. That
    /// entry, or the entry of a later picture, follows the picture closely.
    fn journal_entry(&mut self, picture_at: MonotonicTime) -> JournalEntry {
        if !self.follows_journal {
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
                    let delay = event.arrived_at().nanos_since(picture_at);
                    if delay > MAX_ENTRY_DELAY_NANOS || bytes > MAX_READ_AHEAD_BYTES {
                        return JournalEntry::Skipped;
                    }
                }
                _ => (),
            }
            i += 1;
        }
    }
}

/// Returns whether the scene camera itself observes the light, in a mirrored sphere.
fn is_sphere_in_scene(rig: &RigCalibration) -> bool {
    let environment = rig.environment.as_ref();
    environment.is_some_and(|e| matches!(e.view, EnvironmentView::SphereInScene { .. }))
}

/// Creates the decoder of a tracker's bytes. An unknown protocol is decoded as the default format
/// of a FASTRAK; the decoder counts the bytes that it cannot decode.
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
