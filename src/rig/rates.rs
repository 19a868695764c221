//! Measures the rates of composed pictures and of the devices, for the status.

use crate::feed::FeedCounts;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_status::{Histogram, RateMeter};
use std::collections::VecDeque;
use std::time::Duration;

/// Maximum number of readings kept for each device.
const MAX_READINGS: usize = 64;
/// Length of the window over which rates are computed, seconds.
const WINDOW_SECONDS: f64 = 2.0;
/// Minimum span of the readings of which a rate is computed, seconds; before that it is 0.
const MIN_SPAN_SECONDS: f64 = 0.25;

/// Deliveries of one device. They are read in batches, once per composed picture, so their rate is
/// computed from counts and not from single arrival times.
#[derive(Clone, Debug, Default)]
struct Deliveries {
    /// Time and total count of each reading, newest last.
    readings: VecDeque<(MonotonicTime, u64)>,
    received: u64,
    last: Option<MonotonicTime>,
}

impl Deliveries {
    /// Adds a reading of the total count `received` at `now`.
    fn add(&mut self, received: u64, now: MonotonicTime) {
        if received > self.received {
            self.last = Some(now);
        }
        self.received = received;
        if self.readings.len() == MAX_READINGS {
            self.readings.pop_front();
        }
        self.readings.push_back((now, received));
    }

    fn per_second(&self, now: MonotonicTime) -> f64 {
        let recent =
            |reading: &&(MonotonicTime, u64)| now.seconds_since(reading.0) <= WINDOW_SECONDS;
        let (first, newest) = (self.readings.iter().find(recent), self.readings.back());
        let (Some(first), Some(newest)) = (first, newest) else {
            return 0.0;
        };
        let span = newest.0.seconds_since(first.0);
        if span >= MIN_SPAN_SECONDS {
            (newest.1 - first.1) as f64 / span
        } else {
            0.0
        }
    }
}

/// Rate of one device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceRate {
    /// Deliveries since the start.
    pub received: u64,
    /// Deliveries per second over the last two seconds.
    pub per_second: f64,
    /// Time since the last delivery, milliseconds.
    pub last_age_ms: Option<f64>,
}

/// Rates of pictures and devices by the system clock, so a recording that is played slowly has low
/// rates.
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
    /// Records a composed picture. `counts` are the deliveries so far; `skew_nanos` is the age of
    /// its environment picture.
    pub fn record_composed(&mut self, counts: &FeedCounts, skew_nanos: Option<i64>) {
        self.composed.record(self.clock.now());
        self.record_idle(counts);
        if let Some(nanos) = skew_nanos {
            self.skew.record(Duration::from_nanos(nanos.unsigned_abs()));
        }
    }

    /// Records the deliveries so far while no picture is composed.
    pub fn record_idle(&mut self, counts: &FeedCounts) {
        // A picture is composed some time after its counting; the first one, long after.
        let now = counts.counted_at;
        let received = [counts.scene_frames, counts.environment_frames, counts.poses];
        for (device, received) in self.devices.iter_mut().zip(received) {
            device.add(received, now);
        }
    }

    /// Returns the composed pictures per second.
    #[must_use]
    pub fn pictures_per_second(&self) -> f64 {
        self.composed.rate(self.clock.now())
    }

    /// Returns the rates of scene camera, environment camera and tracker.
    #[must_use]
    pub fn devices(&self) -> [DeviceRate; 3] {
        let now = self.clock.now();
        self.devices.each_ref().map(|device| DeviceRate {
            received: device.received,
            per_second: device.per_second(now),
            last_age_ms: device.last.map(|last| now.seconds_since(last) * 1e3),
        })
    }

    /// Returns median and 99th percentile of the environment's skew, milliseconds.
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
    fn rate_is_computed_from_counts_in_the_window() {
        let mut device = Deliveries::default();
        for (received, seconds) in [(4, 0), (8, 1), (8, 2), (12, 3)] {
            let now = MonotonicTime::default() + Duration::from_secs(seconds);
            device.add(received, now);
        }
        assert_eq!(device.received, 12);
        let now = MonotonicTime::default() + Duration::from_secs(3);
        assert_eq!(device.last, Some(now));
        // Four deliveries in the last two seconds.
        assert!((device.per_second(now) - 2.0).abs() < 1e-9);
        assert!(device.per_second(now + Duration::from_secs(3)).abs() < 1e-9);
    }

    /// While the first picture is composed (shaders are compiled), deliveries queue up.
    #[test]
    fn rate_is_right_from_the_start() {
        let mut device = Deliveries::default();
        let start = MonotonicTime::default();
        let mut add = |seconds: f64| {
            let now = start + Duration::from_secs_f64(seconds);
            device.add((120.0 * seconds) as u64, now);
            device.per_second(now)
        };
        assert!(add(0.1).abs() < 1e-9);
        assert!(add(0.15).abs() < 1e-9);
        for seconds in [1.6, 1.63, 1.66, 1.7, 2.5] {
            assert!((add(seconds) - 120.0).abs() < 2.0);
        }
    }

    #[test]
    fn skew_is_available_after_the_first_pair() {
        let mut rates = Rates::default();
        assert_eq!(rates.skew_ms(), None);
        rates.record_composed(&FeedCounts::default(), Some(50_000_000));
        let [median, p99] = rates.skew_ms().unwrap_or_default();
        assert!((median - 50.0).abs() < 2.0 && (p99 - 50.0).abs() < 2.0);
    }
}
