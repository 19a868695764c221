//! Regions arranged in rows and columns, in perspective.

use super::blobs::Blob;
use crate::intrinsics::homography::from_rays;
use glam::{DMat2, DMat3, DVec2, DVec3, IVec2};

/// Arrangement of a chart's patches in a picture.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// Homography from rows and columns to the picture.
    pub map: DMat3,
    /// Cells with their blobs.
    pub cells: Vec<(IVec2, usize)>,
}

/// Distance of neighbouring patches, in sides of the region found (a patch without its edge).
const PITCH: std::ops::Range<f64> = 1.0..2.4;
/// Maximum cosine of the angle between two axes, with the seed mapped to a square.
const MAX_COSINE: f64 = 0.35;
/// Maximum distance of a blob from the expected position of a patch, in pitches.
const MAX_DISTANCE: f64 = 0.25;
/// Ratios of areas of patches in one chart.
const AREA_RATIO: std::ops::Range<f64> = 0.3..3.3;
/// Minimum number of patches that identify a chart.
const MIN_PATCHES: usize = 11;
/// Maximum number of rows or columns from the seed in each direction.
const MAX_STEPS: i32 = 7;

impl Lattice {
    /// Returns the centre of cell `c`, pixels.
    pub fn centre(&self, c: DVec2) -> DVec2 {
        apply(&self.map, c)
    }

    /// Grows a lattice from blob `seed`; `None` if there are too few blobs around it.
    pub fn grow(blobs: &[Blob], seed: usize) -> Option<Self> {
        pairs(blobs, seed)
            .into_iter()
            .filter_map(|axes| follow(blobs, seed, axes))
            .filter(|lattice| lattice.cells.len() >= MIN_PATCHES)
            .max_by_key(|lattice| lattice.cells.len())
    }
}

/// Applies a homography to a point.
pub(super) fn apply(map: &DMat3, p: DVec2) -> DVec2 {
    let q = *map * p.extend(1.0);
    q.truncate() / q.z
}

/// Returns pairs of steps to two neighbours of `seed` that are orthogonal and of equal length when
/// the seed is mapped to a square.
fn pairs(blobs: &[Blob], seed: usize) -> Vec<[DVec2; 2]> {
    let own = blobs[seed];
    let Some(square) = square_from(own.spread) else {
        return Vec::new();
    };
    let mut steps: Vec<(DVec2, DVec2)> = blobs
        .iter()
        .filter(|b| AREA_RATIO.contains(&(b.area / own.area)))
        .map(|b| (b.centre - own.centre, square * (b.centre - own.centre)))
        .filter(|(_, s)| PITCH.contains(&s.length()))
        .collect();
    steps.sort_by(|a, b| a.1.length().total_cmp(&b.1.length()));
    steps.truncate(8);
    let mut pairs = Vec::new();
    for (i, a) in steps.iter().enumerate() {
        for b in &steps[i + 1..] {
            let (la, lb) = (a.1.length(), b.1.length());
            let cosine = a.1.dot(b.1) / (la * lb);
            if cosine.abs() < MAX_COSINE && la / lb > 0.75 && lb / la > 0.75 {
                pairs.push([a.0, b.0]);
            }
        }
    }
    pairs
}

/// Returns the map from a parallelogram with these moments to a square of side 1.
fn square_from(spread: DMat2) -> Option<DMat2> {
    // Σ = L Lᵀ; a square of side 1 has Σ = I / 12.
    let a = spread.x_axis.x.sqrt();
    let b = spread.x_axis.y / a;
    let c = (spread.y_axis.y - b * b).sqrt();
    let l = DMat2::from_cols_array(&[a, b, 0.0, c]);
    let map = l.inverse() * 12f64.sqrt().recip();
    map.is_finite().then_some(map)
}

/// Grows a lattice along two axes.
fn follow(blobs: &[Blob], seed: usize, axes: [DVec2; 2]) -> Option<Lattice> {
    let mut cells = vec![(IVec2::ZERO, seed, axes)];
    let mut next = 0;
    while next < cells.len() && cells.len() < 64 {
        let (cell, from, axes) = cells[next];
        next += 1;
        for step in [IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y] {
            let to = cell + step;
            if to.abs().max_element() > MAX_STEPS || cells.iter().any(|c| c.0 == to) {
                continue;
            }
            let expected = axes[0] * f64::from(step.x) + axes[1] * f64::from(step.y);
            let Some(found) = nearest(blobs, from, expected) else {
                continue;
            };
            if cells.iter().any(|c| c.1 == found) {
                continue;
            }
            // Perspective changes the axes slowly from patch to patch.
            let step_found = blobs[found].centre - blobs[from].centre;
            let mut updated = axes;
            let axis = usize::from(step.x == 0);
            let sign = f64::from(step.x + step.y);
            updated[axis] = 0.5 * (axes[axis] + sign * step_found);
            cells.push((to, found, updated));
        }
    }
    let cells = cells.into_iter().map(|(cell, blob, _)| (cell, blob));
    fitted(blobs, cells.collect())
}

