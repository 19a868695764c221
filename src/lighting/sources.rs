//! Compact sources of light (sun, lamp, window) in a picture of the environment.
//!
//! A source is a small bright region with an edge: it is grown from its peak down to a fraction of
//! it, over gaps as narrow as a window's bars, and kept if it contributes enough to the ground's
//! irradiance, is not too large, and the radiance falls steeply outside it. The glow around the sun
//! has no edge and stays in the cells of the dome.

use super::clipped::RaisedSources;
use super::lamp_distance::UnseenLamp;
use super::place::LampDistance;
use super::resample::PixelDirections;
use super::round::{Cone, Edge};
use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// Rec.709 luminance weights.
pub const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);

/// Parts of a lamp that is not seen.
const UNSEEN_PARTS: usize = 256;

/// Criteria of a compact source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SourceSettings {
    /// Minimum ratio of a source's radiance to the median radiance.
    pub min_contrast: f32,
    /// Fraction of its peak down to which a region is grown.
    pub peak_fraction: f32,
    /// Minimum share of the ground's irradiance (without ground: of all light).
    pub min_share: f32,
    /// Maximum solid angle, steradians: the shadows of larger regions are soft enough as cells.
    pub max_solid_angle: f32,
    /// Width of the gaps over which a region is grown (a window's bars), relative to the picture's
    /// width.
    pub gap: f32,
    /// Maximum number of sources.
    pub max_sources: usize,
}

impl Default for SourceSettings {
    fn default() -> Self {
        Self {
            min_contrast: 4.0,
            peak_fraction: 0.125,
            min_share: 0.01,
            max_solid_angle: 0.8,
            gap: 1.0 / 160.0,
            max_sources: 8,
        }
    }
}

/// Samples of the sphere of directions and their neighbourhood.
#[derive(Clone, Copy, Debug)]
pub struct SampleGrid<'a> {
    /// Unit directions, world.
    pub directions: &'a [Vec3],
    /// Solid angles, steradians; zero where nothing is seen.
    pub solid_angles: &'a [f32],
    /// Arrangement of the samples.
    pub layout: Layout<'a>,
}

/// Arrangement of samples.
#[derive(Clone, Copy, Debug)]
pub enum Layout<'a> {
    /// A picture with this number of pixels in a row.
    Picture(u32),
    /// The texels of a cube and the eight neighbours of each.
    Cube(&'a [[u32; 8]]),
}

/// One compact source.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Its samples and, for each, the radiance above the background times solid angle.
    pub parts: Vec<(u32, Vec3)>,
    /// Radiance around it.
    pub background: Vec3,
    /// Unit vector to its centre of energy.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it.
    pub flux: Vec3,
    /// Effective solid angle, steradians.
    pub solid_angle: f32,
    /// Share of its light in samples that every exposure clips, 0..=1.
    pub clipped: f32,
    /// What is added to the directions of its samples, which are too coarse where they clip.
    pub shift: Vec3,
    /// Directions (unit vectors) in which something hides it, and the light above the background, as of
    /// `parts`, that comes from there.
    pub hidden: Vec<(Vec3, Vec3)>,
    /// The distance of a lamp that is not seen at all; `None` for all others.
    pub unseen: Option<LampDistance>,
}

impl Source {
    /// A lamp that is not seen; `environment_from_scene` converts its light to the environment camera's units.
    pub(super) fn of_unseen(lamp: &UnseenLamp, environment_from_scene: Mat3) -> Self {
        let flux = environment_from_scene * lamp.irradiance;
        let part = flux / UNSEEN_PARTS as f32;
        Self {
            parts: Vec::new(),
            background: Vec3::ZERO,
            direction: lamp.direction,
            flux,
            solid_angle: PI * lamp.angular_radius.powi(2),
            clipped: 0.0,
            shift: Vec3::ZERO,
            hidden: lamp.points(UNSEEN_PARTS).map(|d| (d, part)).collect(),
            unseen: Some(lamp.distance),
        }
    }

