//! Irradiance of compact sources (sun, lamps, windows) at fixed points of surfaces. The stored directions
//! of the sky are too coarse for them: their shadows have edges, and near ones a place.

use super::obstacles::{Obstacles, Sight};
use glam::Vec3;
use penumbra_lighting::DomeLight;

/// Points of surfaces, and what blocks the light of each source there. It is found again only for
/// sources that have moved.
pub(super) struct CompactSources {
    /// World, metres, off the surface; unit normal.
    points: Vec<(Vec3, Vec3)>,
    sources: Vec<Source>,
}

struct Source {
    light: DomeLight,
    /// By point.
    sights: Vec<Sight>,
}

/// Irradiance at a point, RGB.
#[derive(Clone, Copy, Default)]
pub(super) struct Arriving {
    /// Without virtual objects.
    pub before: Vec3,
    /// With them.
    pub now: Vec3,
}

/// Cosine of the angle by which a source moves before its visibility is found again: a quarter of
/// a degree, the radius of the sun.
const MOVED: f32 = 0.999_99;

impl CompactSources {
    /// `offset`: distance of a ray's origin from its surface, metres.
    pub fn new(points: impl Iterator<Item = (Vec3, Vec3)>, offset: f32) -> Self {
        Self {
            points: points.map(|(p, n)| (p + n * offset, n)).collect(),
            sources: Vec::new(),
        }
    }

    /// Finds what blocks the light of `lights`; compact sources, by slot.
    pub fn update(&mut self, lights: &[DomeLight], obstacles: &Obstacles) {
        self.sources.truncate(lights.len());
        for (i, light) in lights.iter().enumerate() {
            let Some(source) = self.sources.get_mut(i) else {
                let sights = self.look(light, obstacles);
                let light = *light;
                self.sources.push(Source { light, sights });
                continue;
            };
            let is_dark = light.irradiance == Vec3::ZERO;
            source.light.irradiance = light.irradiance;
            if !is_dark && self.has_moved(&self.sources[i].light, light) {
                let sights = self.look(light, obstacles);
                self.sources[i] = Source {
                    light: *light,
                    sights,
                };
            }
        }
    }

    /// Whether a source has moved as seen from the first or from the last point.
    fn has_moved(&self, before: &DomeLight, now: &DomeLight) -> bool {
        let ends = self.points.first().into_iter().chain(self.points.last());
        let towards = |light: &DomeLight, p: Vec3| light.towards(p).normalize_or_zero();
        ends.into_iter()
            .any(|(p, _)| towards(before, *p).dot(towards(now, *p)) < MOVED)
    }

    fn look(&self, light: &DomeLight, obstacles: &Obstacles) -> Vec<Sight> {
        let place = light.place.position(light.direction);
        let each = self.points.iter().map(|(p, n)| {
            if light.facing(*p, *n) == 0.0 {
                return Sight::Hidden;
            }
            match place {
                Some(place) => obstacles.sight_of(*p, place),
                None => obstacles.sight_along(*p, light.direction),
            }
        });
        each.collect()
    }

    /// Irradiance at a point; none at an unknown one.
    pub fn at(&self, point: usize) -> Arriving {
        let mut sum = Arriving::default();
        let Some((p, n)) = self.points.get(point) else {
            return sum;
        };
        for source in &self.sources {
            let sight = source.sights.get(point).copied();
            let sight = sight.unwrap_or(Sight::Hidden);
            if sight == Sight::Hidden {
                continue;
            }
            let arriving = source.light.irradiance * source.light.facing(*p, *n);
            sum.before += arriving;
            if sight == Sight::Open {
                sum.now += arriving;
            }
        }
        sum
    }
}
