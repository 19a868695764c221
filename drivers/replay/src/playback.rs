//! The devices.

use crate::Timeline;
use penumbra_interface::{
    Camera, CameraCounters, CameraReport, DeviceError, Frame, MonotonicTime, StampSource,
    StreamMode, Tracker, TrackerBytes, TrackerReport,
};
use std::sync::Arc;
use std::time::Duration;

/// What was recorded of one device, from the beginning, in the order of arrival.
pub type Items<T> = Box<dyn Iterator<Item = T> + Send>;

/// What a recording is made of.
pub trait Recorded: Send {
    /// When it arrived then.
    fn arrived_at(&self) -> MonotonicTime;
    /// Moves all its times.
    fn shift(&mut self, nanos: i64);
}

impl Recorded for Frame {
    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn shift(&mut self, nanos: i64) {
        self.arrived_at = self.arrived_at.offset_nanos(nanos);
        self.captured_at = self.captured_at.offset_nanos(nanos);
    }
}

impl Recorded for TrackerBytes {
    fn arrived_at(&self) -> MonotonicTime {
        self.arrived_at
    }

    fn shift(&mut self, nanos: i64) {
        self.arrived_at = self.arrived_at.offset_nanos(nanos);
    }
}

/// What is later than this is left out for something newer: the program was suspended.
const LATE_NANOS: i64 = 100_000_000;

/// One device's way through the recording, again and again.
struct Playback<T> {
    restart: Box<dyn FnMut() -> Items<T> + Send>,
    items: Items<T>,
    timeline: Arc<Timeline>,
    lap: i64,
    next: Option<T>,
    passed_over: u64,
}

impl<T: Recorded> Playback<T> {
    fn new(timeline: Arc<Timeline>, mut restart: Box<dyn FnMut() -> Items<T> + Send>) -> Self {
        let mut playback = Self {
            lap: timeline.lap(),
            items: restart(),
            restart,
            timeline,
            next: None,
            passed_over: 0,
        };
        playback.join_in();
        playback
    }

    /// Leaves out what was due before now.
    fn join_in(&mut self) {
        let now = self.timeline.now();
        while self.due().is_some_and(|due| due < now) {
            self.next = None;
        }
    }

    /// When the next item is due; `None` if nothing was recorded at all.
    fn due(&mut self) -> Option<MonotonicTime> {
        if self.next.is_none() {
            self.next = self.items.next();
        }
        if self.next.is_none() {
            self.lap += 1;
            self.items = (self.restart)();
            self.next = self.items.next();
        }
        let arrived_at = self.next.as_ref()?.arrived_at();
        Some(arrived_at.offset_nanos(self.timeline.shift_nanos(self.lap)))
    }

    /// The next item, with its times moved to the present.
    fn next(&mut self, timeout: Duration) -> Option<T> {
        loop {
            let Some(due) = self.due() else {
                self.timeline.wait(timeout);
                return None;
            };
            if !self.timeline.wait_until(due, timeout) {
                return None;
            }
            let shift = self.timeline.shift_nanos(self.lap);
            let late = self.timeline.now().nanos_since(due) > LATE_NANOS;
            let Some(mut item) = self.next.take() else {
                continue;
            };
            if late {
                self.passed_over += 1;
                continue;
            }
            item.shift(shift);
            return Some(item);
        }
    }
}

/// A camera that plays recorded frames.
pub struct ReplayCamera {
    playback: Playback<Frame>,
    report: CameraReport,
    /// The recording's number of the newest frame.
    recorded_sequence: Option<u64>,
    sequence: u64,
}

