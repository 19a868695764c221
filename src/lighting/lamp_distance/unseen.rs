//! Lamps that the environment camera does not see, from their shadows in the scene camera's picture.
//!
//! Something may stand between that camera and a lamp, or the lamp below the edge of what a fisheye sees. Real
//! objects still throw its shadow. Lamps are tried in all directions in which something may hide one, at several
//! distances and with several energies; those that explain the picture best are moved about until none fits better,
//! and the best is kept if the picture is explained better with it than without it in so many independent parts that
//! none of the many that were tried would have done so by chance.

use super::energy::Colour;
use super::{
    DistanceSearch, LUMINANCE_OF, LampDistance, Losses, SeenLamp, SeenSurfaces, SurfacePoint, add,
    improvement, values,
};
use crate::adaptive::CompactSource;
use crate::cube::{spiral, tangent_frame};
use glam::{DVec3, Vec3};
use penumbra_interface::threads;
use penumbra_numerics::Random;

/// Directions of the sphere that are tried.
const DIRECTIONS: usize = 1000;
/// Reciprocals of the distances that are tried, 1/m.
const INVERSES: [f32; 5] = [0.0, 0.7, 1.4, 2.4, 3.8];
/// Largest reciprocal.
const NEAREST: f32 = 5.0;
/// Mean light on the surfaces by the lamp, octaves of that by all others.
const OCTAVES: [f32; 6] = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0];
/// Angular radii, radians.
pub(super) const RADII: [f32; 4] = [0.015, 0.04, 0.08, 0.15];
/// First steps of the direction, radians, of the reciprocal, 1/m, and of the energy, octaves.
const STEPS: (f32, f32, f32) = (0.06, 0.4, 0.5);
/// Number of steps, at first and from look to look, and what their size is multiplied by after one that fits better,
/// and after any other: about one in six does (Rechenberg 1973).
const CHANGES: usize = 120;
const CHANGES_LATER: usize = 16;
const LONGER: f32 = 1.4;
const SHORTER: f32 = 0.93;
/// Share of the points that a lamp must light where nothing blocks it.
const LIT: f32 = 0.5;
/// Every so many points are tested for that.
const SOME: usize = 17;
/// Lamps that a thread tries at a time: more than in a part of the search that is tried alone.
const CHUNK: usize = 128;
/// So many of them are improved, the best in directions so far apart, radians;
const STARTS: usize = 4;
const APART: f32 = 0.1;
/// if the best has this Student's t.
const WORTH_WHILE: f32 = 1.5;
/// Student's t from which a lamp is there, where nothing is seen and behind what is seen. Without a lamp, 3.3 was the
/// largest of 40 pictures of rigs, and 0 where nothing is seen.
const THERE: f32 = 3.5;
const THERE_BEHIND: f32 = 4.5;
/// Student's t from which its own shadows are seen: light alone could hide that a shadow of another lamp is missing,
/// because what is known to throw it is gone. 3.4 to 4.5 for lamps that were there.
const SHADOWS_SEEN: f32 = 2.5;
/// Student's t from which a lamp that is known is still there.
const STILL_THERE: f32 = 2.0;
/// Share of a new estimate in a lamp that is followed.
const SHARE: f32 = 0.3;
/// Standard deviations of the reciprocal, 1/m, that are told apart.
const SIGMAS: [f32; 5] = [0.05, 0.1, 0.2, 0.4, 0.8];

/// What may hide a lamp in a direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hiding {
    /// Nothing: it would be seen.
    Nothing,
    /// Something dark: lit from elsewhere.
    DarkThing,
    /// The environment camera does not see that direction.
    NotSeen,
}

/// A lamp that the environment camera does not see, as it would see it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnseenLamp {
    /// Unit vector from the observer towards it, world.
    pub direction: Vec3,
    /// Its distance from the observer.
    pub distance: LampDistance,
    /// Half angle of its cone, radians.
    pub angular_radius: f32,
    /// Irradiance on a surface that faces it at the observer, RGB, scene camera units.
    pub irradiance: Vec3,
}

impl UnseenLamp {
    /// A lamp that was seen.
    #[must_use]
    pub fn of(source: &CompactSource) -> Self {
        Self {
            direction: source.direction,
            distance: source.distance,
            angular_radius: source.angular_radius.max(RADII[0]),
            irradiance: source.irradiance,
        }
        .moved(-source.viewpoint)
    }

