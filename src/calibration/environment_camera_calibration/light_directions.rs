//! The lights of both cameras as directions: seen again and again, seen in the mirror, and from
//! where they are not at infinity.

use super::bright::{Bright, Light};
use super::resection::Target;
use super::turn::Beam;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::MirrorSphere;
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;

/// Share of the pictures in which a light must be seen.
const LEAST_SHARE: f64 = 0.3;
/// A light's middle is never known better, radians: its shape is not the same in two pictures.
const LEAST_SIGMA: f64 = 2e-3;
/// In a mirror the smallest cosine of incidence that is of use.
pub(super) const LEAST_COSINE: f64 = 0.35;

/// A light seen from one place.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// World, metres.
    pub from: DVec3,
    /// Unit vector, world.
    pub direction: DVec3,
    /// Radius of a disc as large, radians.
    pub radius: f64,
}

/// Direction of the light that a ray shows in a mirrored ball, all in one frame; the ray is a unit
/// vector from the origin.
#[must_use]
pub fn mirrored(ray: DVec3, centre: DVec3, radius: f64) -> Option<DVec3> {
    let along = ray.dot(centre);
    let inside = radius * radius - (centre.length_squared() - along * along);
    if along <= 0.0 || inside <= 0.0 {
        return None;
    }
    let normal = (ray * (along - inside.sqrt()) - centre) / radius;
    let cosine = -ray.dot(normal);
    (cosine > LEAST_COSINE).then(|| ray + 2.0 * cosine * normal)
}

/// The lights that a camera which stands still saw in most of its pictures.
#[must_use]
pub fn still(
    pictures: &[Bright],
    direction: &dyn Fn(DVec2) -> Option<DVec3>,
) -> Vec<(Beam, DVec2)> {
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
    groups.retain(|g| g.len() as f64 >= (LEAST_SHARE * pictures.len() as f64).max(1.0));
    let beam = |group: &Vec<Light>| {
        let sum: DVec3 = group.iter().map(|l| l.direction).sum();
        let middle = sum.try_normalize()?;
        let n = group.len() as f64;
        let spread = group
            .iter()
            .map(|l| l.direction.angle_between(middle).powi(2))
            .sum::<f64>()
            / n;
        // A lamp that was moved is no landmark.
        (spread.sqrt() < 0.03).then(|| {
            let beam = Beam {
                direction: middle,
                radius: group.iter().map(Light::radius).sum::<f64>() / n,
                sigma: LEAST_SIGMA.hypot((spread / n).sqrt()),
            };
            (beam, group.iter().map(|l| l.pixel).sum::<DVec2>() / n)
        })
    };
    groups.iter().filter_map(beam).collect()
}

/// The lights in a picture of the scene camera at a known pose, as the ball in it shows them; from
/// the ball's middle.
pub fn in_ball(
    bright: &Bright,
    camera: &PinholeCamera,
    pose: RigidTransform,
    (ball, centre): (&MirrorSphere, DVec3),
    out: &mut Vec<Ray>,
) {
    let look = |p: DVec2| mirrored(camera.unproject(p), centre, ball.radius);
    out.extend(bright.lights(&look).into_iter().map(|l| Ray {
        from: ball.centre_in_world,
        direction: pose.rotation * l.direction,
        radius: l.radius(),
    }));
}

/// The lights that the scene camera sees itself.
pub fn direct(
    bright: &Bright,
    camera: &PinholeCamera,
    pose: RigidTransform,
    ball: Option<&MirrorSphere>,
    out: &mut Vec<Ray>,
) {
    let inside = pose.inverse();
    let outline = ball.map(|b| (inside.transform_point(b.centre_in_world), b.radius));
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let look = |p: DVec2| {
        let ray = camera.unproject(p);
        let on_ball =
            outline.is_some_and(|(c, r)| ray.angle_between(c) < (r / c.length()).min(1.0).asin());
        (!on_ball).then_some(ray)
    };
    for light in bright.lights(&look) {
        let reach = DVec2::splat(camera.focal.max_element() * light.radius() + 3.0);
        // What is cut off by the frame has its middle elsewhere.
        if (light.pixel - reach).min_element() > 0.0 && (light.pixel + reach).cmplt(size).all() {
            out.push(Ray {
                from: pose.translation,
                direction: pose.rotation * light.direction,
                radius: light.radius(),
            });
        }
    }
}

