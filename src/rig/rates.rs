//! How fast pictures are made and devices deliver, for the status.

use crate::feed::FeedCounts;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_status::{Histogram, RateMeter};
use std::collections::VecDeque;
use std::time::Duration;

/// Moments kept of each device.
const KEPT: usize = 64;
/// Rates are over so many seconds.
const WINDOW_SECONDS: f64 = 2.0;

/// One device's deliveries. They come in handfuls, one for each picture composed, so that
/// their rate is told from counts and not from moments.
#[derive(Clone, Debug, Default)]
struct Deliveries {
    /// When how many had been received, newest last.
    known: VecDeque<(MonotonicTime, u64)>,
    received: u64,
    last: Option<MonotonicTime>,
}

impl Deliveries {
    /// `received` in all, by `now`.
    fn take(&mut self, received: u64, now: MonotonicTime) {
        if received > self.received {
            self.last = Some(now);
        }
        self.received = received;
        if self.known.len() == KEPT {
            self.known.pop_front();
        }
        self.known.push_back((now, received));
    }

    fn per_second(&self, now: MonotonicTime) -> f64 {
        let recent = |known: &&(MonotonicTime, u64)| now.seconds_since(known.0) <= WINDOW_SECONDS;
        let (first, newest) = (self.known.iter().find(recent), self.known.back());
        let (Some(first), Some(newest)) = (first, newest) else {
            return 0.0;
        };
        let span = newest.0.seconds_since(first.0);
        if span > 0.0 {
            (newest.1 - first.1) as f64 / span
        } else {
            0.0
        }
    }
}

/// What [`Rates`] says of one device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceRate {
    /// Deliveries since the start.
    pub received: u64,
    /// Deliveries per second of the last two.
    pub per_second: f64,
    /// Milliseconds since the last.
    pub last_age_ms: Option<f64>,
}

/// Rates of pictures and devices by the machine's clock: a recording that is played slowly
/// delivers slowly.
#[derive(Debug)]
pub struct Rates {
    clock: SystemClock,
    composed: RateMeter,
    /// Scene camera, environment camera, tracker.
    devices: [Deliveries; 3],
    skew: Histogram,
}

impl Default for Rates {
    fn default() -> Self {
        Self {
            clock: SystemClock,
            composed: RateMeter::default(),
            devices: Default::default(),
            skew: Histogram::default(),
        }
    }
}

impl Rates {
    /// A picture was composed; `counts` came in so far, and its environment is
    /// `skew_nanos` behind.
    pub fn composed(&mut self, counts: &FeedCounts, skew_nanos: Option<i64>) {
        self.composed.record(self.clock.now());
        self.idle(counts);
        if let Some(nanos) = skew_nanos {
            self.skew.record(Duration::from_nanos(nanos.unsigned_abs()));
        }
    }

    /// No picture was composed for a while; `counts` came in so far.
    pub fn idle(&mut self, counts: &FeedCounts) {
        let now = self.clock.now();
        let received = [counts.scene_frames, counts.environment_frames, counts.poses];
        for (device, received) in self.devices.iter_mut().zip(received) {
            device.take(received, now);
        }
    }

    /// Pictures per second.
    #[must_use]
    pub fn pictures_per_second(&self) -> f64 {
        self.composed.rate(self.clock.now())
    }

    /// Scene camera, environment camera, tracker.
    #[must_use]
    pub fn devices(&self) -> [DeviceRate; 3] {
        let now = self.clock.now();
        self.devices.each_ref().map(|device| DeviceRate {
            received: device.received,
            per_second: device.per_second(now),
            last_age_ms: device.last.map(|last| now.seconds_since(last) * 1e3),
        })
    }

    /// Median and 99th percentile of the environment's skew, milliseconds.
    #[must_use]
    pub fn skew_ms(&self) -> Option<[f64; 2]> {
        let at = |quantile| self.skew.quantile(quantile).as_secs_f64() * 1e3;
        (self.skew.count() > 0).then(|| [at(0.5), at(0.99)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deliveries_are_counted_once_and_by_their_number() {
        let mut device = Deliveries::default();
        for (received, seconds) in [(4, 0), (8, 1), (8, 2), (12, 3)] {
            let now = MonotonicTime::default() + Duration::from_secs(seconds);
            device.take(received, now);
        }
        assert_eq!(device.received, 12);
        let now = MonotonicTime::default() + Duration::from_secs(3);
        assert_eq!(device.last, Some(now));
        // Four of them in the last two seconds.
        assert!((device.per_second(now) - 2.0).abs() < 1e-9);
        assert!(device.per_second(now + Duration::from_secs(3)).abs() < 1e-9);
    }

    #[test]
    fn skew_is_known_from_the_first_pair_on() {
        let mut rates = Rates::default();
        assert_eq!(rates.skew_ms(), None);
        rates.composed(&FeedCounts::default(), Some(50_000_000));
        let [median, most] = rates.skew_ms().unwrap_or_default();
        assert!((median - 50.0).abs() < 2.0 && (most - 50.0).abs() < 2.0);
    }
}
