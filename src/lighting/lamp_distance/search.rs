//! The search for the distances of lamps.
//!
//! What the shadows tell of one lamp depends on where the others are: with the others infinitely far, no
//! distance of a near one may explain the picture well. Lamps that are new are therefore searched together:
//! each takes its best distance in turn until all have settled, and only then it is judged which of them are
//! near. One that is not becomes infinitely far, and the others settle again.
//!
//! Two lamps in nearly the same direction can take each other's part, so that neither finds its distance while the
//! other has a wrong one. Their distances are searched in pairs, too.
//!
//! A lamp that clips every exposure may be a thousand times as bright as its pixels, and its shadows fit at no
//! distance, or at a wrong one, if it is not. So each distance is judged with the energy that fits best there.

use super::{
    DistanceSearch, LUMINANCE_OF, LampDistance, Losses, SeenLamp, WIDE, add, best, improvement,
    values,
};

/// Spacing of the reciprocals, 1/m, that are looked at in the end.
const FINE: f32 = 0.05;
/// Largest reciprocal, 1/m: no lamp is nearer than 0.2 m.
const NEAREST: f32 = 5.0;
/// Distance from the last result, 1/m, that is searched once more.
const AGAIN: f32 = 0.4;
/// Largest number of rounds in which lamps settle.
const ROUNDS: usize = 8;
/// Change of all reciprocals in a round, 1/m, with which they have settled.
const SETTLED: f32 = 0.02;
/// Angle between two lamps, radians, below which they are searched in pairs.
const ALIKE: f32 = 0.6;
/// Student's t from which an improvement is significant.
const SIGNIFICANT: f32 = 3.0;
/// What a lamp must show to be near: alone, and where another one is near. Lamps that are infinitely far are
/// rare in a room.
const ALONE: Needed = Needed {
    better: SIGNIFICANT,
    sigmas: 2.0,
};
const IN_A_ROOM: Needed = Needed {
    better: 2.0,
    sigmas: 1.0,
};
/// Largest angular radius of a lamp, radians, whose shadows tell a distance.
const LARGEST: f32 = 0.35;

/// The evidence that a lamp is near.
#[derive(Clone, Copy)]
struct Needed {
    /// Student's t by which its reciprocal is better than 0.
    better: f32,
    /// How many standard deviations the reciprocal is above 0.
    sigmas: f32,
}

/// The largest factor on the light of a lamp whose energy is unknown, and the steps in which it is searched,
/// octaves.
const OCTAVES: (f32, [f32; 3]) = (12.0, [2.0, 1.0, 0.5]);
/// That search compares every so many pairs of points: as many of each distance and direction.
const SOME: usize = 5;

/// Losses by reciprocals, 1/m.
type Looked = Vec<(f32, Losses)>;

/// A lamp that is searched.
struct Searched {
    lamp: usize,
    /// What its irradiance is multiplied by at each point, by numbers of fine steps.
    forms: Vec<(u32, Vec<f32>)>,
    /// Octaves that its energy is taken for there, as of the last look.
    octaves: Vec<f32>,
    inverse: f32,
}

impl Searched {
    fn new(lamp: usize) -> Self {
        Self {
            lamp,
            forms: Vec::new(),
            octaves: Vec::new(),
            inverse: 0.0,
        }
    }

    /// The form and the energy, octaves, at a reciprocal that was looked at.
    fn at(&self, inverse: f32) -> Option<(&Vec<f32>, f32)> {
        let k = self.forms.iter().position(|(n, _)| *n == number(inverse))?;
        Some((&self.forms[k].1, self.octaves[k]))
    }
}

