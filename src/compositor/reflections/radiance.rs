//! Radiance of what mirror rays meet, as far as the camera does not see it.

use super::super::frame_input::FrameInput;
use super::nearby_scene::Surface;
use glam::{UVec3, Vec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_lighting::compact_source_specular::CompleteMap;
use penumbra_lighting::{LightKind, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::IndirectLight;
use penumbra_scene::indirect_light::{GROUND_SIDE, NearbyRadiance, side_of};
use std::f32::consts::PI;
use std::sync::Arc;

/// Ratio of the distance within which points count to their mean distance.
const REACH: f32 = 2.0;
/// Most cells of a grid along each axis.
const CELLS: f32 = 32.0;

/// Points of virtual surfaces, sorted into cells as long as the distance within which they count.
#[derive(Default)]
pub struct PointGrid {
    of: Arc<Vec<(Vec3, Vec3)>>,
    low: Vec3,
    /// Cells per metre, and along each axis.
    scale: f32,
    size: UVec3,
    /// By cell, the first of `points`.
    firsts: Vec<u32>,
    points: Vec<u32>,
}

impl PointGrid {
    /// Sorts the points of `nearby`, unless that was done.
    pub fn fit(&mut self, nearby: &NearbyRadiance) {
        if Arc::ptr_eq(&self.of, &nearby.points) {
            return;
        }
        let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
        let positions = || nearby.points.iter().map(|(p, _)| *p);
        let (low, high) = positions().fold(nothing, |(l, h), p| (l.min(p), h.max(p)));
        self.of = Arc::clone(&nearby.points);
        self.firsts.clear();
        self.points.clear();
        if nearby.points.is_empty() {
            return;
        }
        let cell = (REACH * nearby.spacing).max((high - low).max_element() / CELLS);
        (self.low, self.scale) = (low, 1.0 / cell.max(1e-9));
        self.size = ((high - low) * self.scale).as_uvec3() + 1;
        // Sorted by counting: this runs between two frames.
        let cells: Vec<usize> = positions().map(|p| self.cell(p)).collect();
        let count = self.size.element_product() as usize;
        self.firsts.resize(count + 1, 0);
        cells.iter().for_each(|cell| self.firsts[cell + 1] += 1);
        for cell in 0..count {
            self.firsts[cell + 1] += self.firsts[cell];
        }
        let mut next = self.firsts.clone();
        self.points.resize(cells.len(), 0);
        for (cell, i) in cells.into_iter().zip(0..) {
            self.points[next[cell] as usize] = i;
            next[cell] += 1;
        }
    }

    fn cell(&self, p: Vec3) -> usize {
        let at = ((p - self.low) * self.scale).max(Vec3::ZERO).as_uvec3();
        let at = at.min(self.size - 1);
        ((at.z * self.size.y + at.y) * self.size.x + at.x) as usize
    }

    /// The mean of `values` at the points around `p` that face like `n`; `None` without any.
    fn mean(&self, values: &[Vec3], p: Vec3, n: Vec3) -> Option<Vec3> {
        let at = (p - self.low) * self.scale;
        if self.points.is_empty() || at.cmplt(Vec3::NEG_ONE).any() {
            return None;
        }
        let last = (self.size - 1).as_ivec3();
        let (from, to) = (
            (at.floor().as_ivec3() - 1).max(glam::IVec3::ZERO),
            (at.floor().as_ivec3() + 1).min(last),
        );
        let (mut sum, mut weight) = (Vec3::ZERO, 0.0);
        for z in from.z..=to.z {
            for y in from.y..=to.y {
                let row = (z * last.y + z + y) * (last.x + 1);
                for x in from.x..=to.x {
                    let cell = (row + x) as usize;
                    let (first, end) = (self.firsts[cell], self.firsts[cell + 1]);
                    for i in &self.points[first as usize..end as usize] {
                        let (position, normal) = self.of[*i as usize];
                        let far = ((position - p) * self.scale).length_squared();
                        let w = (1.0 - far).max(0.0).powi(2) * normal.dot(n).max(0.0);
                        sum += values.get(*i as usize).copied().unwrap_or_default() * w;
                        weight += w;
                    }
                }
            }
        }
        (weight > 1e-4).then(|| sum / weight)
    }
}

/// The light of a frame.
pub struct NearbyLight<'a> {
    lighting: &'a Lighting,
    sky: CompleteMap<'a>,
    indirect: Option<&'a IndirectLight>,
    points: &'a PointGrid,
    picture: &'a Picture,
    response: &'a Response,
    camera: &'a PinholeCamera,
    camera_from_world: RigidTransform,
    vignetting: Option<penumbra_camera::Vignetting>,
}

impl<'a> NearbyLight<'a> {
    /// The light of `input`, of whose indirect light `points` are sorted; `None` where virtual
    /// objects are not shown.
    pub fn new(
        input: &'a FrameInput<'_>,
        response: &'a Response,
        points: &'a PointGrid,
    ) -> Option<Self> {
        let lighting = input.lighting?;
        Some(Self {
            lighting,
            sky: CompleteMap::new(&lighting.radiance),
            indirect: input.indirect_light.filter(|light| light.generation != 0),
            points,
            picture: input.picture,
            response,
            camera: input.camera,
            camera_from_world: input.world_from_camera?.inverse(),
            vignetting: input.vignetting,
        })
    }

    /// Light that a virtual surface reflects diffusely or emits.
    pub fn diffuse(&self, p: Vec3, n: Vec3, surface: &Surface) -> Vec3 {
        let known = self.indirect.and_then(|light| {
            let nearby = &light.nearby;
            self.points.mean(&nearby.diffuse, p, n)
        });
        known.unwrap_or_else(|| surface.emissive + surface.diffuse * self.irradiance(p, n) / PI)
    }

    /// All light of a virtual surface, with specular reflection as if it were diffuse.
    pub fn total(&self, p: Vec3, n: Vec3, surface: &Surface) -> Vec3 {
        let known = self.indirect.and_then(|light| {
            let nearby = &light.nearby;
            self.points.mean(&nearby.total, p, n)
        });
        known.unwrap_or_else(|| {
            surface.emissive + (surface.diffuse + surface.f0) * self.irradiance(p, n) / PI
        })
    }

    /// Irradiance of a surface from which nothing is hidden.
    fn irradiance(&self, p: Vec3, n: Vec3) -> Vec3 {
        let compact = self.lighting.lights.iter();
        let compact = compact.filter(|light| light.kind == LightKind::Compact);
        let direct: Vec3 = compact
            .map(|light| light.irradiance * light.facing(p, n))
            .sum();
        direct + self.lighting.irradiance.irradiance(n)
    }

    /// Mean radiance of the side of a phantom.
    pub fn phantom(&self, number: u32, n: Vec3) -> Vec3 {
        let sides = self
            .indirect
            .and_then(|light| light.nearby.phantoms.get(number as usize));
        match sides {
            Some(sides) => sides[side_of(n) as usize],
            None => self.lighting.ground_radiance,
        }
    }

    /// Radiance of the ground: the camera's picture where it shows that, else the mean; with the
    /// shadows of virtual objects.
    pub fn ground(&self, p: Vec3) -> Vec3 {
        let in_camera = self.camera_from_world.transform_point(p.as_dvec3());
        let seen = self.camera.project(in_camera).filter(|_| in_camera.z > 0.0);
        let colour = seen.and_then(|pixel| {
            let (x, y) = (pixel.x.round(), pixel.y.round());
            let is_inside = x >= 0.0
                && y >= 0.0
                && x < f64::from(self.picture.width)
                && y < f64::from(self.picture.height);
            is_inside.then(|| {
                let codes = self.picture.rgb(x as u32, y as u32);
                let brightness = self.vignetting.map_or(1.0, |v| v.at(pixel)).max(0.02);
                Vec3::from(self.response.linear_from_rgb(codes)) / brightness as f32
            })
        });
        colour.unwrap_or(self.lighting.ground_radiance) * self.ground_share(p)
    }

    /// Mean radiance of the ground, with the shadows of virtual objects.
    pub fn mean_ground(&self, p: Vec3) -> Vec3 {
        self.lighting.ground_radiance * self.ground_share(p)
    }

    fn ground_share(&self, p: Vec3) -> Vec3 {
        let share = self.indirect.and_then(|light| {
            let at = (p - light.low).truncate() / (light.high - light.low).truncate();
            if at.min_element() < 0.0 || at.max_element() >= 1.0 {
                return None;
            }
            let cell = (at * GROUND_SIDE as f32).as_uvec2();
            let cell = (cell.y * GROUND_SIDE + cell.x) as usize;
            light.nearby.ground.get(cell).copied()
        });
        share.unwrap_or(Vec3::ONE)
    }

    /// Radiance of the environment that arrives at `p`, blurred by a lobe of about `width`; that of
    /// lamps by `spread` at least.
    pub fn sky(&self, p: Vec3, direction: Vec3, width: f32, spread: f32) -> Vec3 {
        self.sky.blurred(p, direction, width, spread)
    }
}