    /// Notes which of its samples are `clipped`, ascending numbers.
    pub(super) fn note_clipped(&mut self, clipped: &[u32]) {
        let light = |(_, flux): &&(u32, Vec3)| flux.dot(LUMINANCE);
        let is_clipped = |(i, _): &&(u32, Vec3)| clipped.binary_search(i).is_ok();
        // An empty sum would be −0.
        let sum = |sum: f32, p: &(u32, Vec3)| sum + light(&p);
        let all = self.parts.iter().fold(0.0, sum);
        let lost = self.parts.iter().filter(is_clipped).fold(0.0, sum);
        self.clipped = lost / all.max(f32::MIN_POSITIVE);
    }

    /// Moves its centre, by no more than a clipped sample's width, to where it was before those samples were
    /// raised: among them, one that the source hardly touches counts as much as one that it fills.
    pub(super) fn recentre(
        &mut self,
        clipped: &[u32],
        pixels: &PixelDirections,
        raised: &RaisedSources,
    ) {
        let (mut centre, mut widest) = (Vec3::ZERO, 0.0f32);
        for (i, flux) in &self.parts {
            let (direction, size) = (
                pixels.directions[*i as usize],
                pixels.solid_angles[*i as usize],
            );
            let mut before = *flux;
            if let (Ok(_), Some(factor)) = (clipped.binary_search(i), raised.factor_at(direction)) {
                let background = self.background * size;
                before = (*flux + background) / factor - background;
                widest = widest.max(size);
            }
            centre += direction * before.dot(LUMINANCE).max(0.0);
        }
        let moved = centre.try_normalize().unwrap_or(self.direction) - self.direction;
        self.shift = moved.clamp_length_max(widest.sqrt());
        self.direction = (self.direction + self.shift).normalize();
    }
}

/// Finds sources; reuses its buffers from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct SourceFinder {
    luminance: Vec<f32>,
    /// 0 = free, 1 = visited, 2 + k = in region k.
    labels: Vec<u32>,
    candidates: Vec<u32>,
}

const VISITED: u32 = 1;
/// Labels of a region that is divided, before and after a sample of it was visited.
const IN_REGION: u32 = u32::MAX - 1;
const IN_ISLAND: u32 = u32::MAX;
/// Share of a region's light from which one of its parts may be a lamp of its own.
const LEAST_ISLAND: f32 = 0.05;

impl SourceFinder {
    /// Returns the sources in `radiance`, strongest first. With `ground`, only above the horizon.
    pub fn find(
        &mut self,
        grid: SampleGrid,
        radiance: &[Vec3],
        ground: bool,
        settings: &SourceSettings,
    ) -> Vec<Source> {
        self.luminance.clear();
        self.luminance
            .extend(radiance.iter().map(|l| l.dot(LUMINANCE)));
        self.labels.clear();
        self.labels.resize(radiance.len(), 0);
        let scene = SceneStatistics::new(grid, &self.luminance, ground);
        let floor = scene.median * settings.min_contrast;
        self.candidates.clear();
        self.candidates
            .extend((0..radiance.len() as u32).filter(|&i| {
                let i = i as usize;
                self.luminance[i] > floor && scene.counts(grid, i)
            }));
        self.candidates.sort_unstable_by(|&a, &b| {
            let (la, lb) = (self.luminance[a as usize], self.luminance[b as usize]);
            lb.total_cmp(&la).then(a.cmp(&b))
        });
        let mut found = Vec::new();
        let candidates = std::mem::take(&mut self.candidates);
        for &seed in &candidates {
            if found.len() == settings.max_sources || self.labels[seed as usize] != 0 {
                continue;
            }
            let threshold = (self.luminance[seed as usize] * settings.peak_fraction).max(floor);
            let region = self.grow(grid, seed, threshold, settings.gap, 2 + found.len() as u32);
            for region in self.lamps_in(grid, region) {
                found.extend(self.assess(grid, radiance, &region, threshold, &scene, settings));
            }
        }
        self.candidates = candidates;
        found.sort_by(|a, b| b.flux.dot(LUMINANCE).total_cmp(&a.flux.dot(LUMINANCE)));
        found
    }

