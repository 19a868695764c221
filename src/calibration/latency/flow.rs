//! The offset by how pictures move that have no poses.
//!
//! Each number of a picture's flow (its shift to the right and down, its growth, its turn) is a
//! sum of the tracker's own turn and way between the same two instants, each times a factor that
//! mounting, lens and the scene's distance tell; that distance changes with the place. The factors are
//! fitted at each offset, so none of these need be known; where the scene is not as far everywhere, or
//! the camera circles it, the flow's turn still tells the offset, and each number counts by how well
//! it follows.

use super::scan::{Fit, scan};
use super::{
    CameraMotion, ClockOffset, LatencyError, SPAN, TrackerTrack, covered, independent, settle,
    shortest, within,
};
use glam::DVec3;
use penumbra_numerics::{Matrix, median_absolute};

/// Numbers of a flow.
const NUMBERS: usize = 4;
/// Factors of each for a turn about three axes,
const TURNS: usize = 3;
/// and with them for a way along three axes, and for as many more as the scene's nearness changes with
/// the place along three axes.
const FACTORS: usize = TURNS + 3 + 9;
/// Fewest spans that tell something of their own: fewer are fitted by chance.
const FEWEST: f64 = 30.0;
/// Flows are compared over so many seconds.
const TOGETHER: f64 = 0.13;
/// Motions whose rest is so many times the usual are passed over: a picture that jumped.
const OUTLYING: f64 = 6.0;
/// If even the worst offset leaves no more than this share, the factors make up for any offset: to and
/// fro at one pace is as good as to and fro some time later, with other factors.
const ANY: f64 = 0.03;
/// What is added to the factors' normal equations, as a share: motion about one axis leaves the others
/// open.
const RIDGE: f64 = 1e-9;

/// From flows: the tracker's turn and way times factors are fitted at each offset.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn from_motion(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    range: f64,
) -> Result<ClockOffset, LatencyError> {
    let spans: Vec<(f64, f64)> = motions.iter().map(|m| (m.from, m.to)).collect();
    let kept = within(track, &spans, range)?;
    let length = kept.iter().map(|&i| spans[i].1 - spans[i].0).sum::<f64>() / kept.len() as f64;
    let alone = independent(&spans, &kept);
    if alone < FEWEST {
        return Err(LatencyError::TooShort {
            samples: kept.len(),
            least: (FEWEST * SPAN / length).ceil() as usize,
        });
    }
    // First all numbers as they vary, then by what is left of them, without what jumped.
    let all = Compared::new(track, motions, &kept, length);
    let spread = all.spread();
    let rough = scan(|offset| all.fit(offset, &spread), range, NUMBERS);
    let rough = rough.ok_or(LatencyError::NotAlike { percent: 0.0 })?;
    let (noise, jumped) = all
        .noise(rough.offset)
        .ok_or(LatencyError::NotAlike { percent: 0.0 })?;
    let steady = kept.into_iter().zip(jumped);
    let steady = steady.filter(|(_, jumped)| !jumped).map(|(i, _)| i);
    let kept = covered(track, &spans, steady.collect(), rough.offset)?;
    let steady = Compared::new(track, motions, &kept, length);
    let found = scan(|offset| steady.fit(offset, &noise), range, NUMBERS);
    if found.as_ref().is_some_and(|f| f.worst < ANY) {
        return Err(LatencyError::AnyOffset);
    }
    let fitted = (FACTORS + 1) as f64;
    settle(found, range, alone * SPAN / TOGETHER, (fitted, kept.len()))
}

/// Flows beside the tracker's motion, summed over the same few pictures, which moves neither in time.
struct Compared<'a> {
    track: &'a TrackerTrack,
    spans: Vec<(f64, f64)>,
    flows: Vec<[f64; NUMBERS]>,
    together: usize,
    /// Mean of the tracker's places.
    middle: DVec3,
    factors: usize,
    /// Share of the squares that a fit by chance leaves.
    by_chance: f64,
}

impl<'a> Compared<'a> {
    fn new(track: &'a TrackerTrack, motions: &[CameraMotion], kept: &[usize], length: f64) -> Self {
        let seen = kept.iter().map(|&i| &motions[i]);
        let spans: Vec<(f64, f64)> = seen.clone().map(|m| (m.from, m.to)).collect();
        let numbers =
            |m: &CameraMotion| [m.flow.shift.x, m.flow.shift.y, m.flow.growth, m.flow.turn];
        let together = ((TOGETHER / length) as usize).clamp(1, kept.len().max(4) / 4);
        let factors = if track.has_places() { FACTORS } else { TURNS };
        let all: Vec<usize> = (0..spans.len()).collect();
        let alone = independent(&spans, &all) * SPAN / TOGETHER;
        let alone = alone.max(factors as f64 + 1.0);
        Self {
            track,
            flows: summed(&seen.map(numbers).collect::<Vec<_>>(), together),
            spans,
            together,
            middle: track.middle(),
            factors,
            by_chance: (alone - factors as f64) / alone,
        }
    }

