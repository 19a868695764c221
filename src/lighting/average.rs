//! Averages the light over time while it does not change.
//!
//! A single estimate is noisy: a lamp is a few hundred pixels of the shortest exposure, where they
//! are dark, so its flux varies by some tenths of a percent from picture to picture, and with it
//! all virtual objects. The average follows every change that exceeds this noise at once:
//!
//! ```text
//!   average ← average + α (estimate − average)
//!   α = max(1/n, 1 − exp(−Δt/τ), s)     n estimates since the last change; s from 0 to 1 as the
//!                                       estimate departs from the average by 2.5 to 5 σ
//! ```
//!
//! The departure is that of the irradiance on surfaces facing six sides. σ, its noise, is
//! estimated from the estimates' second differences, which a steady movement leaves at zero; its
//! limit bounds by how much the average can lag behind a slow change.

use super::blend::{Shares, blend_into, can_blend, lights::is_in_place, side_irradiance};
use super::light::Lighting;
use penumbra_numerics::{median, smoothstep};
use std::sync::Arc;

/// Time constant, seconds.
const TIME_CONSTANT_SECONDS: f64 = 1.0;
/// Departure, as a multiple of σ, up to which it counts as noise, and from which as a change.
const NOISE_TO_CHANGE: (f32, f32) = (2.5, 5.0);
/// Limits of σ, relative to the irradiance.
const SIGMA: (f32, f32) = (0.0005, 0.004);
/// Number of recent estimates from whose second differences σ is estimated.
const RECENT: usize = 49;

/// Irradiance on surfaces that face six sides.
type Sides = [f32; 6];

/// The running average.
#[derive(Debug, Default)]
pub struct LightAverage {
    average: Option<Arc<Lighting>>,
    /// The last two estimates.
    last: [Option<Sides>; 2],
    /// Relative second differences of recent estimates.
    differences: Vec<f32>,
    count: usize,
    /// Effective number of averaged estimates.
    averaged: f32,
}

impl LightAverage {
    /// Returns the average after `estimate`: with its instant, generation, directions and
    /// extents. A light of another structure, or whose lights have changed places, starts a new
    /// average.
    pub fn add(&mut self, estimate: Arc<Lighting>) -> Arc<Lighting> {
        let sides = side_irradiance(&estimate);
        self.observe(sides);
        let alpha = self.weight(&estimate, &sides);
        self.averaged = 1.0 / alpha;
        let result = match &self.average {
            Some(average) if alpha < 1.0 => {
                let mut out = Lighting::clone(&estimate);
                let shares = Shares {
                    energy: alpha,
                    place: Some(1.0),
                };
                blend_into(average, &estimate, shares, &mut out);
                out.captured_at = estimate.captured_at;
                Arc::new(out)
            }
            _ => estimate,
        };
        self.average = Some(Arc::clone(&result));
        result
    }

    /// Returns the weight of an estimate in the average.
    fn weight(&self, estimate: &Lighting, sides: &Sides) -> f32 {
        let Some(average) = self
            .average
            .as_ref()
            .filter(|a| can_blend(a, estimate) && is_in_place(&a.lights, &estimate.lights))
        else {
            return 1.0;
        };
        let seconds = estimate.captured_at.seconds_since(average.captured_at);
        if !(seconds > 0.0 && seconds < TIME_CONSTANT_SECONDS) {
            return 1.0;
        }
        let departure = relative(sides, &side_irradiance(average)) / self.sigma();
        let change = smoothstep(NOISE_TO_CHANGE.0, NOISE_TO_CHANGE.1, departure);
        let by_time = 1.0 - (-seconds / TIME_CONSTANT_SECONDS).exp() as f32;
        by_time.max(1.0 / (self.averaged + 1.0)).max(change)
    }

    /// Records the second difference of the last three estimates.
    fn observe(&mut self, sides: Sides) {
        if let [Some(before), Some(last)] = self.last {
            let middle = std::array::from_fn(|k| 0.5 * (before[k] + sides[k]));
            // Of noise σ, half the second difference has √(3/2) σ.
            let difference = relative(&middle, &last) / 1.5_f32.sqrt();
            self.differences.resize(RECENT, f32::MAX);
            self.differences[self.count % RECENT] = difference;
            self.count += 1;
        }
        self.last = [self.last[1], Some(sides)];
    }

    /// Standard deviation of an estimate, by the median absolute second difference.
    fn sigma(&self) -> f32 {
        let known = &self.differences[..self.count.min(self.differences.len())];
        let typical = median(known.iter().map(|d| f64::from(*d)));
        typical.map_or(SIGMA.0, |typical| {
            (1.4826 * typical as f32).clamp(SIGMA.0, SIGMA.1)
        })
    }
}

/// Largest difference of two irradiances, relative to the largest irradiance.
fn relative(a: &Sides, b: &Sides) -> f32 {
    let most = b.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let pairs = a.iter().zip(b);
    pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / most
}

#[cfg(test)]
mod tests;