    /// The same lamp as an observer sees it that has moved by `by`, metres.
    #[must_use]
    pub fn seen_from_elsewhere(&self, by: Vec3) -> Self {
        let moved = self.moved(by);
        if self.distance.inverse <= 0.0 {
            return *self;
        }
        let nearer = moved.distance.inverse / self.distance.inverse;
        Self {
            angular_radius: self.angular_radius * nearer,
            irradiance: self.irradiance * (nearer * nearer),
            ..moved
        }
    }

    /// Directions evenly spread over it.
    pub(crate) fn points(&self, count: usize) -> impl Iterator<Item = Vec3> + use<> {
        let (lamp, (right, up)) = (*self, tangent_frame(self.direction));
        (0..count).map(move |k| {
            let (sin, cos) = spiral(k);
            let apart = lamp.angular_radius * ((k as f32 + 0.5) / count as f32).sqrt();
            (lamp.direction + (right * cos + up * sin) * apart).normalize()
        })
    }

    /// One of any energy.
    const fn tried(direction: Vec3, inverse: f32) -> Self {
        Self {
            direction,
            distance: LampDistance {
                inverse,
                sigma: 0.0,
            },
            angular_radius: RADII[0],
            irradiance: Vec3::ONE,
        }
    }

    /// The same lamp as it is seen from another point, metres from this one.
    fn moved(&self, by: Vec3) -> Self {
        let to = self.direction - by * self.distance.inverse;
        let length = to.length().max(1e-3);
        let mut moved = *self;
        moved.direction = to / length;
        moved.distance.inverse /= length;
        moved
    }

    fn seen(&self) -> SeenLamp {
        let parts = match SeenLamp::part_count(self.angular_radius) {
            1 => vec![self.direction],
            count => self.points(count).collect(),
        };
        SeenLamp {
            source: CompactSource::of_unseen(self),
            parts,
            is_energy_unknown: false,
        }
    }
}

/// A lamp that is tried.
#[derive(Clone, Debug)]
struct Trial {
    lamp: UnseenLamp,
    /// Luminance of its irradiance.
    light: f32,
    losses: Losses,
    total: f32,
}

