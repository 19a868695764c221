//! Finds irregular deliveries: repeated, out of order, late, all at once, or with impossible times
//! or numbers. What would harm the picture is corrected or left out; everything is counted, so that
//! the status names it.

use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use std::collections::VecDeque;

/// What is irregular about a delivery.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Irregularity {
    /// It came twice; the second one is left out.
    Repeated,
    /// It is older than the one before; it is left out.
    OutOfOrder,
    /// Its time stamp goes back, or cannot be true; an impossible one is replaced by its arrival.
    TimeStamp,
    /// Its exposure is not a number; without a number for the bracket it is left out.
    NotANumber,
    /// It came long after it was due.
    Late,
    /// It came together with many others.
    Burst,
    /// It cannot be decoded.
    Undecodable,
}

impl Irregularity {
    /// All kinds.
    pub const ALL: [Self; 7] = [
        Self::Repeated,
        Self::OutOfOrder,
        Self::TimeStamp,
        Self::NotANumber,
        Self::Late,
        Self::Burst,
        Self::Undecodable,
    ];

    /// A description for the status.
    #[must_use]
    pub const fn description(self) -> &'static str {
        match self {
            Self::Repeated => "the same delivery twice",
            Self::OutOfOrder => "out of order, left out",
            Self::TimeStamp => "impossible time stamp",
            Self::NotANumber => "exposure that is no number",
            Self::Late => "long pause between deliveries",
            Self::Burst => "many deliveries at once",
            Self::Undecodable => "cannot be decoded",
        }
    }
}

/// Numbers of irregular deliveries by kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct IrregularCounts([u64; Irregularity::ALL.len()]);

impl IrregularCounts {
    /// Number of deliveries of a kind.
    #[must_use]
    pub const fn get(&self, kind: Irregularity) -> u64 {
        self.0[kind as usize]
    }

    pub(crate) const fn add(&mut self, kind: Irregularity) {
        self.0[kind as usize] += 1;
    }
}

/// Number of recent arrivals that tell what is usual.
const WINDOW: usize = 32;
/// A shorter pause is not late, nanoseconds.
const MIN_LATE_NANOS: i64 = 100_000_000;
/// A longer pause is a silence, after which the device may deliver in another way, nanoseconds.
const SILENCE_NANOS: i64 = 2_000_000_000;
/// Time within which deliveries count as simultaneous, nanoseconds.
const BURST_NANOS: i64 = 50_000_000;
/// Number of simultaneous deliveries beyond twice the usual one that is a burst.
const BURST_SLACK: usize = 3;

/// Compares the arrivals of a device with its usual ones.
#[derive(Debug, Default)]
pub(crate) struct ArrivalCheck {
    recent: VecDeque<MonotonicTime>,
    /// Number of deliveries within [`BURST_NANOS`] up to each of the recent ones.
    together: VecDeque<usize>,
}

impl ArrivalCheck {
    /// Adds an arrival; returns what is irregular about it.
    pub fn add(&mut self, at: MonotonicTime) -> Option<Irregularity> {
        let gap = self.recent.back().map(|newest| at.nanos_since(*newest));
        if gap.is_some_and(|gap| !(0..=SILENCE_NANOS).contains(&gap)) {
            self.recent.clear();
            self.together.clear();
        }
        let usual = (self.recent.len() == WINDOW).then(|| (self.longest(), self.most(at)));
        let is_recent = |t: &&MonotonicTime| at.nanos_since(**t) <= BURST_NANOS;
        let together = 1 + self.recent.iter().rev().take_while(is_recent).count();
        if self.recent.len() == WINDOW {
            self.recent.pop_front();
            self.together.pop_front();
        }
        self.recent.push_back(at);
        self.together.push_back(together);
        let (longest, most) = usual?;
        if gap.is_some_and(|gap| gap > MIN_LATE_NANOS.max(2 * longest)) {
            return Some(Irregularity::Late);
        }
        // Once a burst.
        (together == 2 * most + BURST_SLACK + 1).then_some(Irregularity::Burst)
    }

    /// Whether a delivery at `at` follows the one before far sooner than usual.
    pub fn is_premature(&self, at: MonotonicTime) -> bool {
        let (Some(first), Some(last)) = (self.recent.front(), self.recent.back()) else {
            return false;
        };
        let mean = last.nanos_since(*first) / self.recent.len().max(1) as i64;
        at.nanos_since(*last) < mean / 4
    }

