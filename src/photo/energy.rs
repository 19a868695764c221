//! What the ball's shadow tells: how bright lamps are that are white in its darkest picture, and how the ground lies.

use crate::placement::GroundFrom;
use crate::session::{Crop, cropped};
use crate::shadow::{KnownLight, WHITE};
use crate::{Analysis, BallPicture};
use glam::{DVec2, Vec3};
use penumbra_lighting::Harmonics;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::lamp_distance::SeenLamp;
use penumbra_lighting::place::LampDistance;
use penumbra_lighting::sources::LUMINANCE;
use penumbra_picture::Picture;

/// Largest angle between a white pixel and the lamp to which it belongs, radians.
const NEAR: f32 = 0.35;
/// Largest angle between pixels of one lamp, radians, and largest angular radius of a lamp.
const BESIDE: f32 = 0.12;
const WIDEST: f32 = 0.5;
/// Cells of the ball's picture along each side, in which white pixels count together.
const CELLS: u32 = 64;
/// Number of lamps, the strongest, and number of directions to one.
const LAMPS: usize = 8;
const PARTS: usize = 32;
/// Factor up to which nothing changes.
const SETTLED: f32 = 1.03;
/// Value of the brightest pixel in the exposure that raised lamps are written as; 1 is white.
const BRIGHTEST: f32 = 0.8;

/// A lamp that is brighter than the ball's darkest picture can show.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RaisedLamp {
    /// Unit vector from the ball, world.
    pub direction: Vec3,
    /// Factor on its white pixels, RGB, at least 1.
    pub factor: Vec3,
    /// Standard error of the largest of these.
    pub sigma: f32,
}

impl Analysis {
    /// Learns from the ball's shadow in the photographs what they do not tell otherwise: how the ground lies,
    /// and how bright lamps are that are white in the darkest picture of the ball. `lamps`, strongest first, and
    /// the `irradiance` of the rest are the light of the session that was written last. Returns whether it has
    /// to be written again.
    pub fn learn_from_shadow(&mut self, lamps: &[SeenLamp], irradiance: &Harmonics) -> bool {
        let (lamps, white) = self.with_white_lamps(lamps);
        let least = white
            .iter()
            .map(|(k, known)| (*k, known.min_element().recip()));
        let light = KnownLight {
            lamps: &lamps,
            irradiance,
            unknown: &least.collect::<Vec<_>>(),
        };
        if self.placement.ground == GroundFrom::Assumed
            && let Some(placement) = self.placement_by_shadow(&light)
        {
            let before = self.placement.world_from_camera.rotation.inverse();
            let turned = (placement.world_from_camera.rotation * before).as_quat();
            self.placement = placement;
            self.raised
                .iter_mut()
                .for_each(|r| r.direction = turned * r.direction);
            return true;
        }
        let told = (!white.is_empty()).then(|| self.factors_by_shadow(&light));
        let Some(told) = told.flatten() else {
            return false;
        };
        let raised = white
            .iter()
            .zip(&told)
            .map(|((k, known), told)| RaisedLamp {
                direction: lamps[*k].source.direction,
                factor: (*known * told.rgb).max(Vec3::ONE),
                sigma: told.sigma * known.max_element(),
            });
        self.raised = raised.collect();
        told.iter().any(|told| is_other(told.rgb))
    }

    /// Returns the lamps, with those that are only seen as white pixels; and the numbers of all that are white,
    /// with the factors that are in their light.
    fn with_white_lamps(&self, lamps: &[SeenLamp]) -> (Vec<SeenLamp>, Vec<(usize, Vec3)>) {
        let (mut all, mut white) = (lamps.to_vec(), Vec::<(usize, Vec3)>::new());
        for lamp in self.white_lamps() {
            let direction = lamp.source.direction;
            let reach = |l: &SeenLamp| lamp.source.angular_radius.max(l.source.angular_radius);
            let is_same =
                |l: &SeenLamp| l.source.direction.angle_between(direction) < BESIDE + reach(l);
            let k = all.iter().position(is_same).unwrap_or(all.len());
            if k == all.len() {
                all.push(lamp);
            }
            if white.iter().all(|(other, _)| *other != k) {
                let raised = self.raised_beside(direction);
                white.push((k, raised.map_or(Vec3::ONE, |r| r.factor)));
            }
        }
        (all, white)
    }