    /// Returns all samples above the threshold that are connected to the seed over narrow gaps.
    fn grow(
        &mut self,
        grid: SampleGrid,
        seed: u32,
        threshold: f32,
        gap: f32,
        label: u32,
    ) -> Vec<u32> {
        let mut region = vec![seed];
        self.labels[seed as usize] = label;
        let mut next = 0;
        while let Some(&i) = region.get(next) {
            next += 1;
            grid.near(i, grid.steps(gap), |k| {
                let free = self.labels[k as usize] == 0 && grid.solid_angles[k as usize] > 0.0;
                if free && self.luminance[k as usize] > threshold {
                    self.labels[k as usize] = label;
                    region.push(k);
                }
            });
        }
        region
    }

    /// Divides a region into the round lamps that lie in it, apart from each other, and the rest: what a gap
    /// divides may be a window, or lamps side by side.
    fn lamps_in(&mut self, grid: SampleGrid, region: Vec<u32>) -> Vec<Vec<u32>> {
        let islands = self.islands(grid, &region);
        if islands.len() < 2 {
            return vec![region];
        }
        let light = |island: &[u32]| -> f32 {
            let each = island.iter().map(|&i| i as usize);
            each.map(|i| self.luminance[i] * grid.solid_angles[i]).sum()
        };
        let least = LEAST_ISLAND * light(&region);
        let (lamps, others): (Vec<_>, Vec<_>) = islands
            .into_iter()
            .partition(|island| light(island) > least && self.is_round(grid, island));
        let rest: Vec<u32> = others.into_iter().flatten().collect();
        let all = lamps.into_iter().chain(std::iter::once(rest));
        all.filter(|region| !region.is_empty()).collect()
    }

    /// The connected parts of a region.
    fn islands(&mut self, grid: SampleGrid, region: &[u32]) -> Vec<Vec<u32>> {
        let mut islands = Vec::new();
        for &i in region {
            self.labels[i as usize] = IN_REGION;
        }
        for &seed in region {
            if self.labels[seed as usize] != IN_REGION {
                continue;
            }
            let mut island = vec![seed];
            self.labels[seed as usize] = IN_ISLAND;
            let mut next = 0;
            while let Some(&i) = island.get(next) {
                next += 1;
                grid.near(i, 1, |k| {
                    if self.labels[k as usize] == IN_REGION {
                        self.labels[k as usize] = IN_ISLAND;
                        island.push(k);
                    }
                });
            }
            islands.push(island);
        }
        islands
    }

    fn is_round(&self, grid: SampleGrid, island: &[u32]) -> bool {
        let luminance = |i: usize| self.luminance[i];
        let most = island
            .iter()
            .map(|&i| luminance(i as usize))
            .fold(0.0, f32::max);
        let edge = Edge::of(grid, island.iter().copied(), 0.5 * most, luminance);
        let cone = edge.and_then(|edge| Cone::through(&edge.points));
        cone.is_some_and(|cone| cone.certainty > 0.5)
    }

    /// Converts a region to a source if it meets the criteria.
    fn assess(
        &mut self,
        grid: SampleGrid,
        radiance: &[Vec3],
        region: &[u32],
        threshold: f32,
        scene: &SceneStatistics,
        settings: &SourceSettings,
    ) -> Option<Source> {
        // Samples cut by the edge hold part of the source's energy.
        let rim = self.rim(grid, region, 1);
        let ring = {
            let all: Vec<u32> = region.iter().chain(&rim).copied().collect();
            self.rim(grid, &all, 2)
        };
        let background = mean(grid, radiance, &ring);
        let source = measure(
            grid,
            radiance,
            region.iter().chain(&rim).copied(),
            background,
        );
        for &i in &rim {
            self.labels[i as usize] = VISITED;
        }
        for &i in &ring {
            self.labels[i as usize] = 0;
        }
        let height = if scene.ground {
            source.direction.z.max(0.0)
        } else {
            1.0
        };
        let share = source.flux.dot(LUMINANCE) * height / scene.total.max(f32::MIN_POSITIVE);
        let steep = background.dot(LUMINANCE) < 0.5 * threshold;
        let small = source.solid_angle < settings.max_solid_angle;
        (steep && small && share >= settings.min_share).then_some(source)
    }

