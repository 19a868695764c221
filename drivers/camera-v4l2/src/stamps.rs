//! The driver's stamps and counter, judged.

use crate::video::Filled;
use penumbra_interface::{MonotonicTime, StampSource};
use v4l::buffer::Flags;

/// No picture is older than this when it arrives: the stamp is of another clock then.
const OLDEST_NANOS: i64 = 5_000_000_000;
/// A stamp may lie so little in the future: it was taken on another core.
const FUTURE_NANOS: i64 = 1_000_000;

/// Reads the stamps of one stream.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stamps {
    last: Option<MonotonicTime>,
    /// What is called the start of the exposure is the arrival of the first bytes:
    /// `uvcvideo` stamps by the host's clock when the first payload comes, and flags it so.
    pub first_bytes: bool,
    /// Where the last stamp came from.
    pub source: StampSource,
    /// Stamps that could not be: backwards, from the future, from another clock.
    pub implausible: u64,
}

impl Stamps {
    /// When the picture was stamped and what that instant means; the arrival where the
    /// driver's stamp is not on our clock or cannot be true.
    pub(crate) fn read(
        &mut self,
        filled: &Filled,
        arrived_at: MonotonicTime,
    ) -> (MonotonicTime, StampSource) {
        self.source = match meaning(filled.flags) {
            StampSource::StartOfExposure if self.first_bytes => StampSource::FirstBytes,
            other => other,
        };
        if self.source == StampSource::Arrival {
            return (arrived_at, StampSource::Arrival);
        }
        let age = arrived_at.nanos_since(filled.stamp);
        let backwards = self.last.is_some_and(|last| filled.stamp <= last);
        if backwards || !(-FUTURE_NANOS..=OLDEST_NANOS).contains(&age) {
            self.implausible += 1;
            return (arrived_at, StampSource::Arrival);
        }
        self.last = Some(filled.stamp);
        (filled.stamp, self.source)
    }
}

fn meaning(flags: Flags) -> StampSource {
    if flags & Flags::TIMESTAMP_MASK != Flags::TIMESTAMP_MONOTONIC {
        // Copied from elsewhere (v4l2loopback, codecs), or of an unknown clock.
        return StampSource::Arrival;
    }
    if flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE {
        StampSource::StartOfExposure
    } else {
        StampSource::EndOfFrame
    }
}

/// The driver's 32-bit counter, carried on over its wrap and over the driver's restarts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sequence {
    last: Option<u32>,
    count: u64,
}

impl Sequence {
    /// The counter of a frame, and how many were lost before it.
    pub(crate) fn follow(&mut self, sequence: u32) -> (u64, u64) {
        let step = match self.last {
            None => u64::from(sequence),
            Some(last) => match sequence.wrapping_sub(last) {
                // A driver that does not count, or one that began anew.
                0 => 1,
                step if step > u32::MAX / 2 => 1,
                step => u64::from(step),
            },
        };
        let first = self.last.is_none();
        self.last = Some(sequence);
        self.count += step;
        // What came before the first frame of a stream was not lost on the way to us.
        (self.count, if first { 0 } else { step - 1 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::video::Held;

    fn at(millis: i64) -> MonotonicTime {
        MonotonicTime::from_nanos(millis * 1_000_000)
    }

    fn filled(flags: u32, millis: i64) -> Filled {
        Filled {
            held: Held::received(0),
            used: 1,
            flags: Flags::from(flags),
            sequence: 0,
            stamp: at(millis),
        }
    }

    #[test]
    fn flags_say_what_a_stamp_means() {
        let mut stamps = Stamps::default();
        let soe = stamps.read(&filled(0x1_2000, 100), at(120));
        assert_eq!(soe, (at(100), StampSource::StartOfExposure));
        let eof = stamps.read(&filled(0x2000, 110), at(121));
        assert_eq!(eof, (at(110), StampSource::EndOfFrame));
        for other in [0, 0x4000, 0x1_4000] {
            let copied = stamps.read(&filled(other, 115), at(122));
            assert_eq!(copied, (at(122), StampSource::Arrival));
        }
        assert_eq!(stamps.implausible, 0);
        stamps.first_bytes = true;
        let uvc = stamps.read(&filled(0x1_2000, 130), at(140));
        assert_eq!(uvc, (at(130), StampSource::FirstBytes));
    }

    #[test]
    fn a_stamp_that_cannot_be_true_gives_way_to_the_arrival() {
        let mut stamps = Stamps::default();
        for (stamp, arrived) in [
            (100, 110),
            (90, 120),
            (100, 130),
            (5_000, 140),
            (-9_000, 150),
        ] {
            let (at_, _) = stamps.read(&filled(0x2000, stamp), at(arrived));
            let expected = if stamp == 100 && arrived == 110 {
                100
            } else {
                arrived
            };
            assert_eq!(at_, at(expected), "{stamp}");
        }
        assert_eq!(stamps.implausible, 4);
        assert_eq!(stamps.read(&filled(0x2000, 155), at(160)).0, at(155));
    }

    #[test]
    fn gaps_wraps_and_restarts() {
        let mut sequence = Sequence::default();
        assert_eq!(sequence.follow(3), (3, 0));
        assert_eq!(sequence.follow(4), (4, 0));
        assert_eq!(sequence.follow(9), (9, 4));
        // The driver began anew.
        assert_eq!(sequence.follow(0), (10, 0));
        assert_eq!(sequence.follow(2), (12, 1));
        let mut wrapping = Sequence::default();
        wrapping.follow(u32::MAX - 1);
        assert_eq!(wrapping.follow(1), (u64::from(u32::MAX) + 2, 2));
        let mut constant = Sequence::default();
        for n in 0..5 {
            assert_eq!(constant.follow(0), (n, 0));
        }
    }
}
