//! Durations of stages, without allocation per frame.

use penumbra_interface::MonotonicTime;
use serde::ser::{Serialize, SerializeStruct, Serializer};
use std::time::Duration;

/// Buckets per doubling: a percentile is accurate to within 2^(1/32) − 1 ≈ 2.2 %.
const PER_OCTAVE: usize = 16;
/// From 1 µs to 2^26 µs ≈ 67 s; values outside count in the first or last.
const OCTAVES: usize = 26;
const BUCKETS: usize = PER_OCTAVE * OCTAVES;
/// Weight of the newest value in [`Histogram::recent`]: about the last 16 values.
const RECENT_WEIGHT: f64 = 1.0 / 16.0;

/// Durations counted in fixed logarithmic buckets. Recording neither allocates nor
/// slows down with the number of values.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    buckets: Box<[u64; BUCKETS]>,
    count: u64,
    sum_seconds: f64,
    recent_seconds: f64,
    max: Duration,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            buckets: Box::new([0; BUCKETS]),
            count: 0,
            sum_seconds: 0.0,
            recent_seconds: 0.0,
            max: Duration::ZERO,
        }
    }
}

impl Histogram {
    /// Counts one duration.
    pub fn record(&mut self, duration: Duration) {
        let seconds = duration.as_secs_f64();
        self.buckets[bucket_of(seconds * 1e6)] += 1;
        let weight = if self.count == 0 { 1.0 } else { RECENT_WEIGHT };
        self.recent_seconds += weight * (seconds - self.recent_seconds);
        self.count += 1;
        self.sum_seconds += seconds;
        self.max = self.max.max(duration);
    }

    /// Returns the number of recorded durations.
    #[must_use]
    pub const fn count(&self) -> u64 {
        self.count
    }

    /// Returns their sum, seconds.
    #[must_use]
    pub const fn sum_seconds(&self) -> f64 {
        self.sum_seconds
    }

    /// Returns the maximum.
    #[must_use]
    pub const fn max(&self) -> Duration {
        self.max
    }

    /// Returns the exponentially weighted mean of about the last 16.
    #[must_use]
    pub fn recent(&self) -> Duration {
        Duration::from_secs_f64(self.recent_seconds.max(0.0))
    }

    /// Returns the duration that the share `quantile` (0..=1) of the values does not exceed, to
    /// within a bucket (2.2 %), by the nearest-rank rule; zero if nothing was recorded.
    #[must_use]
    pub fn quantile(&self, quantile: f64) -> Duration {
        let rank = ((quantile.clamp(0.0, 1.0) * self.count as f64).ceil() as u64).max(1);
        let mut seen = 0;
        for (i, n) in self.buckets.iter().enumerate() {
            seen += n;
            if seen >= rank {
                return middle_of(i).min(self.max);
            }
        }
        Duration::ZERO
    }

    /// Returns the durations recorded since the state `earlier`; the maximum is that of all.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        let mut since = self.clone();
        for (now, before) in since.buckets.iter_mut().zip(earlier.buckets.iter()) {
            *now = now.saturating_sub(*before);
        }
        since.count = since.buckets.iter().sum();
        since.sum_seconds -= earlier.sum_seconds;
        since
    }

    /// Returns the number of values up to `seconds`, to within a bucket, for a Prometheus histogram.
    #[must_use]
    pub fn count_up_to(&self, seconds: f64) -> u64 {
        let octave_buckets = (seconds * 1e6).log2() * PER_OCTAVE as f64;
        let buckets = (octave_buckets.round().max(0.0) as usize).min(BUCKETS);
        if buckets == BUCKETS {
            return self.count;
        }
        self.buckets.iter().take(buckets).sum()
    }
}

/// Bucket `i` holds 2^(i/16) ..= 2^((i+1)/16) microseconds.
fn bucket_of(micros: f64) -> usize {
    let octaves = micros.max(1.0).log2();
    ((octaves * PER_OCTAVE as f64) as usize).min(BUCKETS - 1)
}