fn nearest(blobs: &[Blob], from: usize, step: DVec2) -> Option<usize> {
    let expected = blobs[from].centre + step;
    let near = (MAX_DISTANCE * step.length()).powi(2);
    let close = blobs.iter().enumerate().filter(|(_, b)| {
        b.centre.distance_squared(expected) < near
            && AREA_RATIO.contains(&(b.area / blobs[from].area))
    });
    let distance = |b: &Blob| b.centre.distance_squared(expected);
    close
        .min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))
        .map(|(i, _)| i)
}

/// Fits the homography, removing cells that do not fit it and adding blobs that do.
fn fitted(blobs: &[Blob], mut cells: Vec<(IVec2, usize)>) -> Option<Lattice> {
    for _ in 0..3 {
        if cells.len() < MIN_PATCHES {
            return None;
        }
        let map = homography(blobs, &cells)?;
        let distance = |&(cell, blob): &(IVec2, usize)| {
            let c = cell.as_dvec2();
            let (x, y) = (apply(&map, c + DVec2::X), apply(&map, c + DVec2::Y));
            let at = apply(&map, c);
            let pitch = x.distance(at).min(y.distance(at));
            blobs[blob].centre.distance(at) / pitch
        };
        let before = cells.len();
        cells.retain(|cell| distance(cell) < MAX_DISTANCE);
        add_expected(blobs, &map, &mut cells);
        if cells.len() == before {
            break;
        }
    }
    let map = homography(blobs, &cells)?;
    Some(Lattice { map, cells })
}

/// Adds blobs at most one step beyond the known cells.
fn add_expected(blobs: &[Blob], map: &DMat3, cells: &mut Vec<(IVec2, usize)>) {
    let known: Vec<IVec2> = cells.iter().map(|c| c.0).collect();
    let Some((low, high)) = bounds(&known) else {
        return;
    };
    for y in low.y - 1..=high.y + 1 {
        for x in low.x - 1..=high.x + 1 {
            let cell = IVec2::new(x, y);
            if known.contains(&cell) {
                continue;
            }
            let c = cell.as_dvec2();
            let (at, right) = (apply(map, c), apply(map, c + DVec2::X));
            let near = (0.6 * MAX_DISTANCE * right.distance(at)).powi(2);
            let typical = blobs[cells[0].1].area;
            let fits = |&(i, b): &(usize, &Blob)| {
                let free = !cells.iter().any(|cell| cell.1 == i);
                free && b.centre.distance_squared(at) < near
                    && AREA_RATIO.contains(&(b.area / typical))
            };
            if let Some((i, _)) = blobs.iter().enumerate().find(fits) {
                cells.push((cell, i));
            }
        }
    }
}

pub(super) fn bounds(cells: &[IVec2]) -> Option<(IVec2, IVec2)> {
    let first = *cells.first()?;
    let all = cells.iter();
    Some(all.fold((first, first), |(low, high), c| (low.min(*c), high.max(*c))))
}

fn homography(blobs: &[Blob], cells: &[(IVec2, usize)]) -> Option<DMat3> {
    let count = cells.len() as f64;
    let centroid = cells.iter().map(|c| blobs[c.1].centre).sum::<DVec2>() / count;
    let spread = cells.iter().map(|c| blobs[c.1].centre.distance(centroid));
    let size = spread.sum::<f64>() / count;
    let pairs: Vec<(DVec2, DVec3)> = cells
        .iter()
        .map(|&(cell, blob)| {
            let ray = (blobs[blob].centre - centroid) / size;
            (cell.as_dvec2(), ray.extend(1.0))
        })
        .collect();
    let to_picture = DMat3::from_cols(
        DVec3::new(size, 0.0, 0.0),
        DVec3::new(0.0, size, 0.0),
        centroid.extend(1.0),
    );
    Some(to_picture * from_rays(&pairs)?)
}