    /// Root mean square of each number.
    fn spread(&self) -> [f64; NUMBERS] {
        let n = self.flows.len().max(1) as f64;
        std::array::from_fn(|k| {
            let squares: f64 = self.flows.iter().map(|f| f[k] * f[k]).sum();
            (squares / n).sqrt().max(1e-12)
        })
    }

    /// The tracker's turn and way, in its own axes at the first of both instants, and the way times
    /// where it is.
    fn moved(&self, offset: f64) -> Option<Vec<[f64; FACTORS]>> {
        let one = |&(from, to): &(f64, f64)| {
            let before = self.track.pose_at(from + offset)?;
            let after = self.track.pose_at(to + offset)?;
            let back = before.rotation.inverse();
            let turn = shortest(back * after.rotation).to_scaled_axis();
            let way = back * (after.translation - before.translation);
            let place = before.translation - self.middle;
            let mut factors = [0.0; FACTORS];
            factors[..3].copy_from_slice(&turn.to_array());
            for (k, share) in [1.0, place.x, place.y, place.z].into_iter().enumerate() {
                factors[3 * (k + 1)..][..3].copy_from_slice(&(way * share).to_array());
            }
            Some(factors)
        };
        let each: Option<Vec<_>> = self.spans.iter().map(one).collect();
        Some(summed(&each?, self.together))
    }

    /// What is left of each number after the best factors at an offset.
    fn left(&self, offset: f64) -> Option<Vec<[f64; NUMBERS]>> {
        let moved = self.moved(offset)?;
        let n = self.factors;
        let mut normal = Matrix::zeros(n, n);
        let mut right = [[0.0; FACTORS]; NUMBERS];
        for (m, flow) in moved.iter().zip(&self.flows) {
            normal.add_outer(1.0, &m[..n], &m[..n]);
            for (sums, number) in right.iter_mut().zip(flow) {
                sums.iter_mut()
                    .zip(m)
                    .for_each(|(sum, m)| *sum += m * number);
            }
        }
        for i in 0..n {
            let own = normal[(i, i)];
            normal[(i, i)] = own * (1.0 + RIDGE) + 1e-18;
        }
        let solver = normal.cholesky()?;
        let factors = right.map(|sums| solver.solve(&sums[..n]));
        let rest = |(m, flow): (&[f64; FACTORS], &[f64; NUMBERS])| {
            std::array::from_fn(|k| {
                let told: f64 = factors[k].iter().zip(m).map(|(f, m)| f * m).sum();
                flow[k] - told
            })
        };
        Some(moved.iter().zip(&self.flows).map(rest).collect())
    }

    /// With numbers in units of their noise.
    fn fit(&self, offset: f64, noise: &[f64; NUMBERS]) -> Option<Fit> {
        let in_units = |values: &[[f64; NUMBERS]]| -> Vec<f64> {
            let each = values
                .iter()
                .flat_map(|v| (0..NUMBERS).map(|k| v[k] / noise[k]));
            each.collect()
        };
        let power: f64 = in_units(&self.flows).iter().map(|v| v * v).sum();
        Some(Fit::new(
            in_units(&self.left(offset)?),
            power * self.by_chance,
        ))
    }

    /// Each number's usual rest, and which motions are far off it.
    fn noise(&self, offset: f64) -> Option<([f64; NUMBERS], Vec<bool>)> {
        let left = self.left(offset)?;
        let spread = self.spread();
        let noise: [f64; NUMBERS] = std::array::from_fn(|k| {
            let usual = 1.4826 * median_absolute(left.iter().map(|l| l[k]));
            usual.max(0.01 * spread[k]).max(1e-12)
        });
        let far = |l: &[f64; NUMBERS]| (0..NUMBERS).any(|k| l[k].abs() > OUTLYING * noise[k]);
        let sums: Vec<bool> = left.iter().map(far).collect();
        // A jump is in all sums that hold it, and in no others.
        let jumped = |i: usize| {
            let first = (i + 1).saturating_sub(self.together);
            sums[first..sums.len().min(i + 1)].iter().all(|far| *far)
        };
        Some((noise, (0..self.spans.len()).map(jumped).collect()))
    }
}

/// Sums of so many neighbours.
fn summed<const N: usize>(values: &[[f64; N]], together: usize) -> Vec<[f64; N]> {
    let sum = |w: &[[f64; N]]| std::array::from_fn(|k| w.iter().map(|v| v[k]).sum());
    values.windows(together).map(sum).collect()
}