    fn longest(&self) -> i64 {
        let pairs = self.recent.iter().zip(self.recent.iter().skip(1));
        pairs.map(|(a, b)| b.nanos_since(*a)).max().unwrap_or(0)
    }

    /// The largest number of simultaneous deliveries before those at `at`.
    fn most(&self, at: MonotonicTime) -> usize {
        let all = self.recent.iter().zip(&self.together);
        let earlier = all.filter(|(t, _)| at.nanos_since(**t) > BURST_NANOS);
        earlier.map(|(_, together)| *together).max().unwrap_or(1)
    }
}

/// Length of the end of a JPEG file in which its end is marked, bytes: cameras append others.
const JPEG_TAIL: usize = 1 << 16;

/// Returns whether a coded picture has a beginning and an end. Damage between them only a decoder
/// finds.
pub(crate) fn is_whole(frame: &Frame) -> bool {
    let data = &frame.data;
    let tail = &data[data.len().saturating_sub(JPEG_TAIL)..];
    let ends_with = |mark: &[u8]| tail.windows(mark.len()).rev().any(|window| window == mark);
    match frame.format {
        PixelFormat::Jpeg => data.starts_with(b"\xff\xd8\xff") && ends_with(b"\xff\xd9"),
        PixelFormat::Png => data.starts_with(b"\x89PNG") && ends_with(b"IEND"),
        _ => true,
    }
}

/// Ages of a picture at its arrival that can be true, nanoseconds.
const AGES: std::ops::RangeInclusive<i64> = -500_000_000..=5_000_000_000;

/// Compares the pictures of a camera with one another.
#[derive(Debug, Default)]
pub(crate) struct FrameCheck {
    last: Option<Stamp>,
    /// Age at arrival of the last picture with a possible one, nanoseconds.
    age: i64,
}

/// What tells one picture from another.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stamp {
    sequence: u64,
    bracket_ev: f64,
    captured_at: MonotonicTime,
}

