//! A ColorChecker found in a picture: 24 patches, anywhere, turned and in perspective.
//!
//! Even parts of a parallelogram's shape (`blobs`) that lie in rows and columns (`lattice`)
//! are a chart if their colours are those of a ColorChecker in one of the eight ways to lay it
//! there (`place`), whatever white balance, exposure and contrast the camera has. Patches that
//! were not seen (black ones before the black frame, dark ones in a dark picture) follow from
//! the others.

mod blobs;
mod lattice;
mod level;
pub mod patches;
mod place;

use blobs::blobs;
use glam::{DMat3, DVec2};
use lattice::{Lattice, apply};
use level::Level;
use penumbra_picture::Picture;
use place::{Placement, place};

/// A chart in a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundChart {
    /// Pixel of column and row, where whole numbers are middles of patches.
    picture_from_patch: DMat3,
    /// Share of the colours' differences that it explains, 0 to 1.
    pub explained: f64,
    /// Seen in a mirror.
    pub mirrored: bool,
    /// Patches seen as such; the others follow from these.
    pub seen: usize,
}

/// Longer sides of the levels that are searched, pixels.
const LEVELS: [usize; 4] = [1000, 560, 320, 180];
/// Below this the colours are not those of a chart. Even a sensor's own colours, before any matrix
/// or white balance, explain seven tenths.
const EXPLAINED: f64 = 0.64;
/// The next best way to lay the chart must be worse by this part of what is not explained.
const AHEAD: f64 = 0.8;
/// Blobs from which a lattice is grown, at most.
const SEEDS: usize = 400;

impl FoundChart {
    /// Middle of patch `i` (row after row from dark skin), pixels.
    #[must_use]
    pub fn middle(&self, i: usize) -> DVec2 {
        apply(&self.picture_from_patch, column_and_row(i))
    }

    /// Corners of the part of patch `i` within `half` pitches of its middle, in order around.
    #[must_use]
    pub fn corners(&self, i: usize, half: f64) -> [DVec2; 4] {
        let around = [(-half, -half), (half, -half), (half, half), (-half, half)];
        around.map(|d| apply(&self.picture_from_patch, column_and_row(i) + DVec2::from(d)))
    }

    /// The same chart in a picture of which a part was taken, or that was moved, by `offset`.
    #[must_use]
    pub fn shifted(&self, offset: DVec2) -> Self {
        Self {
            picture_from_patch: DMat3::from_translation(offset) * self.picture_from_patch,
            ..self.clone()
        }
    }

    /// Distance of neighbouring patches in the middle of the chart, pixels.
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

/// Every chart in `picture`, the largest first.
#[must_use]
pub fn find_charts(picture: &Picture) -> Vec<FoundChart> {
    let mut found: Vec<FoundChart> = Vec::new();
    let mut factors = Vec::new();
    for longest in LEVELS {
        let level = Level::of(picture, longest);
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
    let middle = |chart: &FoundChart| apply(&chart.picture_from_patch, DVec2::new(2.5, 1.5));
    middle(a).distance(middle(b)) < 3.0 * a.pitch().max(b.pitch())
}

fn in_level(level: &Level) -> Vec<FoundChart> {
    let blobs = blobs(level);
    let mut used = vec![false; blobs.len()];
    let mut charts = Vec::new();
    for seed in 0..blobs.len().min(SEEDS) {
        if used[seed] {
            continue;
        }
        let Some(lattice) = Lattice::grow(&blobs, seed) else {
            continue;
        };
        for &(_, blob) in &lattice.cells {
            used[blob] = true;
        }
        charts.extend(place(level, &lattice).and_then(|p| chart_of(&lattice, &p)));
    }
    charts
}

fn chart_of(lattice: &Lattice, placement: &Placement) -> Option<FoundChart> {
    let rest = |explained: f64| 1.0 - explained;
    let sure = placement.explained >= EXPLAINED
        && rest(placement.explained) < AHEAD * rest(placement.runner_up);
    sure.then(|| FoundChart {
        picture_from_patch: lattice.map * placement.cell_from_patch,
        explained: placement.explained,
        mirrored: placement.mirrored,
        seen: placement.seen,
    })
}

#[cfg(test)]
mod tests;