impl DistanceSearch<'_> {
    /// Finds a lamp in directions (unit vectors from the observer) in which something may hide one, and uses it from
    /// now on. `None` if no lamp there explains the picture significantly better. Only part number `part.0` of
    /// `part.1` of what is to be tried is tried.
    pub fn find_unseen(
        &mut self,
        hiding: &dyn Fn(Vec3) -> Hiding,
        part: (usize, usize),
    ) -> Option<UnseenLamp> {
        let coarsest = decimated(self.surfaces, 3);
        let coarsest = self.over(&coarsest);
        let others = coarsest.irradiance_without(LUMINANCE_OF, None);
        let all = INVERSES
            .into_iter()
            .flat_map(|inverse| sphere().map(move |d| UnseenLamp::tried(d, inverse)));
        let these = all.skip(part.0).step_by(part.1.max(1));
        let tried: Vec<UnseenLamp> = these
            .filter(|lamp| hiding(lamp.direction) != Hiding::Nothing && coarsest.is_lit_by(lamp))
            .collect();
        let each = threads::map(&tried, CHUNK, |_, lamp| {
            coarsest.with_best_light(*lamp, &others)
        });
        let starts = best_apart(each.into_iter().flatten().collect());
        let without = coarsest.losses_of(LUMINANCE_OF, &logarithms(&others));
        if improvement(&without, &starts.first()?.losses) < WORTH_WHILE {
            return None;
        }
        let surfaces = decimated(self.surfaces, 2);
        let coarse = self.over(&surfaces);
        let others = coarse.irradiance_without(LUMINANCE_OF, None);
        let improved = starts.into_iter().map(|start| {
            // Soft shadows match from farther away.
            let lamp = UnseenLamp {
                angular_radius: RADII[1],
                ..start.lamp
            };
            let mut best = coarse.trial(lamp, start.light, &others);
            coarse.improve(&mut best, hiding, &others, (1.0, CHANGES));
            best
        });
        let best = improved.min_by(|a, b| a.total.total_cmp(&b.total))?;
        let others = self.irradiance_without(LUMINANCE_OF, None);
        let mut best = self.trial(best.lamp, best.light, &others);
        self.improve(&mut best, hiding, &others, (0.5, CHANGES));
        self.smooths = true;
        self.widen(&mut best, hiding, &others);
        self.smooths = false;
        let without = self.losses_of(LUMINANCE_OF, &logarithms(&others));
        let needed = match hiding(best.lamp.direction) {
            Hiding::NotSeen => THERE,
            Hiding::DarkThing | Hiding::Nothing => THERE_BEHIND,
        };
        let is_better = improvement(&without, &best.losses) > needed;
        if !is_better || self.shadows_seen(&best, &others) < SHADOWS_SEEN {
            return None;
        }
        best.lamp.distance.sigma = self.inverse_sigma(&best, &others);
        Some(self.adopt(best))
    }

    /// The lamp of a trial, in its colour; it is used from now on.
    fn adopt(&mut self, best: Trial) -> UnseenLamp {
        let mut lamp = best.lamp;
        lamp.irradiance = Vec3::splat(best.light);
        let number = self.adopt_known(&lamp);
        // As that of a lamp that is corrected already: it may become brighter, and less bright.
        let corrected = Vec3::splat(2.0);
        lamp.irradiance *= self.find_factor(number, corrected, Colour::BestMatch);
        lamp
    }

    /// Uses a lamp from now on, and returns its number.
    pub(super) fn adopt_known(&mut self, lamp: &UnseenLamp) -> usize {
        let seen = lamp.seen();
        self.by_lamp.push(self.form(&seen, lamp.distance.inverse));
        self.lamps.push(seen);
        self.assumed.push(0.0);
        self.lamps.len() - 1
    }

    /// Uses a lamp that was seen until now from now on, as bright and where it explains the picture best; `None` if it
    /// explains nothing: it is off, not hidden.
    pub fn keep_unseen(
        &mut self,
        lamp: &UnseenLamp,
        hiding: &dyn Fn(Vec3) -> Hiding,
    ) -> Option<UnseenLamp> {
        let surfaces = decimated(self.surfaces, 2);
        let coarse = self.over(&surfaces);
        let others = coarse.irradiance_without(LUMINANCE_OF, None);
        let without = coarse.losses_of(LUMINANCE_OF, &logarithms(&others));
        let there = coarse.trial(*lamp, values(lamp.irradiance)[LUMINANCE_OF], &others);
        if improvement(&without, &there.losses) < STILL_THERE {
            return None;
        }
        let number = self.adopt_known(lamp);
        let now = self.follow_unseen(number, (lamp, true), hiding);
        self.lamps.truncate(number);
        self.by_lamp.truncate(number);
        self.assumed.truncate(number);
        self.adopt_known(&now?);
        now
    }

    /// Moves lamp number `lamp`, which is `known`, to where it explains the picture best, in small steps or, if the
    /// other lamps were others when it was found, in large ones; `None` if it explains nothing any more.
    pub fn follow_unseen(
        &self,
        lamp: usize,
        (known, is_new): (&UnseenLamp, bool),
        hiding: &dyn Fn(Vec3) -> Hiding,
    ) -> Option<UnseenLamp> {
        let (surfaces, coarse);
        let (search, steps) = if is_new {
            (self, (0.5, CHANGES))
        } else {
            surfaces = decimated(self.surfaces, 2);
            coarse = self.over(&surfaces);
            (&coarse, (0.25, CHANGES_LATER))
        };
        let others = search.irradiance_without(LUMINANCE_OF, Some(lamp));
        let light = values(known.irradiance)[LUMINANCE_OF];
        let mut best = search.trial(*known, light, &others);
        let before = best.losses.clone();
        search.improve(&mut best, hiding, &others, steps);
        let without = search.losses_of(LUMINANCE_OF, &logarithms(&others));
        if improvement(&without, &best.losses) < STILL_THERE {
            return None;
        }
        // A picture in which the ends of its shadows are hidden tells little, and is to change little.
        let weight = improvement(&before, &best.losses).clamp(0.0, 1.0);
        let weight = weight * if is_new { 1.0 } else { SHARE };
        let light = known.irradiance * (best.light / light.max(f32::MIN_POSITIVE));
        Some(UnseenLamp {
            direction: known
                .direction
                .lerp(best.lamp.direction, weight)
                .normalize(),
            distance: LampDistance {
                inverse: known.distance.inverse
                    + weight * (best.lamp.distance.inverse - known.distance.inverse),
                sigma: known.distance.sigma,
            },
            irradiance: known.irradiance.lerp(light, weight),
            ..*known
        })
    }

    /// Student's t by which the picture is explained better by a lamp than by the same light without its shadows.
    fn shadows_seen(&self, best: &Trial, others: &[f32]) -> f32 {
        let (seen, inverse) = (best.lamp.seen(), best.lamp.distance.inverse);
        let open = |p: &Option<SurfacePoint>| {
            p.map_or(0.0, |p| self.by_parts(&seen, inverse, &p, |_, _| true))
        };
        let open: Vec<f32> = self.surfaces.points.iter().map(open).collect();
        let open = self.with_light(best.lamp, (&open, best.light), others);
        improvement(&open.losses, &best.losses)
    }

    /// Standard deviation of the reciprocal of a trial's distance: seen from the middle of the surfaces, it is in the
    /// same direction.
    fn inverse_sigma(&self, best: &Trial, others: &[f32]) -> f32 {
        let is_alike = |by: f32| {
            let mut seen = best.lamp.moved(self.to_middle());
            seen.distance.inverse = (seen.distance.inverse + by).max(0.0);
            let lamp = seen.moved(-self.to_middle());
            let light = self.as_bright(&best.lamp, &lamp) * best.light;
            let trial = self.trial(lamp, light, others);
            improvement(&trial.losses, &best.losses) < 1.0
        };
        let steps = SIGMAS.into_iter();
        let alike = steps.take_while(|sigma| is_alike(*sigma) || is_alike(-sigma));
        alike.last().unwrap_or(SIGMAS[0])
    }

    /// The same search over other surfaces of the same scene, whose points are among those of this one.
    fn over<'b>(&'b self, surfaces: &'b Decimated) -> DistanceSearch<'b> {
        let of = |all: &Vec<f32>| surfaces.numbers.iter().map(|i| all[*i]).collect();
        let mut search = DistanceSearch {
            surfaces: &surfaces.surfaces,
            observer: self.observer,
            blocked: self.blocked,
            rest: surfaces.numbers.iter().map(|i| self.rest[*i]).collect(),
            by_lamp: self.by_lamp.iter().map(of).collect(),
            lamps: self.lamps.clone(),
            assumed: self.assumed.clone(),
            scale: self.scale,
            faces: super::faces::Faces::default(),
            pairs: Vec::new(),
            smooths: false,
        };
        search.pairs = search.compared();
        search
    }

    /// Whether most of the surfaces face a lamp.
    fn is_lit_by(&self, lamp: &UnseenLamp) -> bool {
        let (mut lit, mut all) = (0, 0);
        for light in self.unblocked(lamp) {
            lit += usize::from(light > 0.0);
            all += 1;
        }
        lit as f32 > LIT * all as f32
    }

    /// The light of a lamp at some of the points, where nothing blocks it.
    fn unblocked(&self, lamp: &UnseenLamp) -> impl Iterator<Item = f32> {
        let seen = lamp.seen();
        let known = self.surfaces.points.iter().flatten().step_by(SOME);
        known.map(move |p| self.by_parts(&seen, lamp.distance.inverse, p, |_, _| true))
    }

    /// A lamp with the energy that fits best; `None` if it lights nothing.
    fn with_best_light(&self, lamp: UnseenLamp, others: &[f32]) -> Option<Trial> {
        let form = self.form(&lamp.seen(), lamp.distance.inverse);
        let lit: f32 = form.iter().sum();
        let alike = others.iter().sum::<f32>() / lit;
        let with = |octaves: f32| {
            let light = alike * octaves.exp2();
            self.with_light(lamp, (&form, light), others)
        };
        let all = OCTAVES.into_iter().filter(|_| lit > 0.0).map(with);
        all.min_by(|a, b| a.total.total_cmp(&b.total))
    }

    fn with_light(&self, lamp: UnseenLamp, (form, light): (&[f32], f32), others: &[f32]) -> Trial {
        let mut sum = others.to_vec();
        add(&mut sum, form, light);
        let losses = self.losses_of(LUMINANCE_OF, &logarithms(&sum));
        Trial {
            lamp,
            light,
            total: losses.iter().sum(),
            losses,
        }
    }

    fn trial(&self, lamp: UnseenLamp, light: f32, others: &[f32]) -> Trial {
        let form = self.form(&lamp.seen(), lamp.distance.inverse);
        self.with_light(lamp, (&form, light), others)
    }

    /// Changes a trial at random, the first time by about a share of [`STEPS`], and keeps what fits better. What
    /// fits is a narrow valley, and rough: nearer lamps in other directions cast nearly the same shadows.
    fn improve(
        &self,
        best: &mut Trial,
        hiding: &dyn Fn(Vec3) -> Hiding,
        others: &[f32],
        (mut share, changes): (f32, usize),
    ) {
        let mut random = Random::new(1);
        let to_middle = self.to_middle();
        for _ in 0..changes {
            let (angle, inverse, octaves) = STEPS;
            let mut by = |step: f32| random.normal() as f32 * step * share;
            let mut seen = best.lamp.moved(to_middle);
            let (right, up) = tangent_frame(seen.direction);
            seen.direction = (seen.direction + right * by(angle) + up * by(angle)).normalize();
            seen.distance.inverse = (seen.distance.inverse + by(inverse)).clamp(0.0, NEAREST);
            let lamp = seen.moved(-to_middle);
            let octaves = by(octaves);
            let before = best.total;
            if hiding(lamp.direction) != Hiding::Nothing {
                // As bright where the surfaces are as before.
                let light = self.as_bright(&best.lamp, &lamp) * best.light;
                self.keep_better(best, lamp, light * octaves.exp2(), others);
            }
            share *= if best.total < before { LONGER } else { SHORTER };
        }
    }

    /// From the observer to the middle of the surfaces: seen from there, the direction of a lamp hardly depends on
    /// its distance.
    fn to_middle(&self) -> Vec3 {
        let known = || self.surfaces.points.iter().flatten();
        let sum: DVec3 = known().map(|p| p.position - self.observer).sum();
        (sum / known().count().max(1) as f64).as_vec3()
    }

    /// The factor on the light of a lamp `to` with which it lights the surfaces as much as `from` does.
    fn as_bright(&self, from: &UnseenLamp, to: &UnseenLamp) -> f32 {
        let sum = |lamp: &UnseenLamp| self.unblocked(lamp).sum::<f32>();
        sum(from) / sum(to).max(1e-6)
    }

    fn keep_better(&self, best: &mut Trial, lamp: UnseenLamp, light: f32, others: &[f32]) {
        let trial = self.trial(lamp, light, others);
        if trial.total < best.total {
            *best = trial;
        }
    }

    /// Gives a trial the radius that fits best, each in the direction that fits it best.
    fn widen(&self, best: &mut Trial, hiding: &dyn Fn(Vec3) -> Hiding, others: &[f32]) {
        let start = best.clone();
        for angular_radius in RADII {
            let lamp = UnseenLamp {
                angular_radius,
                ..start.lamp
            };
            let mut trial = self.trial(lamp, start.light, others);
            self.improve(&mut trial, hiding, others, (0.25, CHANGES));
            if trial.total < best.total {
                *best = trial;
            }
        }
    }
}

