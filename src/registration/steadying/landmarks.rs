//! The landmarks that are followed.

use super::Surfaces;
use super::adjustment::{Adjustment, Sighting, adjust};
use super::corners::CornerGrid;
use super::landmark::{Landmark, View};
use super::luminance::Luminance;

/// Maximum number of landmarks.
const MAX_LANDMARKS: usize = 96;
/// Successive pictures in which a landmark may be missed.
const MAX_MISSES: u32 = 3;
/// Cells in which landmarks are looked for in a picture, beyond the first.
const CELLS_PER_PICTURE: usize = 16;
/// Least number of landmarks that agree with a pose.
const MIN_AGREEING: usize = 10;
/// Least share of the landmarks found that agree.
const MIN_SHARE: f64 = 0.5;
/// Largest scale of the residuals, in standard deviations, and their largest median, pixels.
const MAX_SCALE: f64 = 6.0;
const MAX_MEDIAN: f64 = 0.5;

/// A pose to which enough landmarks agree.
#[derive(Clone, Copy)]
pub(super) struct Agreement {
    pub adjustment: Adjustment,
    /// Number of landmarks that agree.
    pub count: usize,
}

/// Landmarks, at most one in each cell of a grid over the picture when they are made.
#[derive(Clone, Debug)]
pub(super) struct Landmarks {
    grid: CornerGrid,
    all: Vec<Landmark>,
    sightings: Vec<Sighting>,
    scratch: Vec<f64>,
    /// Whether a cell of the grid holds a landmark.
    occupied: Vec<bool>,
    /// The cell that is looked at next.
    turn: usize,
}

impl Landmarks {
    /// Creates none, for pictures of `size` pixels.
    pub fn new(size: [u32; 2]) -> Self {
        let grid = CornerGrid::new(size);
        Self {
            occupied: vec![false; grid.len()],
            grid,
            all: Vec::with_capacity(MAX_LANDMARKS),
            sightings: Vec::with_capacity(MAX_LANDMARKS),
            scratch: Vec::with_capacity(MAX_LANDMARKS),
            turn: 0,
        }
    }

    pub const fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    pub fn clear(&mut self) {
        self.all.clear();
    }

    /// Begins as new.
    pub fn restart(&mut self) {
        self.clear();
        self.turn = 0;
    }

    /// Finds the landmarks in a picture and adjusts its expected pose, whose standard deviations are
    /// `sigmas` (radians, metres). `None` unless enough of them agree.
    pub fn locate(
        &mut self,
        picture: &Luminance,
        expected: &View<'_>,
        sigmas: [f64; 2],
    ) -> Option<Agreement> {
        self.sightings.clear();
        let all = self.all.iter().enumerate();
        let found = all.filter_map(|(i, landmark)| landmark.find(i, picture, expected));
        self.sightings.extend(found);
        let adjustment = adjust(&self.sightings, sigmas, &mut self.scratch)?;
        let count = self.note_misses(&adjustment);
        let is_enough = count >= MIN_AGREEING
            && count as f64 >= MIN_SHARE * self.sightings.len() as f64
            && adjustment.scale <= MAX_SCALE
            && adjustment.pixels <= MAX_MEDIAN;
        if !is_enough {
            return None;
        }
        for sighting in &self.sightings {
            self.all[sighting.landmark].note(adjustment.residual(sighting));
        }
        Some(Agreement { adjustment, count })
    }

    /// Notes which landmarks were missed; returns the number of those that agree.
    fn note_misses(&mut self, adjustment: &Adjustment) -> usize {
        for landmark in &mut self.all {
            landmark.misses += 1;
        }
        let agrees = |s: &&Sighting| adjustment.agrees(adjustment.residual(s));
        let mut agreeing = 0;
        for sighting in self.sightings.iter().filter(agrees) {
            self.all[sighting.landmark].misses = 0;
            agreeing += 1;
        }
        agreeing
    }

    /// Drops landmarks that are out of sight or were missed too often, and makes new ones in some of
    /// the cells without any; in all if there are none.
    pub fn renew(&mut self, picture: &Luminance, view: &View<'_>, surfaces: &Surfaces<'_>) {
        let cells = if self.all.is_empty() {
            self.grid.len()
        } else {
            CELLS_PER_PICTURE.min(self.grid.len())
        };
        self.occupied.fill(false);
        let (grid, occupied) = (&mut self.grid, &mut self.occupied);
        self.all.retain(|landmark| {
            let place = landmark.predict(view).map(|(place, _)| place);
            let place = place.filter(|p| picture.contains(*p, 1.0));
            let cell = place.and_then(|p| grid.cell_of([p.x as usize, p.y as usize]));
            if let Some(cell) = cell {
                occupied[cell] = true;
            }
            cell.is_some() && landmark.misses < MAX_MISSES
        });
        for _ in 0..cells {
            if self.all.len() >= MAX_LANDMARKS {
                return;
            }
            let cell = self.turn;
            self.turn = (self.turn + 1) % grid.len();
            if occupied[cell] {
                continue;
            }
            let corner = grid.best_in(picture, cell);
            let new = corner.and_then(|c| Landmark::new(picture, c, view, surfaces));
            self.all.extend(new);
        }
    }
}
