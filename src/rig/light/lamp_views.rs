//! Lamps that are seen from several points: by a mirrored ball that is carried about, and in the scene camera's
//! picture too.

use crate::light::bright_spots::{BrightSpot, BrightSpots};
use crate::light::view::SceneView;
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::place::LampDistance;
use penumbra_lighting::triangulation::{Sighting, Sightings, of_two};
use penumbra_rig_model::RigCalibration;
use penumbra_scene::RayCaster;

/// Standard deviation of a direction by calibration and poses, radians, and in pixels.
const ERROR: (f64, f64) = (0.004, 0.4);
/// The same of a spot's direction, and the share of its radius.
const SPOT_ERROR: (f64, f64) = (0.003, 0.15);
/// By what factor a spot may be smaller or larger than the lamp seems to be from there.
const SIZE: (f64, f64) = (0.3, 3.0);
/// Share of the way to a lamp on which nothing may stand.
const CLEAR: f64 = 0.95;
/// Distance of a lamp that is taken to be infinitely far, metres.
const FAR: f64 = 100.0;

/// How the environment is seen.
enum Optics {
    Nothing,
    /// Angle of a pixel, radians.
    Direct(f64),
    /// In a mirrored sphere: its radius, and the other camera's focal length, pixels, and place.
    Mirrored(f64, Option<(f64, DVec3)>),
}

/// Where each lamp has been seen from.
pub(super) struct LampViews {
    optics: Optics,
    lamps: Vec<(u32, Sightings)>,
    spots: BrightSpots,
    /// Instant of the last picture.
    last: Option<MonotonicTime>,
}

impl LampViews {
    pub fn new(rig: &RigCalibration) -> Self {
        let optics = match rig.environment.as_ref().map(|e| &e.view) {
            Some(EnvironmentView::Fisheye { lens, .. }) => Optics::Direct(lens.focal.recip()),
            Some(EnvironmentView::Sphere {
                camera,
                world_from_camera,
                sphere,
            }) => Optics::Mirrored(
                sphere.radius,
                Some((camera.focal.x, world_from_camera.translation)),
            ),
            Some(EnvironmentView::SphereInScene { sphere }) => {
                Optics::Mirrored(sphere.radius, None)
            }
            None => Optics::Nothing,
        };
        Self {
            optics,
            lamps: Vec::new(),
            spots: BrightSpots::default(),
            last: None,
        }
    }

    /// Notes from where the lamps are seen now. Returns those that have moved.
    pub fn see(
        &mut self,
        scene: &SceneView<'_>,
        (sources, observer): (&[CompactSource], DVec3),
        rays: &RayCaster,
    ) -> Vec<u32> {
        if self.last.replace(scene.captured_at) == Some(scene.captured_at) {
            return Vec::new();
        }
        let is_there = |id: u32| sources.iter().any(|s| s.id == id);
        self.lamps.retain(|(id, _)| is_there(*id));
        let mut moved = Vec::new();
        let all = sources.iter().filter(|s| !s.is_unseen);
        let seen: Vec<(&CompactSource, Sighting)> = all
            .filter_map(|s| Some((s, self.sighting(s, observer, scene)?)))
            .collect();
        for (source, sighting) in &seen {
            self.add(source.id, *sighting, &mut moved);
        }
        if let Some(pose) = scene.world_from_camera.filter(|_| !seen.is_empty()) {
            self.spots.find(scene, pose);
            for (id, sighting) in self.in_picture(&seen, pose, rays) {
                self.add(id, sighting, &mut moved);
            }
        }
        moved
    }

    /// Returns a lamp's distance by its views, and whether it was seen from more than two places; `None` if they
    /// tell nothing.
    pub fn distance(
        &self,
        source: &CompactSource,
        observer: DVec3,
    ) -> Option<(LampDistance, bool)> {
        let (_, sightings) = self.lamps.iter().find(|(id, _)| *id == source.id)?;
        let from = observer + source.viewpoint.as_dvec3();
        let distance = sightings.distance(from, source.direction.as_dvec3().normalize())?;
        Some((distance, sightings.places() > 2))
    }

