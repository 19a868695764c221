//! How well the light that is estimated explains the shadows and the shading of real surfaces.

use super::{DistanceSearch, LUMINANCE_OF};
use std::collections::BTreeMap;

/// Distance of the compared points, in points of the grid: beyond penumbras, within one shadow.
const OFFSET: [usize; 1] = [3];
/// Least difference of the logarithms of the predicted irradiance: half-light and noise tell nothing.
const CONTRAST: f32 = 0.25;
/// Difference of the logarithms of all other light up to which a pair tells of one lamp.
const EVEN: f32 = 0.1;
/// Change of the logarithm between a compared point and one beside it, relative to that of the pair, from which
/// the point may lie on an edge: its luminance is averaged over both sides.
const AT_EDGE: f32 = 0.5;
/// Least number of pairs in a part of the picture, and of parts that show a surface.
const MIN_PAIRS: u32 = 6;
const MIN_BLOCKS: u32 = 3;
/// Limit of the difference of a pair: texture must not dominate.
const LIMIT: f32 = 1.0;

/// How well the light explains what is seen of a surface where the light on it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceAgreement {
    /// Which surface, as in [`SurfacePoint::surface`](super::SurfacePoint).
    pub surface: u32,
    /// Mean of ln(contrast in the picture) − ln(predicted contrast) across shadow edges and shading:
    /// positive where real shadows are deeper than predicted.
    pub difference: f32,
    /// Its standard error, from the differences between parts of the picture.
    pub sigma: f32,
    /// Number of pairs of points.
    pub pairs: u32,
}

impl DistanceSearch<'_> {
    /// Compares neighbouring points of each surface where the predicted luminance differs much. Surfaces
    /// that show no such place are left out.
    #[must_use]
    pub fn agreement(&self) -> Vec<SurfaceAgreement> {
        let log = self.log_irradiance(LUMINANCE_OF, None);
        let blocks = self.differences(&log, |_, _| true);
        let mut surfaces: Vec<u32> = blocks.keys().map(|(surface, _)| *surface).collect();
        surfaces.dedup();
        let of = |surface: u32| {
            let blocks = blocks.range((surface, 0)..=(surface, usize::MAX));
            summary(surface, blocks.map(|(_, block)| *block))
        };
        surfaces.into_iter().filter_map(of).collect()
    }

    /// The agreement of all surfaces together with these logarithms of the luminance that arrives, where
    /// that without a lamp, `others`, hardly changes.
    pub(super) fn agreement_with(&self, log: &[f32], others: &[f32]) -> Option<SurfaceAgreement> {
        let is_even = |i: usize, k: usize| (others[i] - others[k]).abs() < EVEN;
        let blocks = self.differences(log, is_even);
        summary(0, blocks.values().copied())
    }

    /// By surface and part of the picture, the number of pairs that count and the sum of their differences.
    fn differences(
        &self,
        log: &[f32],
        counts: impl Fn(usize, usize) -> bool,
    ) -> BTreeMap<(u32, usize), (u32, f32)> {
        let mut blocks: BTreeMap<(u32, usize), (u32, f32)> = BTreeMap::new();
        self.every_two(&OFFSET, |i, k, p, q| {
            let predicted = log[i] - log[k];
            let is_clear = || {
                let most = AT_EDGE * predicted.abs();
                self.is_away_from_edges(i, log, most) && self.is_away_from_edges(k, log, most)
            };
            if predicted.abs() > CONTRAST && counts(i, k) && is_clear() {
                let seen = p.log_values[LUMINANCE_OF] - q.log_values[LUMINANCE_OF];
                let difference = predicted.signum() * (seen - predicted);
                let block = blocks.entry((p.surface, self.block(i))).or_default();
                block.0 += 1;
                block.1 += difference.clamp(-LIMIT, LIMIT);
            }
        });
        blocks.retain(|_, (pairs, _)| *pairs >= MIN_PAIRS);
        blocks
    }

    /// Whether the logarithm of what arrives changes by no more than `most` from a point to those beside it
    /// on its surface.
    fn is_away_from_edges(&self, i: usize, log: &[f32], most: f32) -> bool {
        let points = &self.surfaces.points;
        let changes = |k: usize| match (points[i], points.get(k)) {
            (Some(p), Some(Some(q))) => q.is_beside(&p) && (log[k] - log[i]).abs() > most,
            _ => false,
        };
        !self.beside(i).into_iter().flatten().any(changes)
    }
}

/// The mean of the parts of the picture that show a surface, by their numbers of pairs.
fn summary(
    surface: u32,
    blocks: impl Iterator<Item = (u32, f32)> + Clone,
) -> Option<SurfaceAgreement> {
    let count = blocks.clone().count() as u32;
    if count < MIN_BLOCKS {
        return None;
    }
    let pairs: u32 = blocks.clone().map(|(pairs, _)| pairs).sum();
    let difference = blocks.clone().map(|(_, sum)| sum).sum::<f32>() / pairs as f32;
    let squares = blocks.map(|(n, sum)| (sum - n as f32 * difference).powi(2));
    let sigma =
        squares.sum::<f32>().sqrt() / pairs as f32 * (count as f32 / (count - 1) as f32).sqrt();
    Some(SurfaceAgreement {
        surface,
        difference,
        sigma,
        pairs,
    })
}