impl ReplayCamera {
    /// `identity` is who it says it is; `restart` gives the frames from the beginning.
    #[must_use]
    pub fn new(
        identity: &str,
        timeline: Arc<Timeline>,
        restart: Box<dyn FnMut() -> Items<Frame> + Send>,
    ) -> Self {
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

    /// A number that goes on where the recording begins anew. The recording's gaps stay.
    fn number(&mut self, recorded: u64) -> u64 {
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
        self.report.counters.superseded = self.playback.passed_over;
        Ok(frame.map(|mut frame| {
            frame.sequence = self.number(frame.sequence);
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
        CameraReport {
            counters: CameraCounters {
                ..self.report.counters
            },
            ..self.report.clone()
        }
    }
}

/// A tracker that plays recorded bytes.
pub struct ReplayTracker {
    playback: Playback<TrackerBytes>,
    report: TrackerReport,
}

impl ReplayTracker {
    /// `identity` is who it says it is, `protocol` how the recorded bytes are spelled;
    /// `restart` gives them from the beginning.
    #[must_use]
    pub fn new(
        identity: &str,
        protocol: &str,
        timeline: Arc<Timeline>,
        restart: Box<dyn FnMut() -> Items<TrackerBytes> + Send>,
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
mod tests {
    use super::*;
    use bytes::Bytes;
    use penumbra_interface::{Clock, PixelFormat};
    use std::sync::atomic::{AtomicI64, Ordering};

    /// Time that passes only while somebody sleeps; one for each test's thread.
    struct SleepClock;

    thread_local! {
        static NOW: AtomicI64 = const { AtomicI64::new(5_000_000_000) };
    }

    fn sleep(time: Duration) {
        NOW.with(|now| now.fetch_add(time.as_nanos() as i64, Ordering::Relaxed));
    }

    impl Clock for SleepClock {
        fn now(&self) -> MonotonicTime {
            MonotonicTime::from_nanos(NOW.with(|now| now.load(Ordering::Relaxed)))
        }
    }

    const MS: i64 = 1_000_000;

    fn at(millis: i64) -> MonotonicTime {
        MonotonicTime::from_nanos(900_000_000_000_000 + millis * MS)
    }

    fn frame(sequence: u64, millis: i64) -> Frame {
        Frame {
            data: Bytes::from_static(b"x"),
            format: PixelFormat::Jpeg,
            width: 0,
            height: 0,
            stride: 0,
            sequence,
            captured_at: at(millis - 10),
            arrived_at: at(millis),
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        }
    }

    fn timeline() -> Arc<Timeline> {
        Arc::new(Timeline::new((at(0), at(100)), Arc::new(SleepClock), sleep))
    }

    fn camera(timeline: &Arc<Timeline>) -> ReplayCamera {
        let frames =
            || Box::new([frame(7, 0), frame(8, 40), frame(10, 100)].into_iter()) as Items<Frame>;
        ReplayCamera::new("scene", timeline.clone(), Box::new(frames))
    }

    const LONG: Duration = Duration::from_secs(1);

    #[test]
    fn frames_come_at_the_recorded_distances_again_and_again_under_numbers_that_go_on() {
        let timeline = timeline();
        let mut camera = camera(&timeline);
        let start = SleepClock.now();
        let got: Vec<Frame> = (0..5)
            .map(|_| camera.next_frame(LONG).unwrap().unwrap())
            .collect();
        let millis = |t: MonotonicTime| t.nanos_since(start) / MS;
        let arrivals: Vec<_> = got.iter().map(|f| millis(f.arrived_at)).collect();
        assert_eq!(arrivals, [0, 40, 100, 133, 173]);
        assert_eq!(millis(got[1].captured_at), 30);
        let numbers: Vec<_> = got.iter().map(|f| f.sequence).collect();
        assert_eq!(numbers, [0, 1, 3, 4, 5]);
        let report = camera.report();
        assert_eq!((report.counters.frames, report.counters.lost), (5, 1));
        assert_eq!(report.stamps, StampSource::Recorded);
    }

    #[test]
    fn nothing_comes_before_its_time_and_a_short_wait_is_kept() {
        let timeline = timeline();
        let mut camera = camera(&timeline);
        camera.next_frame(LONG).unwrap().unwrap();
        let before = SleepClock.now();
        assert!(
            camera
                .next_frame(Duration::from_millis(15))
                .unwrap()
                .is_none()
        );
        assert_eq!(SleepClock.now().nanos_since(before), 15 * MS);
        assert!(
            camera
                .next_frame(Duration::from_millis(30))
                .unwrap()
                .is_some()
        );
    }

    #[test]
    fn a_device_that_is_opened_later_joins_in_where_the_others_are() {
        let timeline = timeline();
        let mut first = camera(&timeline);
        first.next_frame(LONG).unwrap().unwrap();
        sleep(Duration::from_millis(150));
        let start = SleepClock.now();
        let mut second = camera(&timeline);
        let frame = second.next_frame(LONG).unwrap().unwrap();
        // The second lap began 133 ms after the first.
        assert_eq!(frame.arrived_at.nanos_since(start) / MS, 173 - 150);
        // The first device slept all the time: what it missed is passed over.
        let frame = first.next_frame(LONG).unwrap().unwrap();
        assert!(frame.arrived_at >= start.offset_nanos(-LATE_NANOS));
    }

    #[test]
    fn an_empty_recording_is_silent_and_does_not_spin() {
        let timeline = timeline();
        let nothing = || Box::new(std::iter::empty()) as Items<TrackerBytes>;
        let mut tracker = ReplayTracker::new("t", "fastrak", timeline, Box::new(nothing));
        let before = SleepClock.now();
        assert!(tracker.next_bytes(LONG).unwrap().is_none());
        assert_eq!(SleepClock.now().nanos_since(before), 1000 * MS);
        assert_eq!(tracker.report().protocol, "fastrak");
    }
}
