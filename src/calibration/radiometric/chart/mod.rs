//! Finds ColorCheckers in a picture: 24 patches at any position, in any orientation and perspective.
//!
//! On a reduced picture (`level`), uniform parallelograms (`blobs`) in rows and columns (`lattice`)
//! are a chart if their colours are those of a ColorChecker in one of its eight orientations
//! (`placement`), for any white balance, exposure and contrast of the camera. Patches that were not
//! detected (black ones in the black frame, dark ones in a dark picture) follow from the others.
//! `patches` reads the colours of a chart.

mod blobs;
mod lattice;
mod level;
pub mod patches;
mod placement;

use blobs::blobs;
use glam::{DMat3, DVec2};
use lattice::{Lattice, apply};
use level::Level;
use penumbra_picture::Picture;
use placement::{Placement, best_placement};

/// A chart in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundChart {
    /// Homography from column and row to pixels; integers are centres of patches.
    picture_from_patch: DMat3,
    /// Share of the colours' variance that the chart explains, 0 to 1.
    pub explained: f64,
    /// Whether the chart is mirrored.
    pub mirrored: bool,
    /// Number of detected patches; the others follow from these.
    pub seen: usize,
}

/// Longer sides of the levels that are searched, pixels.
const LEVELS: [usize; 4] = [1000, 560, 320, 180];
/// Minimum share of the variance that a chart explains. Even raw sensor colours reach 0.7.
const MIN_EXPLAINED: f64 = 0.64;
/// Maximum ratio of the unexplained variance to that of the next best placement.
const MAX_RATIO: f64 = 0.8;
/// Maximum number of blobs from which a lattice is grown.
const MAX_SEEDS: usize = 400;

impl FoundChart {
    /// Returns the centre of patch `i` (row by row from dark skin), pixels.
    #[must_use]
    pub fn centre(&self, i: usize) -> DVec2 {
        apply(&self.picture_from_patch, column_and_row(i))
    }

    /// Returns the corners of the part of patch `i` within `half` pitches of its centre, in order,
    /// pixels.
    #[must_use]
    pub fn corners(&self, i: usize, half: f64) -> [DVec2; 4] {
        let around = [(-half, -half), (half, -half), (half, half), (-half, half)];
        around.map(|d| apply(&self.picture_from_patch, column_and_row(i) + DVec2::from(d)))
    }

    /// Returns the chart translated by `offset` pixels.
    #[must_use]
    pub fn shifted(&self, offset: DVec2) -> Self {
        Self {
            picture_from_patch: DMat3::from_translation(offset) * self.picture_from_patch,
            ..self.clone()
        }
    }

    /// Returns the distance of neighbouring patches at the chart's centre, pixels.
    #[must_use]
    pub fn pitch(&self) -> f64 {
        let at = |x, y| apply(&self.picture_from_patch, DVec2::new(x, y));
        let (a, b, c) = (at(2.0, 1.5), at(3.0, 1.5), at(2.0, 2.5));
        a.distance(b).min(a.distance(c))
    }
}

fn column_and_row(i: usize) -> DVec2 {
    DVec2::new((i % 6) as f64, (i / 6) as f64)
}

/// Finds every chart in `picture`, largest first.
#[must_use]
pub fn find_charts(picture: &Picture) -> Vec<FoundChart> {
    let mut found: Vec<FoundChart> = Vec::new();
    let mut factors = Vec::new();
    for longest in LEVELS {
        let level = Level::new(picture, longest);
        if factors.contains(&level.factor) || level.width < 16 || level.height < 16 {
            continue;
        }
        factors.push(level.factor);
        for chart in in_level(&level.blurred()) {
            match found.iter_mut().find(|f| overlap(f, &chart)) {
                Some(same) if better(&chart, same) => *same = chart,
                Some(_) => {}
                None => found.push(chart),
            }
        }
    }
    found.sort_by(|a, b| b.pitch().total_cmp(&a.pitch()));
    found
}

fn better(a: &FoundChart, b: &FoundChart) -> bool {
    (a.seen, a.explained) > (b.seen, b.explained)
}

fn overlap(a: &FoundChart, b: &FoundChart) -> bool {
    let centre = |chart: &FoundChart| apply(&chart.picture_from_patch, DVec2::new(2.5, 1.5));
    centre(a).distance(centre(b)) < 3.0 * a.pitch().max(b.pitch())
}

fn in_level(level: &Level) -> Vec<FoundChart> {
    let blobs = blobs(level);
    let mut used = vec![false; blobs.len()];
    let mut charts = Vec::new();
    for seed in 0..blobs.len().min(MAX_SEEDS) {
        if used[seed] {
            continue;
        }
        let Some(lattice) = Lattice::grow(&blobs, seed) else {
            continue;
        };
        for &(_, blob) in &lattice.cells {
            used[blob] = true;
        }
        charts.extend(best_placement(level, &lattice).and_then(|p| chart(&lattice, &p)));
    }
    charts
}

fn chart(lattice: &Lattice, placement: &Placement) -> Option<FoundChart> {
    let unexplained = |explained: f64| 1.0 - explained;
    let is_chart = placement.explained >= MIN_EXPLAINED
        && unexplained(placement.explained) < MAX_RATIO * unexplained(placement.runner_up);
    is_chart.then(|| FoundChart {
        picture_from_patch: lattice.map * placement.cell_from_patch,
        explained: placement.explained,
        mirrored: placement.mirrored,
        seen: placement.seen,
    })
}

#[cfg(test)]
mod tests;
