//! Irradiance of virtual lights at fixed points of surfaces.

use super::obstacles::Obstacles;
use crate::lamps::PlacedLamp;
use glam::Vec3;

/// Points of an area light that are tested for visibility; each stands for a quarter of it.
const AREA_POINTS: [(f32, f32); 4] = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];

/// Points of surfaces, and the irradiance of virtual lights there. What a light reaches is found
/// again only where the light has moved.
pub(super) struct Lamplight {
    /// World, metres, off the surface; unit normal.
    points: Vec<(Vec3, Vec3)>,
    reached: Vec<Reached>,
    /// Irradiance at each point, scene camera units.
    irradiance: Vec<Vec3>,
}

/// What one virtual light reaches.
struct Reached {
    from: Vec<Vec3>,
    /// By point: a bit for each element of `from` that is visible.
    visible: Vec<u8>,
}

impl Lamplight {
    /// `offset`: distance of a ray's origin from its surface, metres.
    pub fn new(points: impl Iterator<Item = (Vec3, Vec3)>, offset: f32) -> Self {
        let points: Vec<_> = points.map(|(p, n)| (p + n * offset, n)).collect();
        Self {
            reached: Vec::new(),
            irradiance: vec![Vec3::ZERO; points.len()],
            points,
        }
    }

    /// Irradiance at a point; none at an unknown one.
    pub fn at(&self, point: usize) -> Vec3 {
        self.irradiance.get(point).copied().unwrap_or(Vec3::ZERO)
    }

    /// Computes the irradiance under `lamps`.
    pub fn update(&mut self, lamps: &[PlacedLamp], obstacles: &Obstacles) {
        self.irradiance.fill(Vec3::ZERO);
        self.reached.resize_with(lamps.len(), || Reached {
            from: Vec::new(),
            visible: Vec::new(),
        });
        for (lamp, reached) in lamps.iter().zip(&mut self.reached) {
            reached.look(&self.points, emitters(lamp), obstacles);
            let share = 1.0 / reached.from.len() as f32;
            let each = self.points.iter().zip(&reached.visible);
            for ((point, visible), sum) in each.zip(&mut self.irradiance) {
                let seen = reached.from.iter().enumerate();
                let seen = seen.filter(|(k, _)| visible >> k & 1 == 1);
                let factor: f32 = seen.map(|(_, from)| arriving(lamp, *from, *point)).sum();
                *sum += lamp.intensity * (factor * share);
            }
        }
    }
}

impl Reached {
    fn look(&mut self, points: &[(Vec3, Vec3)], from: Vec<Vec3>, obstacles: &Obstacles) {
        if self.from == from {
            return;
        }
        self.visible.clear();
        self.visible.extend(points.iter().map(|(p, n)| {
            let sees = |to: &Vec3| n.dot(*to - *p) > 0.0 && obstacles.is_clear(*p, *to);
            let bits = from.iter().enumerate();
            bits.fold(0, |all, (k, to)| all | u8::from(sees(to)) << k)
        }));
        self.from = from;
    }
}

/// Points that stand for equal parts of a lamp.
fn emitters(lamp: &PlacedLamp) -> Vec<Vec3> {
    let Some(area) = lamp.area else {
        return vec![lamp.position];
    };
    AREA_POINTS
        .map(|(x, y)| lamp.position + area.half_right * x + area.half_up * y)
        .to_vec()
}

