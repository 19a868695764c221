//! Reflection in a mirrored sphere at a finite distance.
//!
//! ```text
//!  In the plane of the eye C, the sphere's centre S and the light, with the axis from S
//!  towards C, distance D = |C − S| and radius R, the surface point at angle φ from the
//!  axis has the normal n = (sin φ, cos φ) and is P = R n. The eye's ray arrives along
//!  v = (P − C)/|P − C| with C = (0, D), and the light comes from
//!      r = v − 2 (v·n) n,   ψ(φ) = atan2(r_x, r_z).
//!  ψ grows from 0 at φ = 0 to π − asin(R/D) at the silhouette cos φ = R/D; its inverse
//!  (Alhazen's problem) has no useful closed form and is tabulated.
//! ```

use crate::PinholeCamera;
use glam::DVec3;
use std::f64::consts::TAU;

/// Number of entries of the table of φ over ψ.
const TABLE: usize = 256;

/// Sphere and eye, with a table that inverts the reflection.
#[derive(Clone, Debug)]
pub(super) struct Mirror {
    eye: DVec3,
    centre: DVec3,
    radius: f64,
    /// Unit vector from the sphere's centre to the eye.
    axis: DVec3,
    distance: f64,
    /// φ for ψ = i · step.
    phi_of_psi: Vec<f64>,
    step: f64,
}

/// A reflected ray.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reflection {
    /// Point on the sphere, world, metres.
    pub point: DVec3,
    /// Unit vector towards the light.
    pub direction: DVec3,
}

impl Mirror {
    /// Creates the mirror. `min_cosine` is the minimum usable cosine of incidence: near the
    /// silhouette one pixel shows a wide band of directions, and a calibration error shows the
    /// background instead. `None` for an eye inside the sphere.
    pub fn new(eye: DVec3, centre: DVec3, radius: f64, min_cosine: f64) -> Option<Self> {
        let distance = eye.distance(centre);
        if !(radius > 0.0 && distance > 1.001 * radius) {
            return None;
        }
        let ratio = radius / distance;
        let phi_max = max_phi(ratio, min_cosine);
        let step = psi(phi_max, ratio) / (TABLE - 1) as f64;
        let phi_of_psi = (0..TABLE)
            .map(|i| invert(i as f64 * step, ratio, phi_max))
            .collect();
        Some(Self {
            eye,
            centre,
            radius,
            axis: (eye - centre) / distance,
            distance,
            phi_of_psi,
            step,
        })
    }

    /// The sphere and the eye.
    pub const fn view(&self) -> MirroredView {
        MirroredView {
            eye: self.eye,
            centre: self.centre,
            radius: self.radius,
        }
    }

    /// Centre and radius, world, metres.
    pub const fn ball(&self) -> (DVec3, f64) {
        (self.centre, self.radius)
    }

    /// Evenly spaced points of the silhouette as the eye sees it; world, metres.
    pub fn silhouette(&self) -> [DVec3; 32] {
        let ratio = self.radius / self.distance;
        let (right, up) = self.axis.any_orthonormal_pair();
        let middle = self.centre + self.axis * (self.radius * ratio);
        let across = self.radius * (1.0 - ratio * ratio).sqrt();
        std::array::from_fn(|i| {
            let (sin, cos) = (TAU * i as f64 / 32.0).sin_cos();
            middle + (right * cos + up * sin) * across
        })
    }

    /// Reflects the eye's ray along the unit vector `ray`; `None` if it misses the sphere or its
    /// cosine of incidence is too small.
    pub fn reflect(&self, ray: DVec3) -> Option<Reflection> {
        let along = ray.dot(self.centre - self.eye);
        let nearest2 = self.distance * self.distance - along * along;
        let inside = self.radius * self.radius - nearest2;
        if along <= 0.0 || inside <= 0.0 {
            return None;
        }
        let point = self.eye + ray * (along - inside.sqrt());
        let normal = (point - self.centre) / self.radius;
        let direction = ray - 2.0 * ray.dot(normal) * normal;
        let psi = direction.angle_between(self.axis);
        let limit = self.step * (TABLE - 1) as f64 + 1e-9;
        (psi <= limit).then_some(Reflection { point, direction })
    }

