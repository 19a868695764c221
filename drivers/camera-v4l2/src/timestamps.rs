//! Interprets the driver's time stamps and frame counter.

use crate::device::FilledBuffer;
use penumbra_interface::{MonotonicTime, StampSource};
use v4l::buffer::Flags;

/// Maximum age of an arriving frame. An older time stamp is of another clock.
const MAX_AGE_NANOS: i64 = 5_000_000_000;
/// Maximum time by which a stamp may be in the future, because another processor core took it.
const MAX_FUTURE_NANOS: i64 = 1_000_000;

/// Interprets the time stamps of one stream.
#[derive(Clone, Debug, Default)]
pub(crate) struct Timestamps {
    last: Option<MonotonicTime>,
    /// What the driver flags as the start of the exposure is the arrival of the frame's first
    /// bytes: `uvcvideo` reads the host's clock when the first payload arrives.
    pub start_is_first_bytes: bool,
    /// What the latest time stamp means.
    pub source: StampSource,
    /// Number of implausible time stamps: not later than the previous one, in the future, too old.
    pub implausible: u64,
}

impl Timestamps {
    /// The time stamp of a frame and its meaning. Where the driver's is not on the monotonic
    /// clock or is implausible, it is the frame's arrival.
    pub(crate) fn interpret(
        &mut self,
        frame: &FilledBuffer,
        arrived_at: MonotonicTime,
    ) -> (MonotonicTime, StampSource) {
        self.source = match source(frame.flags) {
            StampSource::StartOfExposure if self.start_is_first_bytes => StampSource::FirstBytes,
            other => other,
        };
        if self.source == StampSource::Arrival {
            return (arrived_at, StampSource::Arrival);
        }
        let age = arrived_at.nanos_since(frame.timestamp);
        let is_backwards = self.last.is_some_and(|last| frame.timestamp <= last);
        if is_backwards || !(-MAX_FUTURE_NANOS..=MAX_AGE_NANOS).contains(&age) {
            self.implausible += 1;
            return (arrived_at, StampSource::Arrival);
        }
        self.last = Some(frame.timestamp);
        (frame.timestamp, self.source)
    }
}

fn source(flags: Flags) -> StampSource {
    if flags & Flags::TIMESTAMP_MASK != Flags::TIMESTAMP_MONOTONIC {
        // Copied from another device (v4l2loopback, codecs), or of an unknown clock.
        return StampSource::Arrival;
    }
    if flags & Flags::TSTAMP_SRC_MASK == Flags::TSTAMP_SRC_SOE {
        StampSource::StartOfExposure
    } else {
        StampSource::EndOfFrame
    }
}

/// The driver's 32-bit frame counter as a 64-bit one that survives wrapping and restarts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameCounter {
    last: Option<u32>,
    count: u64,
}

impl FrameCounter {
    /// The count of a frame, and how many frames were lost before it.
    pub(crate) fn advance(&mut self, sequence: u32) -> (u64, u64) {
        let Some(last) = self.last.replace(sequence) else {
            // Frames before the first one of a stream were not lost on the way to us.
            self.count = sequence.into();
            return (self.count, 0);
        };
        let step = match sequence.wrapping_sub(last) {
            // The driver does not count, or it has restarted.
            0 => 1,
            step if step > u32::MAX / 2 => 1,
            step => u64::from(step),
        };
        self.count += step;
        (self.count, step - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::OwnedBuffer;

    fn at(millis: i64) -> MonotonicTime {
        MonotonicTime::from_nanos(millis * 1_000_000)
    }

    fn frame(flags: Flags, millis: i64) -> FilledBuffer {
        FilledBuffer {
            buffer: OwnedBuffer::from_kernel(0),
            bytes_used: 1,
            flags,
            sequence: 0,
            timestamp: at(millis),
        }
    }

    #[test]
    fn flags_define_the_meaning_of_a_time_stamp() {
        let mut timestamps = Timestamps::default();
        let start_of_exposure = Flags::TIMESTAMP_MONOTONIC | Flags::TSTAMP_SRC_SOE;
        assert_eq!(start_of_exposure.bits(), 0x1_2000); // videodev2.h
        let start = timestamps.interpret(&frame(start_of_exposure, 100), at(120));
        assert_eq!(start, (at(100), StampSource::StartOfExposure));
        let end = timestamps.interpret(&frame(Flags::TIMESTAMP_MONOTONIC, 110), at(121));
        assert_eq!(end, (at(110), StampSource::EndOfFrame));
        let copied = Flags::TIMESTAMP_COPY;
        for other in [Flags::empty(), copied, copied | Flags::TSTAMP_SRC_SOE] {
            let found = timestamps.interpret(&frame(other, 115), at(122));
            assert_eq!(found, (at(122), StampSource::Arrival));
        }
        assert_eq!(timestamps.implausible, 0);
        timestamps.start_is_first_bytes = true;
        let uvc = timestamps.interpret(&frame(start_of_exposure, 130), at(140));
        assert_eq!(uvc, (at(130), StampSource::FirstBytes));
    }

    #[test]
    fn implausible_time_stamp_is_replaced_by_the_arrival() {
        let mut timestamps = Timestamps::default();
        let mut read = |stamp, arrived| {
            let frame = frame(Flags::TIMESTAMP_MONOTONIC, stamp);
            (
                timestamps.interpret(&frame, at(arrived)).0,
                timestamps.implausible,
            )
        };
        assert_eq!(read(100, 110), (at(100), 0));
        for (n, (stamp, arrived)) in [(90, 120), (100, 130), (5_000, 140), (-9_000, 150)]
            .into_iter()
            .enumerate()
        {
            assert_eq!(read(stamp, arrived), (at(arrived), n as u64 + 1), "{stamp}");
        }
        assert_eq!(read(155, 160), (at(155), 4));
    }

    #[test]
    fn the_frame_counter_survives_gaps_wrapping_and_restarts() {
        let mut counter = FrameCounter::default();
        assert_eq!(counter.advance(3), (3, 0));
        assert_eq!(counter.advance(4), (4, 0));
        assert_eq!(counter.advance(9), (9, 4));
        // The driver has restarted.
        assert_eq!(counter.advance(0), (10, 0));
        assert_eq!(counter.advance(2), (12, 1));
        let mut wrapping = FrameCounter::default();
        wrapping.advance(u32::MAX - 1);
        assert_eq!(wrapping.advance(1), (u64::from(u32::MAX) + 2, 2));
        let mut constant = FrameCounter::default();
        for n in 0..5 {
            assert_eq!(constant.advance(0), (n, 0));
        }
    }
}