impl DistanceSearch<'_> {
    /// Finds the distance of lamp number `lamp` near the one that is known, and uses it from now on.
    /// `None` if the lamp is too large for its shadows to tell.
    pub fn find(&mut self, lamp: usize, known: f32) -> Option<LampDistance> {
        let source = self.lamps.get(lamp).filter(|l| can_tell(l))?;
        let far = self.losses(lamp, &self.form(source, 0.0));
        let mut looked = vec![(0.0, far), (known, self.losses(lamp, &self.by_lamp[lamp]))];
        for k in [-2.0, -1.0, 1.0, 2.0f32] {
            let inverse = (known + k * FINE).max(FINE);
            let form = self.form(&self.lamps[lamp], inverse);
            looked.push((inverse, self.losses(lamp, &form)));
        }
        let found = judged(&looked, Some(known), ALONE);
        self.lamps[lamp].source.distance = found;
        self.by_lamp[lamp] = self.form(&self.lamps[lamp], found.inverse);
        Some(found)
    }

    /// Finds the distances of lamps, and uses them from now on. Returns them with the lamps' numbers, without
    /// lamps too large for their shadows to tell.
    pub fn find_together(&mut self, lamps: &[usize]) -> Vec<(usize, LampDistance)> {
        let can_tell = |lamp: &&usize| self.lamps.get(**lamp).is_some_and(can_tell);
        let of_these = lamps.iter().filter(can_tell).copied();
        let mut searched: Vec<Searched> = of_these.map(Searched::new).collect();
        let mut found = Vec::new();
        self.settle(&mut searched);
        if self.settle_pairs(&mut searched) {
            self.settle(&mut searched);
        }
        loop {
            let look = |s: &mut Searched| self.look(s, [0.0, NEAREST]);
            let looked: Vec<Looked> = searched.iter_mut().map(look).collect();
            let is_known = |k: usize| searched.iter().all(|s| s.lamp != k);
            let known = self.lamps.iter().enumerate().filter(|(k, _)| is_known(*k));
            let is_room = known
                .map(|(_, lamp)| lamp.source.distance.inverse)
                .any(|i| i > 0.0)
                || looked.iter().any(|l| judged(l, None, ALONE).inverse > 0.0)
                || (searched.len() > 1 && self.better_together(&searched) > SIGNIFICANT);
            let needed = if is_room { IN_A_ROOM } else { ALONE };
            let judge = |l: &Looked| (better_than_far(l), judged(l, None, needed));
            let all: Vec<(f32, LampDistance)> = looked.iter().map(judge).collect();
            let far = all.iter().enumerate().filter(|(_, l)| l.1.inverse == 0.0);
            let Some((k, (_, distance))) = far.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) else {
                let near = searched.iter().zip(all);
                found.extend(near.map(|(s, (_, distance))| (s.lamp, distance)));
                break;
            };
            let gone = searched.remove(k);
            found.push((gone.lamp, *distance));
            if gone.inverse > 0.0 {
                self.place(&gone, 0.0);
                self.settle(&mut searched);
            }
        }
        for (lamp, distance) in &found {
            self.lamps[*lamp].source.distance = *distance;
            self.by_lamp[*lamp] = self.form(&self.lamps[*lamp], distance.inverse);
        }
        found.sort_unstable_by_key(|(lamp, _)| *lamp);
        found
    }

    /// Student's t by which lamps where they have settled are better than all of them infinitely far.
    fn better_together(&self, searched: &[Searched]) -> f32 {
        let mut far: Vec<f32> = self.rest.iter().map(|rest| rest[LUMINANCE_OF]).collect();
        self.add_lamps(&mut far, LUMINANCE_OF, |k| {
            searched.iter().all(|s| s.lamp != k)
        });
        for s in searched {
            let light = values(self.lamps[s.lamp].source.irradiance)[LUMINANCE_OF];
            if let Some((form, octaves)) = s.at(0.0) {
                add(&mut far, form, light * octaves.exp2());
            }
        }
        let log: Vec<f32> = far.iter().map(|sum| sum.max(1e-9).ln()).collect();
        let far = self.losses_of(LUMINANCE_OF, &log);
        let near = self.losses_of(LUMINANCE_OF, &self.log_irradiance(LUMINANCE_OF, None));
        improvement(&far, &near)
    }

    /// Gives each lamp its best distance in turn until none changes any more.
    fn settle(&mut self, searched: &mut [Searched]) {
        for round in 0..ROUNDS {
            let mut moved = 0.0f32;
            for s in searched.iter_mut() {
                let range = if round == 0 {
                    [0.0, NEAREST]
                } else {
                    [s.inverse - AGAIN, s.inverse + AGAIN]
                };
                let inverse = best(&self.look(s, range), 0.0);
                moved = moved.max((inverse - s.inverse).abs());
                s.inverse = inverse;
                self.place(s, inverse);
            }
            if moved < SETTLED || searched.len() < 2 {
                break;
            }
        }
    }

    /// Gives every two lamps in nearly the same direction the two reciprocals that fit best together; true if
    /// any changed.
    fn settle_pairs(&mut self, searched: &mut [Searched]) -> bool {
        let mut changed = false;
        for second in 1..searched.len() {
            let (before, after) = searched.split_at_mut(second);
            for a in before {
                let b = &mut after[0];
                let [of_a, of_b] = [&*a, b].map(|s| &self.lamps[s.lamp]);
                let angle = of_a.source.direction.angle_between(of_b.source.direction);
                let is_known = !of_a.is_energy_unknown && !of_b.is_energy_unknown;
                if angle < ALIKE && is_known {
                    changed |= self.settle_pair(a, b);
                }
            }
        }
        changed
    }

    fn settle_pair(&mut self, a: &mut Searched, b: &mut Searched) -> bool {
        for s in [&mut *a, b] {
            let step = coarse(&self.lamps[s.lamp]);
            let mut looked = Looked::new();
            for k in 0..=number(NEAREST) / step {
                self.look_at(s, k * step, &mut looked);
            }
        }
        let mut others: Vec<f32> = self.rest.iter().map(|rest| rest[LUMINANCE_OF]).collect();
        self.add_lamps(&mut others, LUMINANCE_OF, |k| k != a.lamp && k != b.lamp);
        let light = |s: &Searched| values(self.light(s.lamp))[LUMINANCE_OF];
        let lights = [&*a, b].map(light);
        let mut log = Vec::with_capacity(others.len());
        let mut losses = |of_a: &[f32], of_b: &[f32]| {
            log.clone_from(&others);
            add(&mut log, of_a, lights[0]);
            add(&mut log, of_b, lights[1]);
            log.iter_mut().for_each(|sum| *sum = sum.max(1e-9).ln());
            self.losses_of_every(SOME, LUMINANCE_OF, &log)
        };
        let now = losses(&self.by_lamp[a.lamp], &self.by_lamp[b.lamp]);
        let total = |losses: &Losses| losses.iter().sum::<f32>();
        let mut least = (total(&now), now.clone(), (a.inverse, b.inverse));
        for (n, of_a) in &a.forms {
            for (m, of_b) in &b.forms {
                let these = losses(of_a, of_b);
                if total(&these) < least.0 {
                    let inverses = (*n as f32 * FINE, *m as f32 * FINE);
                    least = (total(&these), these, inverses);
                }
            }
        }
        let is_better = improvement(&now, &least.1) > 1.0;
        if is_better {
            (a.inverse, b.inverse) = least.2;
            self.place(a, a.inverse);
            self.place(b, b.inverse);
        }
        is_better
    }

    /// Gives a lamp a reciprocal that was looked at.
    fn place(&mut self, s: &Searched, inverse: f32) {
        if let Some((form, octaves)) = s.at(inverse) {
            self.by_lamp[s.lamp].clone_from(form);
            self.assumed[s.lamp] = octaves;
        }
    }

    /// The losses at infinity, in a range of reciprocals, and in smaller and smaller steps about the best of
    /// them.
    fn look(&self, s: &mut Searched, [low, high]: [f32; 2]) -> Looked {
        let mut looked = Looked::new();
        let mut step = coarse(&self.lamps[s.lamp]);
        let [first, last] = [low, high].map(|end| number(end.clamp(0.0, NEAREST)).div_ceil(step));
        for k in std::iter::once(0).chain(first..=last) {
            self.look_at(s, k * step, &mut looked);
        }
        while step > 1 {
            step /= 2;
            let around = number(best(&looked, 0.0));
            for n in [around.saturating_sub(step), around + step] {
                self.look_at(s, n, &mut looked);
            }
        }
        looked
    }

    /// Adds the losses at a number of fine steps.
    fn look_at(&self, s: &mut Searched, number: u32, looked: &mut Looked) {
        let inverse = number as f32 * FINE;
        if looked.iter().any(|(known, _)| *known == inverse) {
            return;
        }
        let known = s.forms.iter().position(|(n, _)| *n == number);
        let k = known.unwrap_or_else(|| {
            let form = self.form(&self.lamps[s.lamp], inverse);
            s.forms.push((number, form));
            s.octaves.push(0.0);
            s.forms.len() - 1
        });
        let (octaves, losses) = if self.lamps[s.lamp].is_energy_unknown {
            self.least_losses(s.lamp, &s.forms[k].1)
        } else {
            (0.0, self.losses(s.lamp, &s.forms[k].1))
        };
        s.octaves[k] = octaves;
        looked.push((inverse, losses));
    }

    /// The energy, octaves, with which another form of a lamp fits best, and the losses with it.
    fn least_losses(&self, lamp: usize, form: &[f32]) -> (f32, Losses) {
        let others = self.irradiance_without(LUMINANCE_OF, Some(lamp));
        let light = values(self.lamps[lamp].source.irradiance)[LUMINANCE_OF];
        let mut log = Vec::with_capacity(others.len());
        let mut losses = |octaves: f32, every: usize| {
            log.clone_from(&others);
            add(&mut log, form, light * octaves.exp2());
            log.iter_mut().for_each(|sum| *sum = sum.max(1e-9).ln());
            self.losses_of_every(every, LUMINANCE_OF, &log)
        };
        let (last, [coarse, finer @ ..]) = OCTAVES;
        let steps = (last / coarse) as i32;
        let all = (0..=steps).map(|k| coarse * k as f32);
        let mut looked: Looked = all.map(|k| (k, losses(k, SOME))).collect();
        for step in finer {
            let around = best(&looked, 0.0);
            for octaves in [around - step, around + step] {
                looked.push((octaves, losses(octaves, SOME)));
            }
        }
        let octaves = best(&looked, 0.0);
        (octaves, losses(octaves, 1))
    }

    /// The losses of luminance with another form of lamp number `lamp`.
    fn losses(&self, lamp: usize, form: &[f32]) -> Losses {
        let log = self.log_irradiance(LUMINANCE_OF, Some((lamp, (form, self.light(lamp)))));
        self.losses_of(LUMINANCE_OF, &log)
    }
}

