//! Directions of the lights of both cameras: averaged over pictures, reflected in a mirrored sphere,
//! and triangulated where they are not distant.

use super::bright_pixels::{BrightPixels, Light};
use super::light_matching::LightDirection;
use super::resection::Target;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::MirrorSphere;
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_numerics::median;

/// Minimum share of the pictures in which a light must be visible.
const MIN_SHARE: f64 = 0.3;
/// Minimum standard deviation of a light's centre, radians: its shape varies between pictures.
const MIN_SIGMA: f64 = 2e-3;
/// Minimum cosine of incidence of a usable reflection.
pub(super) const MIN_COSINE: f64 = 0.35;

/// A light seen from one position.
#[derive(Clone, Copy, Debug)]
pub struct LightRay {
    /// Position of the observer, world, metres.
    pub from: DVec3,
    /// Unit vector, world.
    pub direction: DVec3,
    /// Radius of a disc of equal solid angle, radians.
    pub radius: f64,
}

/// Returns the direction that a ray is reflected to by a mirrored sphere, all in one frame; the ray is a
/// unit vector from the origin. `None` if it misses the sphere or meets it at a grazing angle.
#[must_use]
pub fn mirrored(ray: DVec3, centre: DVec3, radius: f64) -> Option<DVec3> {
    let along = ray.dot(centre);
    let inside = radius * radius - (centre.length_squared() - along * along);
    if along <= 0.0 || inside <= 0.0 {
        return None;
    }
    let normal = (ray * (along - inside.sqrt()) - centre) / radius;
    let cosine = -ray.dot(normal);
    (cosine > MIN_COSINE).then(|| ray + 2.0 * cosine * normal)
}

/// Returns the lights, with their pixels, that a static camera saw in at least [`MIN_SHARE`] of its
/// pictures.
#[must_use]
pub fn static_lights(
    pictures: &[BrightPixels],
    direction: &dyn Fn(DVec2) -> Option<DVec3>,
) -> Vec<(LightDirection, DVec2)> {
    let mut groups: Vec<Vec<Light>> = Vec::new();
    for light in pictures.iter().flat_map(|p| p.lights(direction)) {
        let near = |g: &&mut Vec<Light>| {
            g[0].direction.angle_between(light.direction) < 0.035 + 0.5 * light.radius()
        };
        match groups.iter_mut().find(near) {
            Some(group) => group.push(light),
            None => groups.push(vec![light]),
        }
    }
    groups.retain(|g| g.len() as f64 >= (MIN_SHARE * pictures.len() as f64).max(1.0));
    let beam = |group: &Vec<Light>| {
        let sum: DVec3 = group.iter().map(|l| l.direction).sum();
        let mean = sum.try_normalize()?;
        let n = group.len() as f64;
        let spread = group
            .iter()
            .map(|l| l.direction.angle_between(mean).powi(2))
            .sum::<f64>()
            / n;
        // A lamp that moved is rejected.
        (spread.sqrt() < 0.03).then(|| {
            let beam = LightDirection {
                direction: mean,
                radius: group.iter().map(Light::radius).sum::<f64>() / n,
                sigma: MIN_SIGMA.hypot((spread / n).sqrt()),
            };
            (beam, group.iter().map(|l| l.pixel).sum::<DVec2>() / n)
        })
    };
    groups.iter().filter_map(beam).collect()
}

/// Adds the lights that a mirrored sphere reflects in a picture of the scene camera with a known pose,
/// as rays from the sphere's centre.
pub fn add_reflected_lights(
    bright: &BrightPixels,
    camera: &PinholeCamera,
    pose: RigidTransform,
    (sphere, centre): (&MirrorSphere, DVec3),
    out: &mut Vec<LightRay>,
) {
    let ray_direction = |p: DVec2| mirrored(camera.unproject(p), centre, sphere.radius);
    out.extend(bright.lights(&ray_direction).into_iter().map(|l| LightRay {
        from: sphere.centre_in_world,
        direction: pose.rotation * l.direction,
        radius: l.radius(),
    }));
}

/// Adds the lights that the scene camera sees directly, as rays from its position.
pub fn add_direct_lights(
    bright: &BrightPixels,
    camera: &PinholeCamera,
    pose: RigidTransform,
    sphere: Option<&MirrorSphere>,
    out: &mut Vec<LightRay>,
) {
    let inside = pose.inverse();
    let outline = sphere.map(|b| (inside.transform_point(b.centre_in_world), b.radius));
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let ray_direction = |p: DVec2| {
        let ray = camera.unproject(p);
        let on_ball =
            outline.is_some_and(|(c, r)| ray.angle_between(c) < (r / c.length()).min(1.0).asin());
        (!on_ball).then_some(ray)
    };
    for light in bright.lights(&ray_direction) {
        let reach = DVec2::splat(camera.focal.max_element() * light.radius() + 3.0);
        // The centre of a light that the frame cuts off is unknown.
        if (light.pixel - reach).min_element() > 0.0 && (light.pixel + reach).cmplt(size).all() {
            out.push(LightRay {
                from: pose.translation,
                direction: pose.rotation * light.direction,
                radius: light.radius(),
            });
        }
    }
}

/// A light of the world.
#[derive(Clone, Copy, Debug)]
pub struct WorldLight {
    /// Its position or direction.
    pub target: Target,
    /// Its direction from the environment camera.
    pub seen: LightDirection,
}

