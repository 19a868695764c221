//! The energy of clipped lamps, from the depth of shadows and the shading of faces.

use super::{DistanceSearch, LUMINANCE, LUMINANCE_OF, Losses, SurfaceAgreement, best, improvement};
use glam::Vec3;

/// Student's t from which more light is likely: a clipped lamp has more than its pixels show.
const LIKELY: f32 = 2.0;
/// The same if the shading of phantoms tells it: three faces that agree.
const LIKELY_BY_FACES: f32 = 1.7;
/// The largest factor on a clipped lamp's light, octaves.
const LAST_OCTAVE: f32 = 11.0;
/// Spacing of the searched factors, octaves, in the first and in the second step.
const OCTAVES: [f32; 2] = [1.0 / 3.0, 1.0 / 12.0];

/// Difference of the mean contrast of shadows, logarithms, from which on it counts for more than the least
/// loss. Where it is smaller, the least loss found lamps indoors better.
const DIFFERS: f32 = 0.12;
/// By how much the two may differ, octaves, and the steps in which the difference is found.
const EVENED: f32 = 0.5;
const HALVINGS: u32 = 6;

/// What becomes of the colour of a lamp whose energy is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Colour {
    /// Nothing.
    Kept,
    /// It follows the best match.
    BestMatch,
    /// It follows what is significantly better.
    IfBetter,
}

/// The best factor of a search.
struct FoundFactor {
    octaves: f32,
    /// Student's t by which it is better than no factor.
    better: f32,
    /// Whether an octave more or less is significantly worse.
    is_certain: bool,
}

impl FoundFactor {
    /// `looked`: octaves, the first 0, and the losses there.
    fn of(looked: &[(f32, Losses)]) -> Self {
        let octaves = best(looked, 0.0);
        let losses = |wanted: f32| {
            let apart = |(octaves, _): &&(f32, Losses)| (octaves - wanted).abs();
            let nearest = looked.iter().min_by(|a, b| apart(a).total_cmp(&apart(b)));
            nearest.map_or(&[][..], |(_, losses)| losses.as_slice())
        };
        let least = losses(octaves);
        let worse = |by: f32| improvement(losses(octaves + by), least);
        Self {
            octaves,
            better: improvement(losses(0.0), least),
            is_certain: worse(-1.0).min(worse(1.0)) > LIKELY,
        }
    }

    /// The factor if it is better with this Student's t, else 1. At the end of the range only a bound is
    /// known.
    fn judged(&self, significant: f32) -> f32 {
        let is_better = self.better > significant && self.octaves < LAST_OCTAVE;
        if is_better { self.octaves.exp2() } else { 1.0 }
    }
}