/// Some points of a grid.
struct Decimated {
    surfaces: SeenSurfaces,
    /// The numbers of its points in the grid.
    numbers: Vec<usize>,
}

/// Every so many points of a grid, in rows and in columns.
fn decimated(surfaces: &SeenSurfaces, every: usize) -> Decimated {
    let width = surfaces.width.max(1);
    let is_kept =
        |i: &usize| (i % width).is_multiple_of(every) && (i / width).is_multiple_of(every);
    let numbers: Vec<usize> = (0..surfaces.points.len()).filter(is_kept).collect();
    Decimated {
        surfaces: SeenSurfaces {
            width: width.div_ceil(every),
            points: numbers.iter().map(|i| surfaces.points[*i]).collect(),
        },
        numbers,
    }
}

/// The best trials, in different directions, the best first.
fn best_apart(mut trials: Vec<Trial>) -> Vec<Trial> {
    trials.sort_by(|a, b| a.total.total_cmp(&b.total));
    let mut best: Vec<Trial> = Vec::with_capacity(STARTS);
    for trial in trials {
        let apart = |other: &Trial| other.lamp.direction.distance(trial.lamp.direction);
        if best.iter().all(|other| apart(other) > APART) {
            best.push(trial);
        }
        if best.len() == STARTS {
            break;
        }
    }
    best
}

/// Directions evenly spread over the sphere.
fn sphere() -> impl Iterator<Item = Vec3> {
    (0..DIRECTIONS).map(|k| {
        let (sin, cos) = spiral(k);
        let z = 1.0 - (2.0 * k as f32 + 1.0) / DIRECTIONS as f32;
        let level = (1.0 - z * z).sqrt();
        Vec3::new(level * cos, level * sin, z)
    })
}

fn logarithms(sums: &[f32]) -> Vec<f32> {
    sums.iter().map(|sum| sum.max(1e-9).ln()).collect()
}