/// Geometric middle of a bucket.
fn middle_of(bucket: usize) -> Duration {
    let micros = ((bucket as f64 + 0.5) / PER_OCTAVE as f64).exp2();
    Duration::from_secs_f64(micros * 1e-6)
}

/// The processor of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StageKind {
    /// Wall time on a CPU thread.
    Cpu,
    /// GPU time of one pass, from time stamps.
    Gpu,
}

impl StageKind {
    /// Returns the name in `/status` and in metric labels.
    #[must_use]
    pub const fn label(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::Gpu => "gpu",
        }
    }
}

/// The durations of one stage of the frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Stage {
    /// `decode`, `environment`, `upload`, `composite`, `encode`, `total`, or a pass's name.
    pub name: &'static str,
    /// CPU or GPU.
    pub kind: StageKind,
    /// Since the start.
    pub times: Histogram,
}

impl Serialize for Stage {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut stage = serializer.serialize_struct("Stage", 7)?;
        stage.serialize_field("name", self.name)?;
        stage.serialize_field("kind", &self.kind)?;
        stage.serialize_field("count", &self.times.count())?;
        stage.serialize_field("recent_ms", &millis(self.times.recent()))?;
        stage.serialize_field("p50_ms", &millis(self.times.quantile(0.5)))?;
        stage.serialize_field("p99_ms", &millis(self.times.quantile(0.99)))?;
        stage.serialize_field("max_ms", &millis(self.times.max()))?;
        stage.end()
    }
}

/// Milliseconds, rounded to the microsecond.
fn millis(duration: Duration) -> f64 {
    (duration.as_secs_f64() * 1e6).round() / 1e3
}

/// The stages of the frame in the order of their first measurement. Allocates only for a new name.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StageTimes {
    stages: Vec<Stage>,
}

impl StageTimes {
    /// Counts a CPU stage's wall time.
    pub fn record(&mut self, name: &'static str, duration: Duration) {
        self.stage(name, StageKind::Cpu).record(duration);
    }

    /// Counts a GPU pass's time.
    pub fn record_gpu(&mut self, pass: &'static str, duration: Duration) {
        self.stage(pass, StageKind::Gpu).record(duration);
    }

    /// All stages.
    #[must_use]
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// The stage of that name and kind, if it was recorded.
    #[must_use]
    pub fn get(&self, name: &str, kind: StageKind) -> Option<&Histogram> {
        let found = |s: &&Stage| s.kind == kind && s.name == name;
        self.stages.iter().find(found).map(|s| &s.times)
    }

    fn stage(&mut self, name: &'static str, kind: StageKind) -> &mut Histogram {
        let found = |s: &Stage| s.kind == kind && s.name == name;
        let index = self.stages.iter().position(found).unwrap_or_else(|| {
            let times = Histogram::default();
            self.stages.push(Stage { name, kind, times });
            self.stages.len() - 1
        });
        &mut self.stages[index].times
    }
}

impl Serialize for StageTimes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(&self.stages)
    }
}

/// Events per second over the last few dozen events, at most two seconds of them.
#[derive(Clone, Debug)]
pub struct RateMeter {
    instants: [MonotonicTime; Self::KEPT],
    next: usize,
    len: usize,
}

impl Default for RateMeter {
    fn default() -> Self {
        Self {
            instants: [MonotonicTime::default(); Self::KEPT],
            next: 0,
            len: 0,
        }
    }
}

impl RateMeter {
    const KEPT: usize = 64;
    const WINDOW_SECONDS: f64 = 2.0;

    /// Counts one event. If time jumps back, earlier events are forgotten.
    pub fn record(&mut self, now: MonotonicTime) {
        if self.len > 0 && now < self.newest() {
            self.len = 0;
        }
        self.instants[self.next] = now;
        self.next = (self.next + 1) % Self::KEPT;
        self.len = (self.len + 1).min(Self::KEPT);
    }

