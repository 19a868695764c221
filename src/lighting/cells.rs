//! Divides the environment without its compact sources into cells of similar importance.
//!
//! The error of a cell in a shadow grows with its share of the ground's light and with its extent.
//! So the cell with the largest product of the two is split until there are enough cells, and the
//! borders are then relaxed (k-means, weighted by importance). The division is kept from frame to
//! frame, while colours and centres follow the light, until it has become much worse than a new one
//! would be.

use super::cube::CubeGrid;
use super::light::{DomeLight, LightKind};
use super::place::LightPlace;
use super::sources::LUMINANCE;
use super::tracking::above_horizon;
use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// Iterations of k-means after splitting.
const RELAXATIONS: usize = 4;
/// Minimum factor by which a new division must be better to replace the old one.
const MIN_IMPROVEMENT: f32 = 1.3;
/// Part of the importance that is distributed uniformly, so that dark regions keep coarse cells.
const UNIFORM_SHARE: f32 = 0.05;

/// A division of the fine map's texels into cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Cells {
    /// Cell of each texel; `u16::MAX` for none.
    cell_of: Vec<u16>,
    count: usize,
    importance: Vec<f32>,
}

/// Moments of one cell.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f32,
    first: Vec3,
}

impl Moments {
    fn add(&mut self, weight: f32, direction: Vec3) {
        self.weight += weight;
        self.first += direction * weight;
    }

    fn centre(&self) -> Vec3 {
        self.first / self.weight.max(f32::MIN_POSITIVE)
    }

    /// Root mean square distance from the centre: for unit vectors 1 − |mean|².
    fn extent(&self) -> f32 {
        (1.0 - self.centre().length_squared()).max(0.0).sqrt()
    }

    fn score(&self) -> f32 {
        self.weight * self.extent()
    }
}

impl Cells {
    /// Updates the division for new light; returns true if it was replaced.
    pub fn update(&mut self, texels: &[Vec3], grid: &CubeGrid, count: usize, ground: bool) -> bool {
        let importance = importance(texels, grid, ground);
        let must = self.count != count || self.cell_of.len() != texels.len();
        if !must && !self.has_changed(&importance) {
            return false;
        }
        let fresh = divide(&importance, grid, count);
        let old = cost(&self.cell_of, self.count, &importance, grid);
        let new = cost(&fresh, count, &importance, grid);
        if !must && old < MIN_IMPROVEMENT * new {
            return false;
        }
        *self = Self {
            cell_of: fresh,
            count,
            importance,
        };
        true
    }

    /// Whether more than a twentieth of the importance has moved since the division.
    fn has_changed(&self, importance: &[f32]) -> bool {
        let moved: f32 = importance
            .iter()
            .zip(&self.importance)
            .map(|(a, b)| (a - b).abs())
            .sum();
        moved > 0.05
    }

    /// Returns one light per cell, in the order of the cells. Its direction is that of the cell's
    /// vector irradiance, so that every surface that sees the entire cell gets the same irradiance
    /// (by luminance) from the light as from the texels; with ground, the irradiance of the ground
    /// is exact.
    pub fn lights(&self, texels: &[Vec3], grid: &CubeGrid, ground: bool) -> Vec<DomeLight> {
        let mut sums = vec![CellSum::default(); self.count];
        for (i, &cell) in self.cell_of.iter().enumerate() {
            if let Some(sum) = sums.get_mut(cell as usize) {
                sum.add(texels[i], grid.directions[i], grid.solid_angles[i], ground);
            }
        }
        sums.iter().map(|sum| sum.light(ground)).collect()
    }
}

#[derive(Clone, Copy, Debug, Default)]
struct CellSum {
    flux: Vec3,
    centre: Vec3,
    even_centre: Vec3,
    energy: f32,
    squares: f32,
    solid_angle: f32,
}

impl CellSum {
    fn add(&mut self, radiance: Vec3, direction: Vec3, w: f32, ground: bool) {
        let cosine = if ground { direction.z.max(0.0) } else { 1.0 };
        let y = radiance.dot(LUMINANCE).max(0.0);
        self.flux += radiance * (w * cosine);
        self.centre += direction * (y * w);
        self.even_centre += direction * w;
        self.energy += y * w;
        self.squares += y * y * w;
        self.solid_angle += w;
    }

    fn light(&self, ground: bool) -> DomeLight {
        let even = self.even_centre.try_normalize().unwrap_or(Vec3::Z);
        let direction = above_horizon(self.centre.try_normalize().unwrap_or(even), ground);
        let effective = if self.squares > 0.0 {
            self.energy * self.energy / self.squares
        } else {
            self.solid_angle
        };
        DomeLight {
            direction,
            irradiance: self.flux / if ground { direction.z } else { 1.0 },
            angular_radius: (effective / PI).sqrt(),
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        }
    }
}