    /// Returns the free samples within `reach` steps of a set, and labels them as visited.
    fn rim(&mut self, grid: SampleGrid, set: &[u32], reach: i32) -> Vec<u32> {
        let mut rim = Vec::new();
        for &i in set {
            grid.near(i, reach, |k| {
                if self.labels[k as usize] == 0 && grid.solid_angles[k as usize] > 0.0 {
                    self.labels[k as usize] = VISITED;
                    rim.push(k);
                }
            });
        }
        rim
    }
}

fn mean(grid: SampleGrid, radiance: &[Vec3], set: &[u32]) -> Vec3 {
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for &i in set {
        let w = grid.solid_angles[i as usize];
        sum += radiance[i as usize] * w;
        total += w;
    }
    if total > 0.0 { sum / total } else { Vec3::ZERO }
}

fn measure(
    grid: SampleGrid,
    radiance: &[Vec3],
    samples: impl Iterator<Item = u32>,
    background: Vec3,
) -> Source {
    let (mut parts, mut flux, mut centre) = (Vec::new(), Vec3::ZERO, Vec3::ZERO);
    let (mut sum, mut squares) = (0.0f32, 0.0f32);
    for i in samples {
        let w = grid.solid_angles[i as usize];
        let above = (radiance[i as usize] - background).max(Vec3::ZERO);
        let y = above.dot(LUMINANCE);
        parts.push((i, above * w));
        flux += above * w;
        centre += grid.directions[i as usize] * (y * w);
        sum += y * w;
        squares += y * y * w;
    }
    Source {
        parts,
        background,
        direction: centre.try_normalize().unwrap_or(Vec3::Z),
        flux,
        solid_angle: sum * sum / squares.max(f32::MIN_POSITIVE),
        clipped: 0.0,
        shift: Vec3::ZERO,
        hidden: Vec::new(),
        unseen: None,
    }
}

impl SampleGrid<'_> {
    /// Number of steps over which a region may be grown.
    fn steps(&self, gap: f32) -> i32 {
        match self.layout {
            Layout::Picture(width) => ((width as f32 * gap) as i32).clamp(1, 8),
            Layout::Cube(_) => 1,
        }
    }

    /// Calls `visit` for every sample within `reach` steps of `i`.
    pub(super) fn near(&self, i: u32, reach: i32, mut visit: impl FnMut(u32)) {
        match self.layout {
            Layout::Picture(width) => {
                let (x, y) = ((i % width) as i32, (i / width) as i32);
                let height = self.directions.len() as i32 / width as i32;
                let columns = (x - reach).max(0)..=(x + reach).min(width as i32 - 1);
                for v in (y - reach).max(0)..=(y + reach).min(height - 1) {
                    for u in columns.clone() {
                        visit((v * width as i32 + u) as u32);
                    }
                }
            }
            Layout::Cube(neighbours) => {
                for &k in &neighbours[i as usize] {
                    visit(k);
                    if reach > 1 {
                        neighbours[k as usize].iter().for_each(|&far| visit(far));
                    }
                }
            }
        }
    }
}

/// Statistics of the scene's light.
struct SceneStatistics {
    ground: bool,
    /// Median luminance over the solid angle of the counted samples.
    median: f32,
    /// Luminance of the ground's irradiance; without ground, of all light.
    total: f32,
}