impl DistanceSearch<'_> {
    /// Finds the factor, RGB, on the light of lamp number `lamp` with which the depth of the shadows
    /// agrees best, and uses it from now on; 1 if no other is significantly better. `known` is the
    /// factor that is in the light already: the result times `known` is at least 1.
    pub fn find_factor(&mut self, lamp: usize, known: Vec3, colour: Colour) -> Vec3 {
        if self.by_lamp.get(lamp).is_none() {
            return Vec3::ONE;
        }
        // The places were found with it; now it is searched in finer steps, and judged.
        self.assumed[lamp] = 0.0;
        // Once a lamp is known to be too dark, its factor follows what is seen.
        let is_corrected = known.max_element() > 1.0;
        let significant = if is_corrected { 1.0 } else { LIKELY };
        let range = if is_corrected {
            [-1.0, 1.0]
        } else {
            [0.0, LAST_OCTAVE]
        };
        let (mut all, by_faces) = self.best_factor(lamp, range, significant);
        let is_hard = self.lamps[lamp].parts.len() == 1;
        let evened = is_hard && !by_faces && (is_corrected || all != 1.0);
        let evened = evened.then(|| self.evened(lamp, all)).flatten();
        all *= evened.unwrap_or(1.0);
        let mut found = Vec3::splat(all);
        if colour != Colour::Kept && (is_corrected || all != 1.0) {
            // The colour of clipped pixels is that of the camera's white.
            let is_first = colour == Colour::BestMatch;
            let significant = if is_first { f32::MIN } else { 1.0 };
            for channel in 0..3 {
                let start = (Vec3::splat(all), [-1.0, 1.0]);
                let best = self.search_factor(channel, lamp, start, by_faces);
                found[channel] *= best.judged(significant);
            }
            if evened.is_some() {
                // They tell the colour; the luminance is known better.
                let light = self.lamps[lamp].source.irradiance;
                let luminance = |factor: Vec3| (light * factor).dot(LUMINANCE);
                found *= luminance(Vec3::splat(all)) / luminance(found).max(1e-9);
            }
        }
        let found = found.max(known.recip());
        self.lamps[lamp].source.irradiance *= found;
        self.scale = self.texture_scale();
        found
    }

    /// Finds the factor on the light of several lamps together with which the depth of the shadows agrees
    /// best, at least `least`, and uses it from now on; 1 if no other is better. One by one, they would change
    /// little: less of one lamp is a larger share of the others.
    pub fn find_common_factor(&mut self, lamps: &[usize], least: f32) -> f32 {
        let mut others: Vec<f32> = self.rest.iter().map(|rest| rest[LUMINANCE_OF]).collect();
        let mut these = vec![0.0; others.len()];
        self.add_lamps(&mut others, LUMINANCE_OF, |k| !lamps.contains(&k));
        self.add_lamps(&mut these, LUMINANCE_OF, |k| lamps.contains(&k));
        let losses = |octaves: f32| {
            let factor = octaves.exp2();
            let sum = others
                .iter()
                .zip(&these)
                .map(|(others, these)| others + factor * these);
            let log: Vec<f32> = sum.map(|sum| sum.max(1e-9).ln()).collect();
            (octaves, self.losses_of(LUMINANCE_OF, &log))
        };
        let factor = searched(losses, [-1.0, 1.0]).judged(1.0).max(least);
        for lamp in lamps {
            self.lamps[*lamp].source.irradiance *= factor;
        }
        factor
    }

    /// Returns the factor, in addition to `start`, with which the depth of its shadows agrees on average;
    /// `None` if the least loss agrees with it.
    /// The least loss is that of most pairs of points, and those far apart see different parts of the sky.
    /// Only for hard shadows: beside soft ones, half of a pair may lie in the penumbra.
    fn evened(&self, lamp: usize, start: f32) -> Option<f32> {
        let light = self.lamps[lamp].source.irradiance * start;
        let with = |light: Vec3| {
            let other = (self.by_lamp[lamp].as_slice(), light);
            self.log_irradiance(LUMINANCE_OF, Some((lamp, other)))
        };
        let others = with(Vec3::ZERO);
        let at = |octaves: f32| self.agreement_with(&with(light * octaves.exp2()), &others);
        let differs = |a: SurfaceAgreement| a.difference.abs() > DIFFERS.max(3.0 * a.sigma);
        if !at(0.0).is_some_and(differs) {
            return None;
        }
        // Real shadows are deeper than predicted below the factor, and weaker above it.
        let (mut low, mut high) = (-EVENED, EVENED);
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            match at(middle) {
                Some(a) if a.difference > 0.0 => low = middle,
                Some(_) => high = middle,
                None => return None,
            }
        }
        Some((0.5 * (low + high)).exp2())
    }

    /// Returns the best factor within a range of octaves on the light of a lamp, 1 if it is not better
    /// with a Student's t of `significant`; and whether the faces of phantoms tell it, because shadows
    /// do not.
    fn best_factor(&self, lamp: usize, range: [f32; 2], significant: f32) -> (f32, bool) {
        let search =
            |with_faces| self.search_factor(LUMINANCE_OF, lamp, (Vec3::ONE, range), with_faces);
        let by_shadows = search(false);
        if by_shadows.better > significant || by_shadows.is_certain {
            return (by_shadows.judged(significant), false);
        }
        (search(true).judged(significant.min(LIKELY_BY_FACES)), true)
    }

    /// Finds the best factor within a range of octaves on the light of a lamp in a channel, in addition to
    /// `start`, by shadows alone or by faces, too.
    fn search_factor(
        &self,
        channel: usize,
        lamp: usize,
        (start, range): (Vec3, [f32; 2]),
        with_faces: bool,
    ) -> FoundFactor {
        let light = self.lamps[lamp].source.irradiance * start;
        let losses = |octaves: f32| {
            let other = (self.by_lamp[lamp].as_slice(), light * octaves.exp2());
            let log = self.log_irradiance(channel, Some((lamp, other)));
            let mut losses = self.losses_of(channel, &log);
            if with_faces {
                losses.extend(self.faces.losses(self.surfaces, channel, &log));
            }
            (octaves, losses)
        };
        searched(losses, range)
    }
}

/// The best factor within a range of octaves, by the losses there.
fn searched(losses: impl Fn(f32) -> (f32, Losses), [low, high]: [f32; 2]) -> FoundFactor {
    let steps = ((high - low) / OCTAVES[0]).round() as i32;
    let coarse = (0..=steps).map(|k| low + OCTAVES[0] * k as f32);
    let mut looked = vec![losses(0.0)];
    looked.extend(coarse.filter(|octaves| *octaves != 0.0).map(&losses));
    let around = best(&looked, 0.0);
    let fine = [-3, -2, -1, 1, 2, 3].map(|k| around + OCTAVES[1] * k as f32);
    looked.extend(fine.map(&losses));
    FoundFactor::of(&looked)
}