    /// Returns lamps that are white in the ball's darkest picture, with the light that they are known to have.
    pub(crate) fn white_lamps(&self) -> Vec<SeenLamp> {
        let Some((darkest, crop)) = self.by_exposure().pop().map(|b| (b, self.crop_of(b))) else {
            return Vec::new();
        };
        let picture = cropped(&darkest.photograph.picture, &crop);
        let gain = (-darkest.ev as f32).exp2();
        let reflectance = Vec3::from(self.reflectance);
        // Where a sky is white there are many white pixels: those of a cell count together.
        let cell = picture.width.max(picture.height).div_ceil(CELLS).max(1);
        let mut cells = vec![(Vec3::ZERO, Vec3::ZERO); (CELLS * CELLS) as usize];
        for (x, y) in (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (x, y))) {
            let codes = picture.rgb(x, y);
            if codes.iter().all(|code| *code < WHITE) {
                continue;
            }
            let direction = |x: u32, y: u32| self.mirrored_at(darkest, &crop, (x, y));
            let all = (direction(x, y), direction(x + 1, y), direction(x, y + 1));
            let (Some(here), Some(right), Some(below)) = all else {
                continue;
            };
            let solid_angle = (right - here).cross(below - here).length();
            let factor = self.raised_beside(here).map_or(Vec3::ONE, |r| r.factor);
            let light =
                Vec3::from(self.tone.response.linear_from_rgb(codes)) * gain * factor / reflectance;
            let (direction, sum) = &mut cells[(y / cell * CELLS + x / cell) as usize];
            *direction += here;
            *sum += light * solid_angle;
        }
        let seen = cells.into_iter().filter_map(|(direction, light)| {
            let direction = direction.try_normalize()?;
            (light != Vec3::ZERO).then_some((direction, light))
        });
        let seen: Vec<(Vec3, Vec3)> = seen.collect();
        let lamps = clusters(seen).into_iter().filter_map(|c| lamp_of(&c));
        let mut lamps: Vec<SeenLamp> = lamps.collect();
        let strength = |lamp: &SeenLamp| lamp.source.irradiance.dot(LUMINANCE);
        lamps.sort_by(|a, b| strength(b).total_cmp(&strength(a)));
        lamps.truncate(LAMPS);
        lamps
    }

    fn raised_beside(&self, direction: Vec3) -> Option<&RaisedLamp> {
        let angle = |lamp: &RaisedLamp| lamp.direction.angle_between(direction);
        let near = self.raised.iter().filter(|lamp| angle(lamp) < NEAR);
        near.min_by(|a, b| angle(a).total_cmp(&angle(b)))
    }

    /// Returns the picture of the ball that a still darker exposure would show, with its exposure in stops
    /// relative to the picture without the ball; `None` if no lamp is brighter than it looks.
    pub(crate) fn darker(&self) -> Option<(Picture, f64)> {
        if !self.raised.iter().any(|lamp| is_other(lamp.factor)) {
            return None;
        }
        let darkest = self.by_exposure().pop()?;
        let crop = self.crop_of(darkest);
        let mut picture = cropped(&darkest.photograph.picture, &crop);
        let response = &self.tone.response;
        let light = |x: u32, y: u32| {
            let codes = picture.rgb(x, y);
            let light = Vec3::from(response.linear_from_rgb(codes));
            if codes.iter().all(|code| *code < WHITE) {
                return light;
            }
            let direction = self.mirrored_at(darkest, &crop, (x, y));
            let lamp = direction.and_then(|direction| self.raised_beside(direction));
            light * lamp.map_or(Vec3::ONE, |lamp| lamp.factor)
        };
        let pixels = (0..picture.height).flat_map(|y| (0..picture.width).map(move |x| (x, y)));
        let lights: Vec<Vec3> = pixels.map(|(x, y)| light(x, y)).collect();
        let brightest = lights.iter().map(|l| l.max_element()).fold(1.0, f32::max);
        let darker = BRIGHTEST / brightest;
        for (pixel, light) in picture.rgba.chunks_exact_mut(4).zip(&lights) {
            let codes = (*light * darker).to_array();
            pixel[..3].copy_from_slice(&codes.map(|l| response.code_from_linear(l)));
        }
        Some((picture, darkest.ev + f64::from(darker.log2())))
    }

    /// Returns the direction that a pixel of a part of a picture of the ball shows.
    fn mirrored_at(&self, ball: &BallPicture, crop: &Crop, (x, y): (u32, u32)) -> Option<Vec3> {
        let at = DVec2::new(f64::from(x), f64::from(y));
        let pixel = (at + 0.5) * f64::from(crop.factor) - 0.5 + crop.origin();
        self.mirrored(pixel - ball.shift.as_dvec2())
    }

    /// Returns the direction, world, that the ball shows at a pixel of the picture without it.
    fn mirrored(&self, pixel: DVec2) -> Option<Vec3> {
        let pose = self.placement.world_from_camera;
        let ray = pose.rotation * self.camera.unproject(pixel);
        let mirrored = self
            .ball_at(&self.placement)
            .reflected(pose.translation, ray)?;
        Some(mirrored.as_vec3())
    }
}