impl SceneStatistics {
    /// Logarithmic histogram: 16 bins per octave over 2⁻¹⁶..2⁴⁸.
    const BINS: usize = 1024;

    fn new(grid: SampleGrid, luminance: &[f32], ground: bool) -> Self {
        let mut survey = Self {
            ground,
            median: 0.0,
            total: 0.0,
        };
        let mut histogram = vec![0.0f32; Self::BINS];
        let mut seen = 0.0;
        for (i, &y) in luminance.iter().enumerate() {
            if survey.counts(grid, i) {
                let w = grid.solid_angles[i];
                let bin = ((y.max(1e-6).log2() + 16.0) * 16.0) as usize;
                histogram[bin.min(Self::BINS - 1)] += w;
                seen += w;
                survey.total += y * w * if ground { grid.directions[i].z } else { 1.0 };
            }
        }
        let mut below = 0.0;
        let bin = histogram.iter().position(|w| {
            below += w;
            below >= 0.5 * seen
        });
        survey.median = bin.map_or(0.0, |b| ((b as f32 + 0.5) / 16.0 - 16.0).exp2());
        survey
    }

    fn counts(&self, grid: SampleGrid, i: usize) -> bool {
        grid.solid_angles[i] > 0.0 && !(self.ground && grid.directions[i].z < 0.035)
    }
}

#[cfg(test)]
mod tests {
    use super::super::cube::CubeGrid;
    use super::*;

    fn find(grid: &CubeGrid, texels: &[Vec3]) -> Vec<Source> {
        let neighbours = grid.neighbours();
        let samples = SampleGrid {
            directions: &grid.directions,
            solid_angles: &grid.solid_angles,
            layout: Layout::Cube(&neighbours),
        };
        SourceFinder::default().find(samples, texels, true, &SourceSettings::default())
    }

    /// A sky with a glow around the sun that falls off smoothly.
    fn sky(d: Vec3, sun: Vec3) -> f32 {
        0.2 + 2.0 * (-d.angle_between(sun) * 4.0).exp()
    }

    #[test]
    fn finds_sun_without_its_glow() {
        let grid = CubeGrid::new(64);
        let sun = Vec3::new(0.4, -0.3, 0.6).normalize();
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|&d| {
                Vec3::splat(
                    sky(d, sun)
                        + if d.angle_between(sun) < 0.04 {
                            500.0
                        } else {
                            0.0
                        },
                )
            })
            .collect();
        let found = find(&grid, &texels);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(found[0].direction.angle_between(sun) < 0.01);
        let expected = 500.0 * PI * 0.04 * 0.04;
        assert!(
            (found[0].flux.x / expected - 1.0).abs() < 0.12,
            "{}",
            found[0].flux.x / expected
        );
        assert!(found[0].solid_angle < 2.0 * PI * 0.04 * 0.04);
    }

    #[test]
    fn smooth_sky_has_no_sources() {
        let grid = CubeGrid::new(32);
        let sun = Vec3::new(0.4, -0.3, 0.6).normalize();
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|&d| Vec3::splat(sky(d, sun)))
            .collect();
        assert!(find(&grid, &texels).is_empty());
        assert!(find(&grid, &vec![Vec3::ONE; texels.len()]).is_empty());
        assert!(find(&grid, &vec![Vec3::ZERO; texels.len()]).is_empty());
    }

    #[test]
    fn two_lamps_are_two_sources() {
        let grid = CubeGrid::new(64);
        let lamp = |d: Vec3, at: Vec3, r: f32| d.angle_between(at.normalize()) < r;
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|&d| {
                let left = lamp(d, Vec3::new(1.0, 0.0, 0.8), 0.1);
                let right = lamp(d, Vec3::new(-1.0, 0.3, 0.8), 0.1);
                Vec3::splat(if left || right { 20.0 } else { 0.1 })
            })
            .collect();
        assert_eq!(find(&grid, &texels).len(), 2);
    }
}