    /// Returns the cosine of incidence of light from a direction, and the distance from the eye to
    /// the point of reflection, metres. The normal bisects the directions to the light and to the
    /// eye; the latter depends on the point, by R/D at most, so it is iterated.
    pub fn incidence(&self, direction: DVec3) -> (f64, f64) {
        let (mut to_eye, mut cosine, mut distance) = (self.axis, 0.0, self.distance);
        for _ in 0..3 {
            let normal = (to_eye + direction).normalize_or_zero();
            let path = self.eye - self.centre - normal * self.radius;
            distance = path.length();
            to_eye = path / distance;
            cosine = to_eye.dot(normal);
        }
        (cosine, distance)
    }

    /// Returns the point of the sphere that reflects light from a direction to the eye (world, metres).
    pub fn point_showing(&self, direction: DVec3) -> Option<DVec3> {
        let along = direction.dot(self.axis);
        let across = direction - self.axis * along;
        let psi = across.length().atan2(along);
        let position = psi / self.step;
        let i = position as usize;
        let (low, high) = (self.phi_of_psi.get(i)?, self.phi_of_psi.get(i + 1)?);
        let guess = low + (high - low) * (position - i as f64);
        let ratio = self.radius / self.distance;
        let slope = self.step / (high - low).max(1e-12);
        let phi = guess + (psi - self::psi(guess, ratio)) / slope;
        let normal = self.axis * phi.cos() + across.normalize_or_zero() * phi.sin();
        Some(self.centre + normal * self.radius)
    }
}

/// ψ(φ) as derived in the module's documentation; `ratio` = R/D.
fn psi(phi: f64, ratio: f64) -> f64 {
    let (s, c) = phi.sin_cos();
    let length = (1.0 + ratio * ratio - 2.0 * ratio * c).sqrt();
    let (vx, vz) = (ratio * s / length, (ratio * c - 1.0) / length);
    let dot = vx * s + vz * c;
    (vx - 2.0 * dot * s).atan2(vz - 2.0 * dot * c)
}

/// Maximum φ whose cosine of incidence −v·n is at least `min_cosine`, by bisection.
fn max_phi(ratio: f64, min_cosine: f64) -> f64 {
    let cosine = |phi: f64| {
        let c = phi.cos();
        (c - ratio) / (1.0 + ratio * ratio - 2.0 * ratio * c).sqrt()
    };
    bisect(0.0, ratio.acos(), |phi| cosine(phi) > min_cosine)
}

/// Returns the φ with ψ(φ) = `target`, by bisection: ψ is monotonic.
fn invert(target: f64, ratio: f64, phi_max: f64) -> f64 {
    bisect(0.0, phi_max, |phi| psi(phi, ratio) < target)
}

/// Returns the value between `low` and `high` at which `below` changes from true to false.
fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..32 {
        let middle = 0.5 * (low + high);
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// A mirrored sphere and the eye that sees it; world, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MirroredView {
    /// Where the eye is.
    pub eye: DVec3,
    /// Centre of the sphere.
    pub centre: DVec3,
    /// Radius of the sphere.
    pub radius: f64,
}

impl MirroredView {
    /// From the centre to the point from which what the sphere shows in a direction (unit vector) seems to be
    /// seen, metres: the image of the eye, behind the surface, on the reflected ray. Things nearby appear in
    /// the direction and in the size that they have from there. With the cosine of incidence c and the distance t of
    /// the eye from the surface, the image lies 1/(1/t + 2/(R c)) behind it in the plane of incidence and
    /// 1/(1/t + 2 c/R) across it (Coddington's equations); solid angles are those at the geometric mean.
    #[must_use]
    pub fn viewpoint(&self, direction: DVec3) -> DVec3 {
        let to_eye = self.eye - self.centre;
        let (mut normal, mut distance) = (to_eye.normalize_or_zero(), to_eye.length());
        let mut cosine = 1.0;
        for _ in 0..4 {
            let path = to_eye - normal * self.radius;
            distance = path.length();
            normal = (path / distance + direction).normalize_or(normal);
            cosine = normal.dot(direction);
        }
        let behind = |power: f64| (distance.recip() + 2.0 * power / self.radius).recip();
        let cosine = cosine.max(0.05);
        let image = (behind(cosine.recip()) * behind(cosine)).sqrt();
        normal * self.radius - direction * image
    }
}

/// A mirrored sphere in a camera's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereInCamera {
    /// Centre in the camera's frame, metres.
    pub centre: DVec3,
    /// Radius, metres.
    pub radius: f64,
    /// Standard deviation of the centre's picture per axis, pixels.
    pub sigma: f64,
}

