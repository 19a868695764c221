//! Estimates how many readings of a tracker were lost, from their rate. Most protocols number
//! nothing, so a lost record shows only as a gap.
//!
//! ```text
//!   late(i) = (t_i − expected_i) / period        expected_i advances by one period per reading
//! ```
//! Jitter and transfer in batches delay readings for a while; a lost reading delays all that follow
//! by a whole period. So what counts is the smallest delay within a block of readings.

use penumbra_interface::MonotonicTime;
use std::collections::VecDeque;

/// Number of readings whose smallest delay counts.
const BLOCK: u32 = 16;
/// Distance of the readings whose interval measures the period. Batches are shorter.
const STRIDE: usize = 8;
/// Number of recent readings from which the period is computed.
const RECENT: usize = 64;
/// Silence of this length is no loss of single readings, nanoseconds.
const SILENCE_NANOS: i64 = 500_000_000;
/// Shares of the remaining delay of a block by which the expected time and the period follow.
const FOLLOW: (f64, f64) = (0.4, 0.1);
/// Relative difference from the median interval beyond which the rate has changed.
const RATE_CHANGE: f64 = 0.15;

/// Counts the lost readings of one station.
#[derive(Clone, Debug, Default)]
pub(super) struct LostReadings {
    recent: VecDeque<MonotonicTime>,
    /// Nanoseconds; `None` until it is known.
    period: Option<f64>,
    /// When the next reading is expected, if none is lost.
    expected: MonotonicTime,
    /// Smallest delay in this block, periods.
    smallest: f64,
    in_block: u32,
    lost: u64,
}

impl LostReadings {
    /// The estimated number of lost readings.
    pub const fn count(&self) -> u64 {
        self.lost
    }

    /// Adds the arrival of a reading.
    pub fn add(&mut self, at: MonotonicTime) {
        let newest = self.recent.back().copied();
        if newest.is_some_and(|newest| {
            let passed = at.nanos_since(newest);
            !(0..=SILENCE_NANOS).contains(&passed)
        }) {
            self.restart();
        }
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(at);
        let Some(period) = self.period else {
            if self.recent.len() == RECENT {
                self.measure(at);
            }
            return;
        };
        let late = at.nanos_since(self.expected) as f64 / period;
        self.smallest = if self.in_block == 0 {
            late
        } else {
            self.smallest.min(late)
        };
        self.in_block += 1;
        let mut advance = 1.0;
        if self.in_block == BLOCK {
            self.in_block = 0;
            let median = self.median_period().unwrap_or(period);
            if (median / period - 1.0).abs() > RATE_CHANGE {
                self.restart();
                return;
            }
            let lost = self.smallest.round().max(0.0);
            let rest = self.smallest - lost;
            self.lost += lost as u64;
            advance += lost + rest * FOLLOW.0;
            self.period = Some(period * (1.0 + rest * FOLLOW.1 / f64::from(BLOCK)));
        }
        self.expected = self.expected.offset_nanos((advance * period) as i64);
    }

    /// Forgets the rate, but not the losses: the stream has been interrupted.
    fn restart(&mut self) {
        let lost = self.lost;
        *self = Self {
            lost,
            ..Self::default()
        };
    }

    fn measure(&mut self, now: MonotonicTime) {
        self.period = self.median_period();
        let period = self.period.unwrap_or_default();
        self.expected = now.offset_nanos(period as i64);
    }

    /// The median interval between readings; `None` if there are too few, or if all came at once.
    fn median_period(&self) -> Option<f64> {
        let later = self.recent.iter().skip(STRIDE);
        let pairs = self.recent.iter().zip(later);
        let mut spans: Vec<i64> = pairs.map(|(a, b)| b.nanos_since(*a)).collect();
        spans.sort_unstable();
        let median = spans.get(spans.len() / 2).copied()?;
        (median > 0).then(|| median as f64 / STRIDE as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Arrivals of a tracker of 120 Hz, of which `is_lost` do not arrive.
    fn counted(
        arrival: impl Fn(i64, f64) -> f64,
        is_lost: impl Fn(i64) -> bool,
        readings: i64,
    ) -> u64 {
        let mut lost = LostReadings::default();
        let mut newest = f64::MIN;
        for i in (0..readings).filter(|i| !is_lost(*i)) {
            // The order of a serial line or a socket is kept.
            newest = arrival(i, i as f64 / 120.0).max(newest);
            lost.add(MonotonicTime::from_nanos((newest * 1e9) as i64));
        }
        lost.count()
    }

    /// Up to 6 ms, without a pattern.
    fn jitter(i: i64) -> f64 {
        6e-3 * ((i * i * 7919 + i * 104_729) % 1000) as f64 * 1e-3
    }

    #[test]
    fn nothing_is_lost_in_a_complete_stream() {
        assert_eq!(counted(|_, t| t, |_| false, 10_000), 0);
        assert_eq!(counted(|i, t| t + jitter(i), |_| false, 10_000), 0);
        // Two and four records a transfer, as USB adapters have them.
        for batch in [2, 4] {
            let at = |i: i64, _: f64| (i / batch * batch + batch) as f64 / 120.0;
            assert_eq!(counted(at, |_| false, 10_000), 0);
        }
        // A clock that is 0.1 % off.
        assert_eq!(counted(|_, t| t * 1.001, |_| false, 100_000), 0);
    }

    #[test]
    fn lost_readings_are_counted() {
        let within = |count: u64, expected: u64| {
            assert!(
                count.abs_diff(expected) * 10 <= expected,
                "{count} of {expected}"
            );
        };
        within(counted(|_, t| t, |i| i > 100 && i % 100 == 0, 10_000), 98);
        within(
            counted(|i, t| t + jitter(i), |i| i > 100 && i % 50 == 0, 10_000),
            197,
        );
        // Ten in a row.
        let rows = |i: i64| i > 100 && i % 500 < 10;
        within(counted(|_, t| t, rows, 10_000), 190);
    }

    #[test]
    fn change_of_rate_is_no_loss() {
        let at = |i: i64, t: f64| {
            if i < 1000 {
                t
            } else {
                2.0 * t - 1000.0 / 120.0
            }
        };
        let count = counted(at, |_| false, 4000);
        assert!(count <= 2 * u64::from(BLOCK), "{count}");
    }

    #[test]
    fn silence_is_no_loss_of_readings() {
        let at = |i: i64, t: f64| if i < 1000 { t } else { t + 60.0 };
        assert_eq!(counted(at, |_| false, 2000), 0);
    }
}