    /// Forgets what was seen of a lamp.
    pub fn forget(&mut self, id: u32) {
        self.lamps.retain(|(known, _)| *known != id);
    }

    fn add(&mut self, id: u32, sighting: Sighting, moved: &mut Vec<u32>) {
        match self.lamps.iter_mut().find(|(known, _)| *known == id) {
            Some((_, sightings)) => {
                if !sightings.add(sighting) {
                    moved.push(id);
                }
            }
            None => {
                let mut sightings = Sightings::default();
                sightings.add(sighting);
                self.lamps.push((id, sightings));
            }
        }
    }

    /// A source as the environment camera sees it.
    fn sighting(
        &self,
        source: &CompactSource,
        observer: DVec3,
        scene: &SceneView<'_>,
    ) -> Option<Sighting> {
        let direction = source.direction.as_dvec3().try_normalize()?;
        let pixel = match self.optics {
            Optics::Nothing => return None,
            Optics::Direct(pixel) => pixel,
            Optics::Mirrored(radius, camera) => {
                let of_scene = || {
                    let pose = scene.world_from_camera?;
                    Some((scene.camera.focal.x, pose.translation))
                };
                let (focal, eye) = camera.or_else(of_scene)?;
                let to_eye = eye - observer;
                // The mirror's normal is between both.
                let incidence = 0.5 * to_eye.angle_between(direction);
                2.0 * to_eye.length() / (focal * radius * incidence.cos().max(0.2))
            }
        };
        Some(Sighting {
            from: observer + source.viewpoint.as_dvec3(),
            direction,
            sigma: ERROR.0.hypot(ERROR.1 * pixel),
        })
    }

    /// Finds the lamps in the scene camera's picture: a spot on the line on which a lamp must lie, as large as it must
    /// be there, with nothing known before it, and no other one.
    fn in_picture(
        &self,
        seen: &[(&CompactSource, Sighting)],
        pose: RigidTransform,
        rays: &RayCaster,
    ) -> Vec<(u32, Sighting)> {
        let mut pairs = Vec::new();
        for (source, from_there) in seen {
            for (k, spot) in self.spots.found.iter().enumerate() {
                let here = Sighting {
                    from: pose.translation,
                    direction: spot.direction,
                    sigma: SPOT_ERROR.0.hypot(SPOT_ERROR.1 * spot.radius),
                };
                if is_lamp(spot, &here, (source, from_there), rays) {
                    pairs.push((source.id, k, here));
                }
            }
        }
        let is_only = |pair: &&(u32, usize, Sighting)| {
            let same = |other: &&(u32, usize, Sighting)| other.0 == pair.0 || other.1 == pair.1;
            pairs.iter().filter(same).count() == 1
        };
        let only = pairs.iter().filter(is_only);
        only.map(|(id, _, sighting)| (*id, *sighting)).collect()
    }
}

/// Whether a spot in the scene camera's picture, seen from `here`, may be a lamp that the environment camera sees.
fn is_lamp(
    spot: &BrightSpot,
    here: &Sighting,
    (source, from_there): (&CompactSource, &Sighting),
    rays: &RayCaster,
) -> bool {
    let Some(distance) = of_two(*from_there, *here) else {
        return false;
    };
    let away = f64::from(distance.inverse).max(FAR.recip()).recip();
    let lamp = from_there.from + from_there.direction * away;
    let to = lamp - here.from;
    let expected = f64::from(source.angular_radius) * away / to.length();
    let is_large = (SIZE.0..SIZE.1).contains(&(spot.radius / expected));
    is_large && !rays.is_blocked(here.from, to, CLEAR)
}

#[cfg(test)]
mod tests;
