//! What points see of the sky past phantoms, and of phantoms in its place: real shadows are deeper beside
//! what casts them, because it hides a part of the sky, too.

use super::{SeenSurfaces, SurfacePoint};
use crate::cube::{spiral, tangent_frame};
use crate::light::Harmonics;
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// Radiance of the phantom that is met in a direction (second argument) from an origin (world, metres);
/// `None` where there is none.
pub type Occluders<'a> = dyn Fn(DVec3, DVec3) -> Option<Vec3> + 'a;

/// Directions in which a point looks.
const RAYS: usize = 24;
/// Points from one that looks to the next, in rows and in columns: what they see changes slowly.
const STEP: usize = 2;

/// What a point receives from the sky and from phantoms in its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Openness {
    /// Share of the light that phantoms leave, RGB.
    pub open: Vec3,
    /// Irradiance that they reflect instead of the rest.
    pub reflected: Vec3,
}

impl Openness {
    const ALL: Self = Self {
        open: Vec3::ONE,
        reflected: Vec3::ZERO,
    };
}

/// The openness of each point to `light`. What casts a shadow hides the bright part of the sky around the sun,
/// too.
pub(super) fn openness(
    surfaces: &SeenSurfaces,
    light: &Harmonics,
    occluders: &Occluders<'_>,
) -> Vec<Openness> {
    let (width, points) = (surfaces.width.max(1), &surfaces.points);
    let looks = |i: usize| (i % width).is_multiple_of(STEP) && (i / width).is_multiple_of(STEP);
    let looked = points.iter().enumerate();
    let looked = looked.map(|(i, point)| {
        let point = point.filter(|_| looks(i));
        point.map(|p| look(&p, light, occluders))
    });
    let looked: Vec<Option<Openness>> = looked.collect();
    let beside = |i: usize, p: &SurfacePoint| {
        let (x, y) = (i % width, i / width);
        let near = (y.saturating_sub(1)..=y + 1).flat_map(|v| {
            (x.saturating_sub(1)..=(x + 1).min(width - 1)).map(move |u| v * width + u)
        });
        mean(
            near.filter(|k| matches!(points.get(*k), Some(Some(q)) if q.is_beside(p)))
                .filter_map(|k| looked.get(k).copied().flatten()),
        )
    };
    let each = points.iter().enumerate().map(|(i, point)| {
        let known = looked[i].or_else(|| beside(i, point.as_ref()?));
        known.unwrap_or_else(|| point.map_or(Openness::ALL, |p| look(&p, light, occluders)))
    });
    each.collect()
}

fn mean(all: impl Iterator<Item = Openness>) -> Option<Openness> {
    let (mut open, mut reflected, mut count) = (Vec3::ZERO, Vec3::ZERO, 0.0);
    for seen in all {
        open += seen.open;
        reflected += seen.reflected;
        count += 1.0;
    }
    (count > 0.0).then(|| Openness {
        open: open / count,
        reflected: reflected / count,
    })
}

fn look(point: &SurfacePoint, light: &Harmonics, occluders: &Occluders<'_>) -> Openness {
    let (right, up) = tangent_frame(point.normal);
    let origin = point.position + 1e-3 * point.normal.as_dvec3();
    let (mut reflected, mut open, mut all) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
    for k in 0..RAYS {
        let share = (k as f32 + 0.5) / RAYS as f32;
        let (sin, cos) = spiral(k);
        let across = (right * cos + up * sin) * share.sqrt();
        let towards = across + point.normal * (1.0 - share).sqrt();
        let radiance = light.radiance(towards).max(Vec3::splat(1e-9));
        all += radiance;
        // What the ground reflects is not hidden by anything that stands on it.
        let met = (towards.z > 0.0).then(|| occluders(origin, towards.as_dvec3()));
        match met.flatten() {
            Some(radiance) => reflected += radiance,
            None => open += radiance,
        }
    }
    Openness {
        open: open / all,
        reflected: PI / RAYS as f32 * reflected,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The wall x = 0, endless along y, hides ½ (1 − d/√(d² + h²)) of the sky from the ground at a distance d.
    #[test]
    fn wall_hides_its_form_factor_of_the_sky() {
        const HEIGHT: f64 = 2.0;
        let wall = |from: DVec3, to: DVec3| {
            let met = to.x < 0.0 && from.z - to.z * from.x / to.x < HEIGHT;
            met.then_some(Vec3::splat(0.5))
        };
        let mut even = Harmonics::default();
        even.coefficients[0] = Vec3::ONE;
        let point = |x: usize| SurfacePoint {
            position: DVec3::new(0.5 * x as f64 + 0.25, 0.0, 0.0),
            normal: Vec3::Z,
            log_values: [0.0; 4],
            surface: 0,
        };
        let surfaces = SeenSurfaces {
            width: 8,
            points: (0..8).map(|x| Some(point(x))).collect(),
        };
        for (x, seen) in openness(&surfaces, &even, &wall).into_iter().enumerate() {
            let d = point(x).position.x;
            let hidden = 0.5 * (1.0 - d / d.hypot(HEIGHT)) as f32;
            let lost = 1.0 - seen.open.x;
            assert!((lost - hidden).abs() < 0.06, "{d}: {seen:?} {hidden}");
            assert!((seen.reflected.x - lost * 0.5 * PI).abs() < 1e-5);
        }
        let none = SeenSurfaces {
            width: 8,
            points: vec![None; 8],
        };
        assert_eq!(openness(&none, &even, &wall), [Openness::ALL; 8]);
    }

    #[test]
    fn wall_hides_more_of_a_sky_that_is_brighter_behind_it() {
        let wall = |from: DVec3, to: DVec3| {
            let met = to.x < 0.0 && from.z - to.z * from.x / to.x < 2.0;
            met.then_some(Vec3::ZERO)
        };
        let point = SurfacePoint {
            position: DVec3::new(0.5, 0.0, 0.0),
            normal: Vec3::Z,
            log_values: [0.0; 4],
            surface: 0,
        };
        let surfaces = SeenSurfaces {
            width: 1,
            points: vec![Some(point)],
        };
        // L(d) = (1 + 0.9 d·(±x)) / π
        let open = |x: f32| {
            let mut sky = Harmonics::default();
            sky.coefficients[0] = Vec3::ONE;
            sky.coefficients[3] = Vec3::splat(0.6 * x);
            openness(&surfaces, &sky, &wall)[0].open.x
        };
        let (behind, even, before) = (open(-1.0), open(0.0), open(1.0));
        assert!(
            behind < even - 0.1 && before > even + 0.1,
            "{behind} {even} {before}"
        );
    }
}