/// Groups directions with their light by nearness.
fn clusters(mut seen: Vec<(Vec3, Vec3)>) -> Vec<Vec<(Vec3, Vec3)>> {
    let mut all = Vec::new();
    while let Some(first) = seen.pop() {
        let mut cluster = vec![first];
        let mut next = 0;
        while next < cluster.len() {
            let at = cluster[next].0;
            let is_beside = |one: &mut (Vec3, Vec3)| one.0.dot(at) > BESIDE.cos();
            cluster.extend(seen.extract_if(.., is_beside));
            next += 1;
        }
        all.push(cluster);
    }
    all
}

/// Returns the lamp that a group of pixels shows; `None` if it is too wide.
fn lamp_of(cluster: &[(Vec3, Vec3)]) -> Option<SeenLamp> {
    let light: Vec3 = cluster.iter().map(|(_, light)| *light).sum();
    let middle: Vec3 = cluster
        .iter()
        .map(|(at, light)| at * light.dot(LUMINANCE))
        .sum();
    let direction = middle.try_normalize()?;
    let squares = cluster
        .iter()
        .map(|(at, light)| light.dot(LUMINANCE) * at.angle_between(direction).powi(2));
    let mean = squares.sum::<f32>() / light.dot(LUMINANCE).max(1e-12);
    // Of a disc, the mean square of the distance from its centre is half that of its radius.
    let angular_radius = (2.0 * mean).sqrt();
    let count = cluster.len().min(PARTS);
    let parts = (0..count).map(|k| cluster[(2 * k + 1) * cluster.len() / (2 * count)].0);
    (angular_radius < WIDEST).then(|| SeenLamp {
        source: CompactSource {
            id: u32::MAX,
            viewpoint: Vec3::ZERO,
            direction,
            irradiance: light,
            angular_radius,
            distance: LampDistance::FAR,
            position: None,
            clipped: 1.0,
            lights: 1,
            is_unseen: false,
        },
        parts: parts.collect(),
        is_energy_unknown: false,
    })
}

fn is_other(factor: Vec3) -> bool {
    factor.max_element() > SETTLED || factor.min_element() < SETTLED.recip()
}
