//! Surfels by their place: which one represents a point of a surface, and the mean around it.

use super::obstacles::SurfacePoint;
use glam::{IVec3, Vec2, Vec3};
use std::ops::Range;

/// Largest number of cells along an axis.
const LONGEST: f32 = 64.0;

/// Rows of cells along x around that of a point, nearest first: steps in y and z.
const NEIGHBOURS: [[i32; 2]; 9] = [
    [0, 0],
    [-1, 0],
    [1, 0],
    [0, -1],
    [0, 1],
    [-1, -1],
    [-1, 1],
    [1, -1],
    [1, 1],
];

/// Distance, in cells, up to which a surfel with the normal of a point counts before a nearer one of the
/// other side of a wall.
const MAX_RING: i32 = 5;

/// Distance within which surfels count in a mean, in cells.
const REACH: i32 = 2;

/// Surfels by cells of a grid around them. A cell is as long as their mean distance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfelIndex {
    low: Vec3,
    /// Side of a cell, metres.
    cell: f32,
    size: IVec3,
    /// By cell: where its surfels begin in `surfels`; one more at the end.
    begins: Vec<u32>,
    /// Numbers of the surfels in ascending order of their cells.
    surfels: Vec<u32>,
    /// Their positions and normals, in the same order.
    places: Vec<(Vec3, Vec3)>,
}

impl SurfelIndex {
    /// Sorts surfels at `places` (position, normal) that are `spacing` metres apart on average.
    pub(super) fn new(places: Vec<(Vec3, Vec3)>, spacing: f32) -> Self {
        let low = places.iter().fold(Vec3::MAX, |l, p| l.min(p.0));
        let high = places.iter().fold(Vec3::MIN, |h, p| h.max(p.0));
        let extent = (high - low).max(Vec3::ZERO);
        let cell = spacing.max(extent.max_element() / LONGEST).max(1e-6);
        let size = (extent / cell).as_ivec3() + 1;
        let mut index = Self {
            low,
            cell,
            size,
            begins: vec![0; size.element_product() as usize + 1],
            surfels: (0..places.len() as u32).collect(),
            places,
        };
        let cells: Vec<usize> = index
            .places
            .iter()
            .map(|p| index.number(index.cell_of(p.0)))
            .collect();
        index.surfels.sort_by_key(|i| cells[*i as usize]);
        for cell in &cells {
            index.begins[cell + 1] += 1;
        }
        for i in 1..index.begins.len() {
            index.begins[i] += index.begins[i - 1];
        }
        let sorted = index.surfels.iter().map(|i| index.places[*i as usize]);
        index.places = sorted.collect();
        index
    }

    /// Whether there are no surfels.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// The mean of `values`, one of each surfel, over those around `p` that face like the unit normal
    /// `n` (world, metres); `None` without any.
    #[must_use]
    pub fn mean(&self, values: &[Vec3], p: Vec3, n: Vec3) -> Option<Vec3> {
        if self.is_empty() {
            return None;
        }
        // Far outside, a cell's number would not fit.
        let at = ((p - self.low) / self.cell).clamp(Vec3::splat(-1e6), Vec3::splat(1e6));
        let at = at.floor().as_ivec3();
        let (from, to) = (
            (at - REACH).max(IVec3::ZERO),
            (at + REACH).min(self.size - 1),
        );
        if from.cmpgt(to).any() {
            return None;
        }
        let scale = 1.0 / (REACH as f32 * self.cell);
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for row in (from.z..=to.z).flat_map(|z| (from.y..=to.y).map(move |y| (y, z))) {
            let number = |x: i32| self.number(IVec3::new(x, row.0, row.1));
            let range = self.range(number(from.x), number(to.x));
            let surfels = &self.surfels[range.clone()];
            for (i, (position, normal)) in surfels.iter().zip(&self.places[range]) {
                let far = ((*position - p) * scale).length_squared();
                let w = (1.0 - far).max(0.0).powi(2) * normal.dot(n).max(0.0);
                sum += values.get(*i as usize).copied().unwrap_or_default() * w;
                weight += w;
            }
        }
        (weight > 1e-4).then(|| sum / weight)
    }

    /// Returns the surfel nearest to `hit`, where surfels with another normal count as farther away. Of
    /// surfels farther than [`MAX_RING`] cells only if there is none within.
    pub(super) fn nearest(&self, hit: &SurfacePoint) -> Option<u32> {
        if self.is_empty() {
            return None;
        }
        let centre = self.cell_of(hit.point);
        let mut best = (f32::INFINITY, u32::MAX);
        let visit = |range: Range<usize>, best: &mut (f32, u32)| {
            let places = &self.places[range.clone()];
            for (i, place) in self.surfels[range].iter().zip(places) {
                let found = (distance(*place, hit), *i);
                if found < *best {
                    *best = found;
                }
            }
        };
        let beside = (hit.point - self.low) / self.cell - centre.as_vec3();
        for [y, z] in NEIGHBOURS {
            // How far the row of cells is at least.
            let away = |step: i32, at: f32| match step {
                0 => 0.0,
                1 => 1.0 - at,
                _ => at,
            };
            let gap = Vec2::new(away(y, beside.y), away(z, beside.z)).max(Vec2::ZERO) * self.cell;
            let row = centre + IVec3::new(0, y, z);
            let inside = row.cmpge(IVec3::ZERO).all() && row.cmplt(self.size).all();
            if inside && gap.length_squared() <= best.0 {
                let ends = [(row.x - 1).max(0), (row.x + 1).min(self.size.x - 1)];
                let [first, last] = ends.map(|x| self.number(IVec3::new(x, row.y, row.z)));
                visit(self.range(first, last), &mut best);
            }
        }
        for ring in 2..self.size.max_element().min(MAX_RING + 1) {
            // Surfels that were not visited yet are at least so far away.
            let least = (ring - 1) as f32 * self.cell;
            if best.0 < least * least {
                break;
            }
            self.for_each_in_ring(centre, ring, |range| visit(range, &mut best));
        }
        if best.0 == f32::INFINITY {
            visit(0..self.places.len(), &mut best);
        }
        best.0.is_finite().then_some(best.1)
    }