/// A light of the world.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// Where it is.
    pub target: Target,
    /// As it is seen from where the environment camera stands.
    pub beam: Beam,
}

/// The lights that rays from `pictures` pictures agree on, as seen from `eye`. `together` is how far
/// apart rays to one light may be, radians.
#[must_use]
pub fn agreed(rays: &[Ray], pictures: usize, eye: DVec3, together: f64) -> Vec<Known> {
    let mut groups: Vec<Vec<Ray>> = Vec::new();
    for ray in rays {
        let near = |g: &&mut Vec<Ray>| {
            g.last().is_some_and(|l| {
                l.direction.angle_between(ray.direction) < together + 0.5 * ray.radius
            })
        };
        match groups.iter_mut().find(near) {
            Some(group) => group.push(*ray),
            None => groups.push(vec![*ray]),
        }
    }
    let least = (0.15 * pictures as f64).clamp(2.0, 5.0) as usize;
    groups.retain(|g| g.len() >= least);
    groups.iter().filter_map(|g| crossing(g, eye)).collect()
}

/// Where rays cross, or which way they all go.
fn crossing(rays: &[Ray], eye: DVec3) -> Option<Known> {
    let n = rays.len() as f64;
    let radius = rays.iter().map(|r| r.radius).sum::<f64>() / n;
    let from = rays.iter().map(|r| r.from).sum::<DVec3>() / n;
    let base = rays
        .iter()
        .map(|r| r.from.distance(from))
        .fold(0.0, f64::max);
    let mut kept: Vec<Ray> = rays.to_vec();
    let mut answer = None;
    for _ in 0..4 {
        let mean = kept
            .iter()
            .map(|r| r.direction)
            .sum::<DVec3>()
            .try_normalize()?;
        let (point, parallel) = meet(&kept, mean, base);
        let off = |r: &Ray| match parallel {
            true => r.direction.angle_between(mean),
            false => r.direction.angle_between(point - r.from),
        };
        let mut offs: Vec<f64> = kept.iter().map(off).collect();
        offs.sort_by(f64::total_cmp);
        let typical = offs[offs.len() / 2].max(5e-4);
        answer = Some((point, parallel, mean, typical));
        let next: Vec<Ray> = kept
            .iter()
            .filter(|r| off(r) < 4.0 * typical)
            .copied()
            .collect();
        if next.len() < 2 || next.len() == kept.len() {
            break;
        }
        kept = next;
    }
    let (point, parallel, mean, typical) = answer?;
    let noise = LEAST_SIGMA.hypot(typical / (kept.len() as f64).sqrt());
    let direction = if parallel {
        mean
    } else {
        (point - eye).try_normalize()?
    };
    let open = if parallel {
        // No nearer than the base would have shown.
        let nearest = base / (2.0 * typical);
        if eye.distance(from) < 1e-6 {
            0.0
        } else {
            eye.distance(from) / nearest.max(0.1)
        }
    } else {
        depth_sigma(&kept, point, eye, typical)
    };
    Some(Known {
        target: if parallel {
            Target::Direction(mean)
        } else {
            Target::Point(point)
        },
        beam: Beam {
            direction,
            radius,
            sigma: noise.hypot(open),
        },
    })
}

/// The point nearest to all rays; true where they are as good as parallel.
fn meet(rays: &[Ray], mean: DVec3, base: f64) -> (DVec3, bool) {
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
    let way = point - from;
    (
        point,
        !point.is_finite() || way.dot(mean) < 0.1 || way.length() > 200.0 * base,
    )
}

/// How much a point's open distance turns it as seen from elsewhere, radians.
fn depth_sigma(rays: &[Ray], point: DVec3, eye: DVec3, typical: f64) -> f64 {
    let mut information = DMat3::ZERO;
    for r in rays {
        let way = point - r.from;
        let d = way.normalize_or(r.direction);
        let across = DMat3::IDENTITY - DMat3::from_cols(d * d.x, d * d.y, d * d.z);
        information += across * (1.0 / (typical * way.length()).powi(2).max(1e-12));
    }
    let covariance = information.inverse();
    let way = point - eye;
    let (u, v) = way.normalize_or(DVec3::Z).any_orthonormal_pair();
    let variance = u.dot(covariance * u).max(v.dot(covariance * v));
    (variance.max(0.0).sqrt() / way.length().max(1e-3)).min(10.0)
}

#[cfg(test)]
mod tests;