/// Triangulates the lights that rays from `pictures` pictures show, as seen from `eye` (world, metres).
/// `max_angle` is the maximum angle between rays to one light, radians.
#[must_use]
pub fn triangulate(
    rays: &[LightRay],
    pictures: usize,
    eye: DVec3,
    max_angle: f64,
) -> Vec<WorldLight> {
    let mut groups: Vec<Vec<LightRay>> = Vec::new();
    for ray in rays {
        let near = |g: &&mut Vec<LightRay>| {
            g.last().is_some_and(|l| {
                l.direction.angle_between(ray.direction) < max_angle + 0.5 * ray.radius
            })
        };
        match groups.iter_mut().find(near) {
            Some(group) => group.push(*ray),
            None => groups.push(vec![*ray]),
        }
    }
    let min_rays = (0.15 * pictures as f64).clamp(2.0, 5.0) as usize;
    groups.retain(|g| g.len() >= min_rays);
    groups.iter().filter_map(|g| crossing(g, eye)).collect()
}

/// Returns the intersection of rays, or their common direction if they are parallel.
fn crossing(rays: &[LightRay], eye: DVec3) -> Option<WorldLight> {
    let n = rays.len() as f64;
    let radius = rays.iter().map(|r| r.radius).sum::<f64>() / n;
    let from = rays.iter().map(|r| r.from).sum::<DVec3>() / n;
    let base = rays
        .iter()
        .map(|r| r.from.distance(from))
        .fold(0.0, f64::max);
    let Consensus {
        kept,
        point,
        parallel,
        mean,
        typical,
    } = consensus(rays, base)?;
    let noise = MIN_SIGMA.hypot(typical / (kept.len() as f64).sqrt());
    let direction = if parallel {
        mean
    } else {
        (point - eye).try_normalize()?
    };
    let parallax_sigma = if parallel {
        // The light is at least at the distance at which the base line would show a parallax.
        let nearest = base / (2.0 * typical);
        if eye.distance(from) < 1e-6 {
            0.0
        } else {
            eye.distance(from) / nearest.max(0.1)
        }
    } else {
        depth_sigma(&kept, point, eye, typical)
    };
    Some(WorldLight {
        target: if parallel {
            Target::Direction(mean)
        } else {
            Target::Point(point)
        },
        seen: LightDirection {
            direction,
            radius,
            sigma: noise.hypot(parallax_sigma),
        },
    })
}

/// Rays to one light without outliers, and their intersection.
struct Consensus {
    kept: Vec<LightRay>,
    point: DVec3,
    parallel: bool,
    /// Mean direction.
    mean: DVec3,
    /// Median deviation, radians.
    typical: f64,
}

/// Intersects rays, rejecting outliers by the median deviation.
fn consensus(rays: &[LightRay], base: f64) -> Option<Consensus> {
    let mut found = Consensus {
        kept: rays.to_vec(),
        point: DVec3::ZERO,
        parallel: true,
        mean: DVec3::ZERO,
        typical: 0.0,
    };
    for _ in 0..4 {
        let directions = found.kept.iter().map(|r| r.direction);
        found.mean = directions.sum::<DVec3>().try_normalize()?;
        (found.point, found.parallel) = intersection(&found.kept, found.mean, base);
        let (point, parallel, mean) = (found.point, found.parallel, found.mean);
        let deviation = |r: &LightRay| match parallel {
            true => r.direction.angle_between(mean),
            false => r.direction.angle_between(point - r.from),
        };
        found.typical = median(found.kept.iter().map(deviation))?.max(5e-4);
        let next: Vec<LightRay> = found
            .kept
            .iter()
            .filter(|r| deviation(r) < 4.0 * found.typical)
            .copied()
            .collect();
        if next.len() < 2 || next.len() == found.kept.len() {
            break;
        }
        found.kept = next;
    }
    Some(found)
}

/// Returns the point nearest to all rays, and whether they are practically parallel.
fn intersection(rays: &[LightRay], mean: DVec3, base: f64) -> (DVec3, bool) {
    let (mut a, mut b) = (DMat3::ZERO, DVec3::ZERO);
    for r in rays {
        let d = r.direction;
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        a += across;
        b += across * r.from;
    }
    let from = rays.iter().map(|r| r.from).sum::<DVec3>() / rays.len() as f64;
    if base < 1e-3 || a.determinant().abs() < 1e-9 * (rays.len() as f64).powi(3) {
        return (from + mean, true);
    }
    let point = a.inverse() * b;
    let path = point - from;
    (
        point,
        !point.is_finite() || path.dot(mean) < 0.1 || path.length() > 200.0 * base,
    )
}

/// Returns the standard deviation of a point's direction from `eye`, radians, given the uncertainty of
/// its position.
fn depth_sigma(rays: &[LightRay], point: DVec3, eye: DVec3, typical: f64) -> f64 {
    let mut information = DMat3::ZERO;
    for r in rays {
        let path = point - r.from;
        let d = path.normalize_or(r.direction);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        information += across * (1.0 / (typical * path.length()).powi(2).max(1e-12));
    }
    let covariance = information.inverse();
    let path = point - eye;
    let (u, v) = path.normalize_or(DVec3::Z).any_orthonormal_pair();
    let variance = u.dot(covariance * u).max(v.dot(covariance * v));
    (variance.max(0.0).sqrt() / path.length().max(1e-3)).min(10.0)
}

#[cfg(test)]
mod tests;