/// Whether the shadows of a lamp tell its distance.
fn can_tell(lamp: &SeenLamp) -> bool {
    lamp.source.angular_radius <= LARGEST
}

/// The number of fine steps between the reciprocals that are looked at first, a power of two: the wider a
/// lamp, the softer its shadows, and the farther they match.
fn coarse(lamp: &SeenLamp) -> u32 {
    if lamp.source.angular_radius < WIDE {
        4
    } else {
        8
    }
}

/// The number of fine steps in a reciprocal.
fn number(inverse: f32) -> u32 {
    (inverse / FINE).round() as u32
}

fn losses_at(looked: &[(f32, Losses)], wanted: f32) -> &[f32] {
    let found = looked.iter().find(|(inverse, _)| *inverse == wanted);
    found.map_or(&[][..], |(_, losses)| losses.as_slice())
}

/// Student's t by which the best reciprocal is better than an infinite distance.
fn better_than_far(looked: &[(f32, Losses)]) -> f32 {
    let least = losses_at(looked, best(looked, 0.0));
    improvement(losses_at(looked, 0.0), least)
}

/// The best reciprocal, with its standard deviation, if it is significantly better than 0; of a
/// lamp whose reciprocal is `known`, that one unless another is better.
fn judged(looked: &[(f32, Losses)], known: Option<f32>, needed: Needed) -> LampDistance {
    let mut inverse = best(looked, 0.0);
    let losses = |wanted: f32| losses_at(looked, wanted);
    if let Some(known) = known {
        let significant = if inverse == 0.0 { SIGNIFICANT } else { 1.0 };
        if improvement(losses(known), losses(inverse)) < significant {
            inverse = known;
        }
    }
    // As far as a reciprocal is less than one standard deviation worse, it may be the right one.
    let least = losses(inverse);
    let alike = looked.iter().filter(|(_, l)| improvement(l, least) < 1.0);
    let sigma = alike.map(|(i, _)| (i - inverse).abs()).fold(FINE, f32::max);
    let is_better = improvement(losses(0.0), least) > needed.better;
    let is_near = is_better && inverse > needed.sigmas * sigma;
    LampDistance {
        inverse: match known {
            Some(known) if known == inverse => known,
            None if !is_near => 0.0,
            _ => between_steps(looked, inverse),
        },
        sigma,
    }
}

/// The minimum of the parabola through the losses of the best reciprocal and its neighbours.
fn between_steps(looked: &[(f32, Losses)], best: f32) -> f32 {
    let total = |wanted: f32| {
        let found = looked.iter().find(|(i, _)| (i - wanted).abs() < 0.01)?;
        Some(found.1.iter().sum::<f32>())
    };
    let (before, after) = (total(best - FINE), total(best + FINE));
    let (Some(before), Some(least), Some(after)) = (before, total(best), after) else {
        return best;
    };
    let curvature = before + after - 2.0 * least;
    let shift = if curvature > 0.0 {
        0.5 * (before - after) / curvature
    } else {
        0.0
    };
    best + FINE * shift.clamp(-0.5, 0.5)
}