/// Irradiance at a point (position, normal) by an unobstructed lamp at `from`, as a share of its
/// intensity, 1/m²: `falloff · cos θ / r²`, for areas times the cosine at the area.
fn arriving(lamp: &PlacedLamp, from: Vec3, (point, normal): (Vec3, Vec3)) -> f32 {
    let away = point - from;
    let squared = away.length_squared().max(1e-6);
    let away = away / squared.sqrt();
    let emitted = match lamp.area {
        Some(area) if area.two_sided => lamp.direction.dot(away).abs(),
        Some(_) => lamp.direction.dot(away).max(0.0),
        None => lamp.falloff(away),
    };
    emitted * (-normal.dot(away)).max(0.0) / squared
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lamps::PlacedArea;
    use crate::scene::Scene;
    use crate::{Part, primitives};
    use glam::{DMat4, DVec3};

    const POINT: PlacedLamp = PlacedLamp {
        position: Vec3::new(0.0, 0.0, 0.5),
        direction: Vec3::NEG_Z,
        intensity: Vec3::new(2.0, 1.0, 0.5),
        cone: None,
        area: None,
    };

    fn irradiance(scene: &Scene, lamp: PlacedLamp, points: &[Vec3]) -> Vec<Vec3> {
        let obstacles = Obstacles::new(scene, &[], [Vec3::NEG_INFINITY, Vec3::INFINITY]);
        let on_ground = points.iter().map(|p| (*p, Vec3::Z));
        let mut light = Lamplight::new(on_ground, 1e-4);
        light.update(&[lamp], &obstacles);
        (0..points.len()).map(|i| light.at(i)).collect()
    }

    fn ground() -> Scene {
        Scene {
            ground_height: Some(0.0),
            ..Scene::default()
        }
    }

    #[test]
    fn point_lights_the_ground_by_distance_and_cosine() {
        let at = irradiance(&ground(), POINT, &[Vec3::ZERO, Vec3::X * 0.5]);
        let expected = [4.0, 4.0 / 8.0_f32.sqrt()].map(|e| POINT.intensity * e);
        for (found, expected) in at.iter().zip(expected) {
            assert!(
                found.distance(expected) < 3e-3 * expected.length(),
                "{found} {expected}"
            );
        }
    }

    #[test]
    fn area_far_away_is_a_lambertian_point() {
        let lamp = PlacedLamp {
            area: Some(PlacedArea {
                half_right: Vec3::X * 0.02,
                half_up: Vec3::Y * 0.02,
                two_sided: false,
                screen: 0,
            }),
            ..POINT
        };
        let found = irradiance(&ground(), lamp, &[Vec3::X * 0.5])[0];
        // cos⁴ of 45° by 1/h².
        assert!((found.x - 2.0).abs() < 0.02, "{found}");
        let from_behind = PlacedLamp {
            direction: Vec3::Z,
            ..lamp
        };
        assert_eq!(
            irradiance(&ground(), from_behind, &[Vec3::X])[0],
            Vec3::ZERO
        );
    }

    #[test]
    fn phantom_hides_a_lamp_and_what_moves_is_found_again() {
        let box_ = Part {
            name: "box".into(),
            mesh: primitives::cuboid(Vec3::splat(0.1)).into(),
            material: crate::Material::default().into(),
            world_from_part: DMat4::from_translation(DVec3::new(0.25, 0.0, 0.2)),
            mirror: false,
            albedo: None,
        };
        let scene = Scene {
            phantom_parts: vec![box_],
            ..ground()
        };
        let points = [Vec3::X * 0.5, Vec3::X * -0.5];
        let at = irradiance(&scene, POINT, &points);
        assert_eq!(at[0], Vec3::ZERO);
        assert!(at[1].x > 0.5);
        let obstacles = Obstacles::new(&scene, &[], [Vec3::NEG_INFINITY, Vec3::INFINITY]);
        let mut light = Lamplight::new(points.iter().map(|p| (*p, Vec3::Z)), 1e-4);
        let aside = PlacedLamp {
            position: Vec3::new(1.0, 0.0, 0.5),
            ..POINT
        };
        for (lamp, hidden) in [(POINT, 0), (aside, 1)] {
            light.update(&[lamp], &obstacles);
            assert_eq!(light.at(hidden), Vec3::ZERO);
            assert_ne!(light.at(1 - hidden), Vec3::ZERO);
        }
        light.update(&[], &obstacles);
        assert_eq!(light.at(0), Vec3::ZERO);
    }
}
