//! From linked saddles to rows and columns (Shu, Brunton & Fiala 2009: by neighbourhood, not
//! by geometry, so that no distortion is too strong).

use super::links::Links;
use super::saddles::Saddle;
use glam::{DVec2, IVec2};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Corners by column and row, +X rightwards and +Y downwards as seen (not mirrored); the
/// origin is arbitrary.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Grid {
    pub corners: BTreeMap<(i32, i32), DVec2>,
    /// The sector between +column and +row of the corner (0, 0) is bright; neighbours
    /// alternate.
    pub bright_origin: bool,
}

impl Grid {
    /// Columns and rows over which it extends.
    pub fn extent(&self) -> (i32, i32) {
        let (low, high) = self.bounds();
        (high.x - low.x + 1, high.y - low.y + 1)
    }

    /// Least and greatest column and row.
    pub fn bounds(&self) -> (IVec2, IVec2) {
        self.corners
            .keys()
            .fold((IVec2::MAX, IVec2::MIN), |(low, high), &(i, j)| {
                let at = IVec2::new(i, j);
                (low.min(at), high.max(at))
            })
    }

    /// Of its squares in the picture, square pixels.
    pub fn area(&self) -> f64 {
        let corner = |i: i32, j: i32| self.corners.get(&(i, j)).copied();
        let square = |(&(i, j), &p): (&(i32, i32), &DVec2)| {
            let (q, r) = (corner(i + 1, j)?, corner(i, j + 1)?);
            Some((q - p).perp_dot(r - p).abs())
        };
        self.corners.iter().filter_map(square).sum()
    }

    /// Where a line of two known corners leads, and how far apart these are.
    pub fn extrapolated(&self, (i, j): (i32, i32), step: IVec2) -> Option<(DVec2, f64)> {
        let corner = |n: i32| self.corners.get(&(i + n * step.x, j + n * step.y)).copied();
        let (a, b) = (corner(1)?, corner(2)?);
        let straight = a * 2.0 - b;
        let curved = corner(3).map_or(straight, |c| straight + (a - b * 2.0 + c));
        Some((curved, a.distance(b)))
    }

    /// Without what an edge in the background joined: corners that no line through others
    /// leads to, that are part of no square, or that are cut off from the rest.
    fn pruned(mut self) -> Self {
        loop {
            let before = self.corners.len();
            let doubted = self.clone();
            self.corners
                .retain(|&at, p| doubted.is_foretold(at, *p) && doubted.is_of_a_square(at));
            if self.corners.len() == before {
                return self.largest_piece();
            }
        }
    }

    fn is_foretold(&self, at: (i32, i32), p: DVec2) -> bool {
        STEPS
            .iter()
            .filter_map(|&step| self.extrapolated(at, step))
            .any(|(q, pitch)| q.distance(p) < STRAIGHT * pitch)
    }

    fn is_of_a_square(&self, (i, j): (i32, i32)) -> bool {
        let has = |i: i32, j: i32| self.corners.contains_key(&(i, j));
        [(1, 1), (1, -1), (-1, 1), (-1, -1)]
            .iter()
            .any(|(di, dj)| has(i + di, j) && has(i, j + dj) && has(i + di, j + dj))
    }

    /// The most corners that hang together.
    fn largest_piece(mut self) -> Self {
        let mut best = BTreeMap::new();
        while let Some((&seed, _)) = self.corners.first_key_value() {
            let mut piece = BTreeMap::new();
            let mut open = vec![seed];
            while let Some((i, j)) = open.pop() {
                if let Some(p) = self.corners.remove(&(i, j)) {
                    piece.insert((i, j), p);
                    open.extend(STEPS.map(|s| (i + s.x, j + s.y)));
                }
            }
            if piece.len() > best.len() {
                best = piece;
            }
        }
        self.corners = best;
        self
    }

    /// The sector between +column and +row of this corner is bright.
    pub const fn is_bright(&self, (i, j): (i32, i32)) -> bool {
        self.bright_origin == ((i + j) % 2 == 0)
    }
}

/// A corner may be off the line through its neighbours by this share of their distance;
/// lenses and perspective bend lines less.
const STRAIGHT: f64 = 0.25;

/// The grid that covers most of the picture, or an empty one: around a board there are finer
/// grids, such as a keyboard, but few larger ones.
pub(super) fn largest(saddles: &[Saddle], links: &Links) -> Grid {
    let mut used = vec![false; saddles.len()];
    let mut best = Grid::default();
    for seed in 0..saddles.len() {
        // Saddles come strongest first; a corner of a grid has two links at least.
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

/// Walks all links from a seed. A saddle that two ways lead to at different places, and a
/// place that two saddles claim, are left out.
fn grow(saddles: &[Saddle], links: &Links, seed: usize, used: &mut [bool]) -> Grid {
    // Of each saddle: its place, and which of its edges is +column. Edges are in the order
    // of rising angles, so +row is the next one.
    let mut place: BTreeMap<usize, (IVec2, usize)> = BTreeMap::new();
    let mut doubtful: BTreeSet<usize> = BTreeSet::new();
    let mut queue = VecDeque::from([seed]);
    place.insert(seed, (IVec2::ZERO, 0));
    while let Some(i) = queue.pop_front() {
        used[i] = true;
        let (at, first) = place[&i];
        for step in 0..4 {
            let Some((j, back)) = links[i][(first + step) % 4] else {
                continue;
            };
            // The edge that leads back is the opposite of this step.
            let next = (at + STEPS[step], (back + 4 - (step + 2) % 4) % 4);
            match place.get(&j) {
                None => {
                    place.insert(j, next);
                    queue.push_back(j);
                }
                Some(known) if *known != next => {
                    doubtful.insert(j);
                }
                Some(_) => {}
            }
        }
    }
    let mut grid = Grid {
        corners: BTreeMap::new(),
        bright_origin: saddles[seed].bright_first,
    };
    let mut claimed_twice = BTreeSet::new();
    for (i, (at, _)) in place.iter().filter(|(i, _)| !doubtful.contains(i)) {
        if grid.corners.insert((at.x, at.y), saddles[*i].at).is_some() {
            claimed_twice.insert((at.x, at.y));
        }
    }
    grid.corners.retain(|at, _| !claimed_twice.contains(at));
    grid
}

/// +column, +row, −column, −row.
pub(super) const STEPS: [IVec2; 4] = [IVec2::X, IVec2::Y, IVec2::NEG_X, IVec2::NEG_Y];
