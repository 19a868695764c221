//! Orders linked saddles in rows and columns by topology instead of geometry, so that any
//! distortion is permitted (Shu, Brunton & Fiala 2009).

use super::links::Links;
use super::saddles::Saddle;
use glam::{DVec2, IVec2};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Corners by column and row, with the handedness of the picture (+X right, +Y down; not mirrored);
/// the origin is arbitrary.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Grid {
    pub corners: BTreeMap<(i32, i32), DVec2>,
    /// The sector between +column and +row of the corner (0, 0) is bright; it alternates between
    /// neighbours.
    pub is_origin_bright: bool,
}

impl Grid {
    /// Returns the number of columns and rows.
    pub fn extent(&self) -> (i32, i32) {
        let (low, high) = self.bounds();
        (high.x - low.x + 1, high.y - low.y + 1)
    }

    /// Returns the minimum and maximum column and row.
    pub fn bounds(&self) -> (IVec2, IVec2) {
        self.corners
            .keys()
            .fold((IVec2::MAX, IVec2::MIN), |(low, high), &(i, j)| {
                let at = IVec2::new(i, j);
                (low.min(at), high.max(at))
            })
    }

    /// Returns the area of its squares in the picture, square pixels.
    pub fn area(&self) -> f64 {
        let corner = |i: i32, j: i32| self.corners.get(&(i, j)).copied();
        let square = |(&(i, j), &p): (&(i32, i32), &DVec2)| {
            let (q, r) = (corner(i + 1, j)?, corner(i, j + 1)?);
            Some((q - p).perp_dot(r - p).abs())
        };
        self.corners.iter().filter_map(square).sum()
    }

    /// Extrapolates a line of known corners to a grid position; also returns their distance,
    /// pixels.
    pub fn extrapolated(&self, (i, j): (i32, i32), step: IVec2) -> Option<(DVec2, f64)> {
        let corner = |n: i32| self.corners.get(&(i + n * step.x, j + n * step.y)).copied();
        let (a, b) = (corner(1)?, corner(2)?);
        let straight = a * 2.0 - b;
        let curved = corner(3).map_or(straight, |c| straight + (a - b * 2.0 + c));
        Some((curved, a.distance(b)))
    }

    /// Removes corners of the background that an edge joined to the board: corners that are on no
    /// line through others, belong to no square, or are disconnected from the rest.
    fn pruned(mut self) -> Self {
        loop {
            let before = self.corners.len();
            let previous = self.clone();
            self.corners
                .retain(|&at, p| previous.is_on_line(at, *p) && previous.is_in_square(at));
            if self.corners.len() == before {
                return self.largest_component();
            }
        }
    }

    fn is_on_line(&self, at: (i32, i32), p: DVec2) -> bool {
        STEPS
            .iter()
            .filter_map(|&step| self.extrapolated(at, step))
            .any(|(q, pitch)| q.distance(p) < MAX_DEVIATION * pitch)
    }

    fn is_in_square(&self, (i, j): (i32, i32)) -> bool {
        let has = |i: i32, j: i32| self.corners.contains_key(&(i, j));
        [(1, 1), (1, -1), (-1, 1), (-1, -1)]
            .iter()
            .any(|(di, dj)| has(i + di, j) && has(i, j + dj) && has(i + di, j + dj))
    }

    /// Returns the largest connected component.
    fn largest_component(mut self) -> Self {
        let mut best = BTreeMap::new();
        while let Some((&seed, _)) = self.corners.first_key_value() {
            let mut component = BTreeMap::new();
            let mut open = vec![seed];
            while let Some((i, j)) = open.pop() {
                if let Some(p) = self.corners.remove(&(i, j)) {
                    component.insert((i, j), p);
                    open.extend(STEPS.map(|s| (i + s.x, j + s.y)));
                }
            }
            if component.len() > best.len() {
                best = component;
            }
        }
        self.corners = best;
        self
    }

    /// Returns whether the sector between +column and +row of this corner is bright.
    pub const fn is_bright(&self, (i, j): (i32, i32)) -> bool {
        self.is_origin_bright == ((i + j) % 2 == 0)
    }
}

/// Maximum deviation of a corner from the line through its neighbours, as a share of their
/// distance; lenses and perspective bend lines less.
const MAX_DEVIATION: f64 = 0.25;

/// Returns the grid with the largest area, or an empty one: the surroundings of a board may contain
/// finer grids, e.g. a keyboard, but seldom larger ones.
pub(super) fn largest(saddles: &[Saddle], links: &Links) -> Grid {
    let mut used = vec![false; saddles.len()];
    let mut best = Grid::default();
    for seed in 0..saddles.len() {
        // Saddles are sorted, strongest first; a corner of a grid has at least two links.
        let degree = links[seed].iter().flatten().count();
        if used[seed] || degree < 2 {
            continue;
        }
        let grid = grow(saddles, links, seed, &mut used).pruned();
        if grid.area() > best.area() {
            best = grid;
        }
    }
    best
}

/// Follows all links from a seed. Excludes saddles that two paths assign to different grid
/// positions, and positions that two saddles claim.
fn grow(saddles: &[Saddle], links: &Links, seed: usize, used: &mut [bool]) -> Grid {
    // For each saddle its grid position and the index of its edge towards +column. Edges are in
    // ascending order of angle, so +row is the next edge.
    let mut positions: BTreeMap<usize, (IVec2, usize)> = BTreeMap::new();
    let mut ambiguous: BTreeSet<usize> = BTreeSet::new();
    let mut queue = VecDeque::from([seed]);
    positions.insert(seed, (IVec2::ZERO, 0));
    while let Some(i) = queue.pop_front() {
        used[i] = true;
        let (at, first) = positions[&i];
        for step in 0..4 {
            let Some((j, back)) = links[i][(first + step) % 4] else {
                continue;
            };
            // The edge that leads back is opposite to this step.
            let next = (at + STEPS[step], (back + 4 - (step + 2) % 4) % 4);
            match positions.get(&j) {
                None => {
                    positions.insert(j, next);
                    queue.push_back(j);
                }
                Some(known) if *known != next => {
                    ambiguous.insert(j);
                }
                Some(_) => {}
            }
        }
    }
    let mut grid = Grid {
        corners: BTreeMap::new(),
        is_origin_bright: saddles[seed].is_first_bright,
    };
    let mut claimed_twice = BTreeSet::new();
    for (i, (at, _)) in positions.iter().filter(|(i, _)| !ambiguous.contains(i)) {
        if grid.corners.insert((at.x, at.y), saddles[*i].at).is_some() {
            claimed_twice.insert((at.x, at.y));
        }
    }
    grid.corners.retain(|at, _| !claimed_twice.contains(at));
    grid
}

/// +column, +row, −column, −row.
pub(super) const STEPS: [IVec2; 4] = [IVec2::X, IVec2::Y, IVec2::NEG_X, IVec2::NEG_Y];