impl FrameCheck {
    /// Corrects a picture; returns whether it is to be used. Passes what is irregular to `note`.
    pub fn check(&mut self, frame: &mut Frame, mut note: impl FnMut(Irregularity)) -> bool {
        let exposure = frame.exposure;
        let is_number = |v: f64| v.is_finite() && v > 0.0;
        if exposure.is_some_and(|e| !is_number(e.exposure_micros) || !is_number(e.gain)) {
            note(Irregularity::NotANumber);
            frame.exposure = None;
        }
        if !frame.bracket_ev.is_finite() {
            note(Irregularity::NotANumber);
            return false;
        }
        let age = frame.arrived_at.nanos_since(frame.captured_at);
        if AGES.contains(&age) {
            self.age = age;
        } else {
            note(Irregularity::TimeStamp);
            frame.captured_at = frame.arrived_at.offset_nanos(-self.age);
        }
        let stamp = Stamp {
            sequence: frame.sequence,
            bracket_ev: frame.bracket_ev,
            captured_at: frame.captured_at,
        };
        let Some(last) = self.last else {
            self.last = Some(stamp);
            return true;
        };
        if stamp == last {
            note(Irregularity::Repeated);
            return false;
        }
        let goes_back = stamp.captured_at < last.captured_at;
        if goes_back && stamp.sequence < last.sequence {
            note(Irregularity::OutOfOrder);
            return false;
        }
        if goes_back && stamp.sequence > last.sequence {
            note(Irregularity::TimeStamp);
        }
        self.last = Some(stamp);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bytes::Bytes;
    use penumbra_interface::Exposure;

    const MILLI: i64 = 1_000_000;

    fn frame(sequence: u64, captured_ms: i64) -> Frame {
        let captured_at = MonotonicTime::from_nanos(captured_ms * MILLI);
        Frame {
            data: Bytes::from_static(b"x"),
            format: PixelFormat::Jpeg,
            width: 0,
            height: 0,
            stride: 0,
            sequence,
            captured_at,
            arrived_at: captured_at.offset_nanos(20 * MILLI),
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        }
    }

    /// Returns the kept pictures and what is irregular.
    fn checked(frames: Vec<Frame>) -> (Vec<Frame>, Vec<Irregularity>) {
        let (mut check, mut notes) = (FrameCheck::default(), Vec::new());
        let kept = frames.into_iter().filter_map(|mut frame| {
            let is_kept = check.check(&mut frame, |kind| notes.push(kind));
            is_kept.then_some(frame)
        });
        (kept.collect(), notes)
    }

    #[test]
    fn repeated_and_older_pictures_are_left_out() {
        let frames = [(1, 0), (2, 33), (2, 33), (4, 99), (3, 66), (5, 132)];
        let (kept, notes) = checked(frames.map(|(n, ms)| frame(n, ms)).into());
        let numbers: Vec<_> = kept.iter().map(|f| f.sequence).collect();
        assert_eq!(numbers, [1, 2, 4, 5]);
        assert_eq!(notes, [Irregularity::Repeated, Irregularity::OutOfOrder]);
    }

    #[test]
    fn restarted_counter_and_shared_numbers_of_brackets_are_regular() {
        let mut bracket = frame(9, 1);
        bracket.bracket_ev = -4.0;
        let (kept, notes) = checked(vec![frame(9, 0), bracket, frame(0, 33)]);
        assert_eq!((kept.len(), notes), (3, vec![]));
    }

    #[test]
    fn impossible_time_stamp_is_replaced_by_the_usual_age() {
        let mut stepped = frame(2, 33);
        stepped.captured_at = stepped.captured_at.offset_nanos(3_600_000 * MILLI);
        let (kept, notes) = checked(vec![frame(1, 0), stepped, frame(3, 66)]);
        assert_eq!(kept[1].captured_at, frame(2, 33).captured_at);
        assert_eq!(notes, [Irregularity::TimeStamp]);
    }

    #[test]
    fn time_stamp_that_goes_back_is_noted() {
        let (kept, notes) = checked(vec![frame(1, 100), frame(2, 50)]);
        assert_eq!((kept.len(), notes), (2, vec![Irregularity::TimeStamp]));
    }

    #[test]
    fn numbers_that_are_none_reach_nobody() {
        let mut dark = frame(1, 0);
        dark.bracket_ev = f64::NAN;
        let mut exposed = frame(2, 33);
        exposed.exposure = Some(Exposure {
            exposure_micros: f64::NAN,
            gain: 1.0,
        });
        let (kept, notes) = checked(vec![dark, exposed]);
        assert_eq!(kept.len(), 1);
        assert!(kept[0].exposure.is_none());
        assert_eq!(notes, [Irregularity::NotANumber; 2]);
    }

    #[test]
    fn coded_pictures_have_a_beginning_and_an_end() {
        let whole = |format, data: &'static [u8]| {
            let data = Bytes::from_static(data);
            is_whole(&Frame {
                data,
                format,
                ..frame(1, 0)
            })
        };
        assert!(whole(
            PixelFormat::Jpeg,
            b"\xff\xd8\xff\xe0 picture \xff\xd9\0\0"
        ));
        assert!(!whole(PixelFormat::Jpeg, b"\xff\xd8\xff\xe0 half a pic"));
        assert!(!whole(PixelFormat::Jpeg, b"noise \xff\xd9"));
        assert!(!whole(PixelFormat::Jpeg, b""));
        assert!(whole(
            PixelFormat::Png,
            b"\x89PNG picture IEND\xae\x42\x60\x82"
        ));
        assert!(!whole(PixelFormat::Png, b"\x89PNG half a pic"));
        assert!(whole(PixelFormat::Grey8, b"anything"));
    }

    fn arrivals(times_ms: impl IntoIterator<Item = i64>) -> Vec<Irregularity> {
        let mut check = ArrivalCheck::default();
        let times = times_ms
            .into_iter()
            .map(|ms| MonotonicTime::from_nanos(ms * MILLI));
        times.filter_map(|at| check.add(at)).collect()
    }

    #[test]
    fn pause_and_burst_are_named_once() {
        let steady = (0..40).map(|i| i * 33);
        let slow = (0..10).map(|i| 39 * 33 + 150 + i * 150);
        assert_eq!(arrivals(steady.clone().chain(slow)), [Irregularity::Late]);
        let burst = (0..8).map(|i| 39 * 33 + 33 + i);
        assert_eq!(arrivals(steady.chain(burst)), [Irregularity::Burst]);
    }

    #[test]
    fn regular_batches_and_silences_are_no_irregularity() {
        // Three exposures at once, every tenth of a second; then a silence.
        let batches = (0..60).map(|i| i / 3 * 100 + if i < 30 { 0 } else { 5_000 });
        assert_eq!(arrivals(batches), []);
    }
}