    /// Visits the surfels in the cells whose largest distance from `centre` along an axis is `ring`.
    fn for_each_in_ring(&self, centre: IVec3, ring: i32, mut visit: impl FnMut(Range<usize>)) {
        let low = (centre - ring).max(IVec3::ZERO);
        let high = (centre + ring).min(self.size - 1);
        for z in low.z..=high.z {
            for y in low.y..=high.y {
                let number = |x: i32| self.number(IVec3::new(x, y, z));
                if (z - centre.z).abs() == ring || (y - centre.y).abs() == ring {
                    visit(self.range(number(low.x), number(high.x)));
                    continue;
                }
                // Inside of the ring's cube only its two ends along x belong to it.
                for x in [centre.x - ring, centre.x + ring] {
                    if (0..self.size.x).contains(&x) {
                        visit(self.range(number(x), number(x)));
                    }
                }
            }
        }
    }

    fn cell_of(&self, point: Vec3) -> IVec3 {
        let cell = ((point - self.low) / self.cell).floor().as_ivec3();
        cell.clamp(IVec3::ZERO, self.size - 1)
    }

    fn number(&self, cell: IVec3) -> usize {
        ((cell.z * self.size.y + cell.y) * self.size.x + cell.x) as usize
    }

    /// Where the surfels of cells `first` to `last` of a row are.
    fn range(&self, first: usize, last: usize) -> Range<usize> {
        self.begins[first] as usize..self.begins[last + 1] as usize
    }
}

/// Square of the distance of a surfel (position, normal), which grows with the angle between the
/// normals.
fn distance((position, normal): (Vec3, Vec3), hit: &SurfacePoint) -> f32 {
    let inclination = 1.0 - normal.dot(hit.normal);
    // The other side of a thin wall has another light.
    let behind = if inclination > 1.0 { 1e3 } else { 1.0 };
    position.distance_squared(hit.point) * (1.0 + 8.0 * inclination * inclination) * behind
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points that fill a ball, with normals in all directions.
    fn scattered(count: usize, seed: f64) -> Vec<(Vec3, Vec3)> {
        let at = |k: usize, step: f64| (seed + step * k as f64).fract() as f32 - 0.5;
        let direction = |k, a, b, c| Vec3::new(at(k, a), at(k, b), at(k, c));
        let steps = [
            0.819_172_513_396_164_4,
            0.671_043_606_703_789_2,
            0.549_700_477_901_970_3,
        ];
        (0..count)
            .map(|k| {
                let normal = direction(7 * k + 1, steps[1], steps[2], steps[0]);
                (
                    direction(k, steps[0], steps[1], steps[2]),
                    normal.normalize(),
                )
            })
            .collect()
    }

    #[test]
    fn it_finds_what_a_search_of_all_finds() {
        let places = scattered(700, 0.1);
        let index = SurfelIndex::new(places.clone(), 0.08);
        for (k, (point, normal)) in scattered(300, 0.7).into_iter().enumerate() {
            // Some lie outside of the grid.
            let point = point * if k % 5 == 0 { 3.0 } else { 1.0 };
            let hit = SurfacePoint { point, normal };
            let of = |i: &u32| distance(places[*i as usize], &hit);
            let nearest =
                |among: &mut dyn Iterator<Item = u32>| among.min_by(|a, b| of(a).total_cmp(&of(b)));
            let steps = |i: &u32| index.cell_of(places[*i as usize].0) - index.cell_of(point);
            let near = (0..700).filter(|i| steps(i).abs().max_element() <= MAX_RING);
            let found = nearest(&mut near.into_iter()).or_else(|| nearest(&mut (0..700)));
            assert_eq!(index.nearest(&hit), found, "{point}");
        }
    }

    #[test]
    fn mean_counts_the_surfels_around_a_point_that_face_like_it() {
        let places = scattered(700, 0.1);
        let index = SurfelIndex::new(places.clone(), 0.08);
        let values: Vec<Vec3> = (0..700).map(|i| Vec3::splat(i as f32)).collect();
        for (p, n) in scattered(300, 0.7) {
            let (mut sum, mut weight) = (0.0, 0.0);
            for (i, (position, normal)) in places.iter().enumerate() {
                let far = (position.distance(p) / (2.0 * index.cell)).min(1.0);
                let w = (1.0 - far * far).powi(2) * normal.dot(n).max(0.0);
                (sum, weight) = (sum + w * i as f32, weight + w);
            }
            match index.mean(&values, p, n) {
                Some(mean) => assert!((mean.x - sum / weight).abs() < 0.1, "{p}"),
                None => assert!(weight < 2e-4, "{p}"),
            }
        }
        for far in [9.0, -1e30, 1e30] {
            assert_eq!(index.mean(&values, Vec3::splat(far), Vec3::Z), None);
        }
    }

    #[test]
    fn it_is_empty_or_flat() {
        let hit = SurfacePoint {
            point: Vec3::ONE,
            normal: Vec3::Z,
        };
        assert_eq!(SurfelIndex::default().nearest(&hit), None);
        assert_eq!(SurfelIndex::default().mean(&[], Vec3::ONE, Vec3::Z), None);
        let flat = (0..9).map(|i| (Vec3::X * i as f32, Vec3::Z)).collect();
        assert_eq!(SurfelIndex::new(flat, 0.0).nearest(&hit), Some(1));
    }
}