    /// Events per second up to `now`; zero when the last is more than two seconds old or
    /// fewer than two are known.
    #[must_use]
    pub fn rate(&self, now: MonotonicTime) -> f64 {
        let in_window =
            |back: &usize| now.seconds_since(self.nth_newest(*back)) <= Self::WINDOW_SECONDS;
        let Some(last) = (0..self.len).take_while(in_window).last() else {
            return 0.0;
        };
        let span = self.newest().seconds_since(self.nth_newest(last));
        if span > 0.0 { last as f64 / span } else { 0.0 }
    }

    fn newest(&self) -> MonotonicTime {
        self.nth_newest(0)
    }

    fn nth_newest(&self, back: usize) -> MonotonicTime {
        self.instants[(self.next + 2 * Self::KEPT - 1 - back) % Self::KEPT]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn histogram(micros: &[u64]) -> Histogram {
        let mut h = Histogram::default();
        micros
            .iter()
            .for_each(|&m| h.record(Duration::from_micros(m)));
        h
    }

    proptest! {
        #[test]
        fn quantiles_have_the_nearest_rank_within_a_bucket(
            mut micros in proptest::collection::vec(1_u64..60_000_000, 1..200),
            quantile in 0.0_f64..=1.0,
        ) {
            let h = histogram(&micros);
            micros.sort_unstable();
            let rank = ((quantile * micros.len() as f64).ceil() as usize).max(1);
            let exact = micros[rank - 1] as f64;
            let found = h.quantile(quantile).as_secs_f64() * 1e6;
            prop_assert!((found / exact - 1.0).abs() < 0.023, "{found} for {exact}");
        }

        #[test]
        fn any_duration_is_counted_once(nanos in any::<u64>()) {
            let mut h = Histogram::default();
            h.record(Duration::from_nanos(nanos));
            prop_assert_eq!(h.buckets.iter().sum::<u64>(), 1);
        }
    }

    #[test]
    fn since_returns_only_later_records() {
        let earlier = histogram(&[50_000, 60_000, 70_000]);
        let mut later = earlier.clone();
        later.record(Duration::from_micros(1_000));
        let since = later.since(&earlier);
        assert_eq!(since.count(), 1);
        assert!((since.sum_seconds() - 0.001).abs() < 1e-9);
        let median = since.quantile(0.5).as_secs_f64();
        assert!((median / 0.001 - 1.0).abs() < 0.023, "{median}");
    }

    #[test]
    fn empty_histogram_gives_zero() {
        let h = Histogram::default();
        assert_eq!(h.quantile(0.99), Duration::ZERO);
        assert_eq!(h.recent(), Duration::ZERO);
    }

    #[test]
    fn counts_cumulatively_up_to_a_bound() {
        let h = histogram(&[900, 1_100, 4_000, 90_000_000]);
        assert_eq!(h.count_up_to(0.001), 1);
        assert_eq!(h.count_up_to(0.002), 2);
        assert_eq!(h.count_up_to(0.005), 3);
        assert_eq!(h.count_up_to(1e9), 4);
    }

    #[test]
    fn stages_keep_their_first_order_and_separate_cpu_from_gpu() {
        let mut times = StageTimes::default();
        times.record("decode", Duration::from_millis(2));
        times.record_gpu("composite", Duration::from_millis(1));
        times.record("composite", Duration::from_millis(3));
        times.record("decode", Duration::from_millis(2));
        let seen: Vec<_> = times
            .stages()
            .iter()
            .map(|s| (s.name, s.kind, s.times.count()))
            .collect();
        let (cpu, gpu) = (StageKind::Cpu, StageKind::Gpu);
        assert_eq!(
            seen,
            [
                ("decode", cpu, 2),
                ("composite", gpu, 1),
                ("composite", cpu, 1)
            ]
        );
    }

    #[test]
    fn measures_a_steady_rate_that_falls_to_zero() {
        let mut meter = RateMeter::default();
        let at = |i: i64| MonotonicTime::from_nanos(i * 40_000_000);
        (0..200).for_each(|i| meter.record(at(i)));
        assert!((meter.rate(at(199)) - 25.0).abs() < 1e-9);
        assert_eq!(meter.rate(at(199 + 100)), 0.0);
        meter.record(at(0));
        assert_eq!(meter.rate(at(0)), 0.0, "time jumped back");
    }
}