/// Each texel's share of the ground's light; the sum is one.
fn importance(texels: &[Vec3], grid: &CubeGrid, ground: bool) -> Vec<f32> {
    let of = |l: &Vec3, d: &Vec3, w: &f32| match ground {
        true if d.z <= 0.0 => 0.0,
        true => l.dot(LUMINANCE).max(0.0) * w * d.z.max(0.1),
        false => l.dot(LUMINANCE).max(0.0) * w,
    };
    let rows = || texels.iter().zip(&grid.directions).zip(&grid.solid_angles);
    let total: f32 = rows().map(|((l, d), w)| of(l, d, w)).sum();
    let even = UNIFORM_SHARE / if ground { 2.0 * PI } else { 4.0 * PI };
    rows()
        .map(|((l, d), w)| {
            let counts = !ground || d.z > 0.0;
            let even = if counts { even * w } else { 0.0 };
            even + (1.0 - UNIFORM_SHARE) * of(l, d, w) / total.max(f32::MIN_POSITIVE)
        })
        .collect()
}

fn cost(cell_of: &[u16], count: usize, importance: &[f32], grid: &CubeGrid) -> f32 {
    let mut moments = vec![Moments::default(); count];
    for ((&cell, &w), &d) in cell_of.iter().zip(importance).zip(&grid.directions) {
        if let Some(m) = moments.get_mut(cell as usize) {
            m.add(w, d);
        }
    }
    moments
        .iter()
        .map(|m| m.score() * m.score())
        .sum::<f32>()
        .sqrt()
}

fn divide(importance: &[f32], grid: &CubeGrid, count: usize) -> Vec<u16> {
    let all: Vec<u32> = (0..importance.len() as u32)
        .filter(|&i| importance[i as usize] > 0.0)
        .collect();
    let mut groups = vec![(moments_of(&all, importance, grid), all)];
    while groups.len() < count {
        let worst = groups
            .iter()
            .enumerate()
            .filter(|(_, (_, members))| members.len() > 1)
            .max_by(|a, b| a.1.0.score().total_cmp(&b.1.0.score()));
        let Some((k, _)) = worst else { break };
        let (moments, members) = groups.swap_remove(k);
        let (low, high) = halve(moments.centre(), members, importance, grid);
        groups.push((moments_of(&low, importance, grid), low));
        groups.push((moments_of(&high, importance, grid), high));
    }
    let centres: Vec<Vec3> = groups.iter().map(|g| g.0.centre()).collect();
    relax(centres, importance, grid)
}

fn moments_of(members: &[u32], importance: &[f32], grid: &CubeGrid) -> Moments {
    let mut moments = Moments::default();
    for &i in members {
        moments.add(importance[i as usize], grid.directions[i as usize]);
    }
    moments
}

/// Splits a group at its mean, across its longest axis.
fn halve(
    centre: Vec3,
    members: Vec<u32>,
    importance: &[f32],
    grid: &CubeGrid,
) -> (Vec<u32>, Vec<u32>) {
    let offset = |i: &u32| grid.directions[*i as usize] - centre;
    let mut covariance = Mat3::ZERO;
    for i in &members {
        let d = offset(i) * importance[*i as usize].sqrt();
        covariance += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
    }
    let axis = principal_axis(covariance);
    let (low, high): (Vec<u32>, Vec<u32>) = members.iter().partition(|i| offset(i).dot(axis) < 0.0);
    if !low.is_empty() && !high.is_empty() {
        return (low, high);
    }
    let (a, b) = members.split_at(members.len() / 2);
    (a.to_vec(), b.to_vec())
}

/// Eigenvector of the largest eigenvalue, by power iteration.
fn principal_axis(m: Mat3) -> Vec3 {
    let mut v = Vec3::new(0.577, 0.6, 0.554);
    for _ in 0..24 {
        v = (m * v).try_normalize().unwrap_or(v);
    }
    v
}

/// k-means: assigns every texel to the nearest centre, and moves every centre to the mean of its
/// texels.
fn relax(mut centres: Vec<Vec3>, importance: &[f32], grid: &CubeGrid) -> Vec<u16> {
    let mut cell_of = vec![u16::MAX; importance.len()];
    for round in 0..=RELAXATIONS {
        let mut moments = vec![Moments::default(); centres.len()];
        for (i, &w) in importance.iter().enumerate() {
            if w > 0.0 {
                let cell = nearest(&centres, grid.directions[i]);
                cell_of[i] = cell as u16;
                moments[cell].add(w, grid.directions[i]);
            }
        }
        if round < RELAXATIONS {
            for (centre, m) in centres.iter_mut().zip(&moments) {
                if m.weight > 0.0 {
                    *centre = m.centre();
                }
            }
        }
    }
    cell_of
}

fn nearest(centres: &[Vec3], d: Vec3) -> usize {
    let mut best = (0, f32::INFINITY);
    for (k, c) in centres.iter().enumerate() {
        let distance = c.distance_squared(d);
        if distance < best.1 {
            best = (k, distance);
        }
    }
    best.0
}