impl SphereInCamera {
    /// Radius of its picture near the optical axis, pixels.
    #[must_use]
    pub fn radius_in_pixels(&self, camera: &PinholeCamera) -> f64 {
        let distance = self.centre.length();
        let tangent = (distance * distance - self.radius * self.radius)
            .max(1e-12)
            .sqrt();
        camera.focal.min_element() * self.radius / tangent
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn centre_of_the_sphere_reflects_the_eye() {
        let mirror = Mirror::new(DVec3::new(0.0, -1.0, 0.0), DVec3::ZERO, 0.1, 0.1).unwrap();
        let seen = mirror.reflect(DVec3::Y).unwrap();
        assert!((seen.direction + DVec3::Y).length() < 1e-12);
        assert!((seen.point - DVec3::new(0.0, -0.1, 0.0)).length() < 1e-12);
    }

    #[test]
    fn distant_sphere_doubles_the_angle_of_its_normal() {
        assert!((psi(0.5, 1e-9) - 1.0).abs() < 1e-6);
        assert!(Mirror::new(DVec3::ZERO, DVec3::X * 0.05, 0.1, 0.1).is_none());
    }

    #[test]
    fn incidence_matches_the_reflected_ray() {
        let eye = DVec3::new(0.0, -1.0, 0.0);
        let mirror = Mirror::new(eye, DVec3::ZERO, 0.1, 0.1).unwrap();
        for ray in [0.0, 0.03, 0.06, 0.09, 0.097_f64] {
            let ray = DVec3::new(ray.sin(), ray.cos(), 0.0);
            let seen = mirror.reflect(ray).unwrap();
            let (cosine, distance) = mirror.incidence(seen.direction);
            let exact = -ray.dot(seen.point) / 0.1;
            assert!((cosine - exact).abs() < 2e-3, "{cosine} {exact}");
            assert!((distance - seen.point.distance(eye)).abs() < 1e-3);
        }
        // A direction hidden by the sphere itself.
        assert!(mirror.incidence(DVec3::Y).0 <= 0.0);
    }

    #[test]
    fn a_lamp_is_as_large_as_from_the_image_of_the_eye() {
        for (eye, angle) in [(0.5, 0.1), (0.5, 1.2), (5.0, 0.9), (0.2, 1.0)] {
            let mirror = Mirror::new(DVec3::Z * eye, DVec3::ZERO, 0.05, 0.1).unwrap();
            let lamp = DVec3::new(f64::sin(angle), 0.0, angle.cos()) * 0.6;
            // The direction in which the mirror shows a point near the lamp.
            let shown = |at: DVec3| {
                let towards = |direction: DVec3| {
                    let point = mirror.point_showing(direction).unwrap();
                    (at - point).normalize()
                };
                (0..60).fold(at.normalize(), |direction, _| towards(direction))
            };
            let direction = shown(lamp);
            let to_lamp = lamp - mirror.view().viewpoint(direction);
            assert!(
                to_lamp.normalize().distance(direction) < 2e-3,
                "{eye} {angle}"
            );
            let (right, up) = direction.any_orthonormal_pair();
            let step = 1e-4;
            let angles = [right, up]
                .map(|side| (shown(lamp + side * step) - shown(lamp - side * step)) / (2.0 * step));
            let solid_angle = angles[0].cross(angles[1]).length();
            let error = solid_angle * to_lamp.length_squared() - 1.0;
            assert!(error.abs() < 0.005, "{eye} {angle}: {error}");
            // From the middle of the ball it is smaller.
            let from_centre = solid_angle * lamp.length_squared() - 1.0;
            assert!(from_centre > 0.04, "{eye} {angle}: {from_centre}");
        }
    }

    proptest! {
        #[test]
        fn reflect_inverts_point_showing(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, d in 1.2f64..40.0) {
            let direction = DVec3::new(x, y, z);
            prop_assume!(direction.length() > 0.1);
            let direction = direction.normalize();
            let eye = DVec3::new(0.3, -0.2, 0.1);
            let centre = eye + DVec3::new(0.2, 0.9, -0.3).normalize() * 0.05 * d;
            let mirror = Mirror::new(eye, centre, 0.05, 0.1).unwrap();
            if let Some(point) = mirror.point_showing(direction) {
                prop_assert!((point.distance(centre) - 0.05).abs() < 1e-9);
                let seen = mirror.reflect((point - eye).normalize()).unwrap();
                prop_assert!((seen.direction - direction).length() < 1e-4, "{} {}", seen.direction, direction);
            }
        }
    }
}
