//! Lights that are near: their place, and what they do at each point.
//!
//! A light at L is described by the unit vector a and the distance D from a reference A in which
//! its irradiance I is stated. With κ = 1/D, the vector from a point p to the light, in units of D,
//! is
//!
//! ```text
//!   v(p) = (L − p)/D = a + κ (A − p)
//! ```
//!
//! which is a itself for κ = 0: a distant light is the limit, not another case. A surface at p with
//! the unit normal n receives I (n·v)/|v|³ (inverse square law and cosine).

use super::light::DomeLight;
use glam::{DVec3, Vec3};
use penumbra_camera::MirroredView;

/// Distance from the reference, metres, within which virtual objects and their shadows lie.
const BESIDE: f32 = 0.15;

/// How far a light is, and from where.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LightPlace {
    /// The point for which direction, irradiance and angular radius are stated, world, metres.
    pub reference: Vec3,
    /// The reciprocal of its distance from there, 1/m; 0 for a light that is infinitely far.
    pub inverse_distance: f32,
}

impl LightPlace {
    /// Infinitely far: the same from everywhere.
    pub const FAR: Self = Self {
        reference: Vec3::ZERO,
        inverse_distance: 0.0,
    };

    /// Returns the vector from `point` to a light in `direction` from the reference, in units of its
    /// distance from there.
    #[must_use]
    #[inline(always)]
    pub fn towards(&self, direction: Vec3, point: Vec3) -> Vec3 {
        direction + (self.reference - point) * self.inverse_distance
    }

    /// Returns the angle, radians, by which a light seen from a point beside the reference would
    /// move if its place were another one in the same direction.
    #[must_use]
    pub fn parallax_to(&self, other: &Self) -> f32 {
        (self.inverse_distance - other.inverse_distance).abs() * BESIDE
    }

    /// Returns the place between this one (`share` 0) and another (1).
    #[must_use]
    pub fn toward(&self, other: &Self, share: f32) -> Self {
        let from = if self.is_far() { other } else { self };
        let to = if other.is_far() { self } else { other };
        let between =
            self.inverse_distance + (other.inverse_distance - self.inverse_distance) * share;
        Self {
            reference: from.reference.lerp(to.reference, share),
            inverse_distance: between,
        }
    }

    /// Returns where a light in `direction` from the reference is, world, metres; `None` if it is
    /// infinitely far.
    #[must_use]
    pub fn position(&self, direction: Vec3) -> Option<Vec3> {
        (!self.is_far()).then(|| self.reference + direction / self.inverse_distance)
    }

    /// Whether the light is infinitely far.
    #[must_use]
    #[inline(always)]
    pub fn is_far(&self) -> bool {
        self.inverse_distance == 0.0
    }
}

/// Smallest distance from a near light, as a share of its distance from the reference: bounds what
/// a surface receives that touches the lamp.
pub(super) const LEAST_DISTANCE: f32 = 0.05;

/// Least w of points in [`DomeLight::in_light_space`]: nearer to a near light, or behind it, nothing
/// casts shadows.
pub const LEAST_W: f32 = 0.1;

impl DomeLight {
    /// Returns it as if it were infinitely far.
    #[must_use]
    pub const fn far(self) -> Self {
        Self {
            place: LightPlace::FAR,
            ..self
        }
    }

    /// Returns the vector from `point` (world, metres) to the light, in units of its distance from
    /// the reference; a unit vector for distant lights.
    #[must_use]
    #[inline(always)]
    pub fn towards(&self, point: Vec3) -> Vec3 {
        self.place.towards(self.direction, point)
    }

    /// Returns the factor on its irradiance at `point` for a surface with unit normal `n`:
    /// inverse square law and cosine, 0 behind the surface.
    #[must_use]
    #[inline(always)]
    pub fn facing(&self, point: Vec3, n: Vec3) -> f32 {
        if self.place.is_far() {
            return self.direction.dot(n).max(0.0);
        }
        let v = self.towards(point);
        let square = v.length_squared().max(LEAST_DISTANCE * LEAST_DISTANCE);
        v.dot(n).max(0.0) / (square * square.sqrt())
    }

    /// Returns the coordinates, metres, of `point` along two unit vectors across the light's
    /// direction and away from the light, from the reference, after the projective map that moves a
    /// near light to infinity:
    ///
    /// ```text
    ///   (x, y, h) → (x, y, h) / w,   w = 1 − κ h
    /// ```
    ///
    /// `None` behind a near light, or too near to it to cast a shadow ([`LEAST_W`]).
    #[must_use]
    #[inline(always)]
    pub fn in_light_space(&self, [right, up]: [Vec3; 2], point: Vec3) -> Option<Vec3> {
        let p = point - self.place.reference;
        let along = p.dot(self.direction);
        let w = 1.0 - self.place.inverse_distance * along;
        (w > LEAST_W).then(|| Vec3::new(p.dot(right), p.dot(up), -along) / w)
    }

    /// Returns where it is, world, metres; `None` if it is infinitely far.
    #[must_use]
    pub fn position(&self) -> Option<Vec3> {
        let place = &self.place;
        (!place.is_far()).then(|| place.reference + self.direction / place.inverse_distance)
    }
}

/// Largest number of [`near_lights`].
pub const MAX_NEAR_LIGHTS: usize = 8;
/// Angle, radians, up to which near lights are joined.
const SIDE_BY_SIDE: f32 = 0.15;

/// Joins those of `lights` that are near, where they lie side by side: what they do where nothing
/// blocks them. They replace `groups`, and are at most [`MAX_NEAR_LIGHTS`]; further ones are
/// joined with the nearest.
pub fn near_lights(lights: &[DomeLight], groups: &mut Vec<DomeLight>) {
    groups.clear();
    let is_lit = |l: &&DomeLight| !l.place.is_far() && l.irradiance != Vec3::ZERO;
    for light in lights.iter().filter(is_lit) {
        let apart = |group: &DomeLight| {
            group.direction.distance(light.direction) + group.place.parallax_to(&light.place)
        };
        let is_full = groups.len() == MAX_NEAR_LIGHTS;
        let nearest = groups
            .iter_mut()
            .min_by(|a, b| apart(a).total_cmp(&apart(b)));
        match nearest.filter(|group| is_full || apart(group) < SIDE_BY_SIDE) {
            Some(group) => *group = sum(group, light),
            None => groups.push(*light),
        }
    }
}

/// Returns two near lights as one.
fn sum(a: &DomeLight, b: &DomeLight) -> DomeLight {
    let irradiance = a.irradiance + b.irradiance;
    let share = b.irradiance.element_sum() / irradiance.element_sum().max(f32::MIN_POSITIVE);
    DomeLight {
        direction: a
            .direction
            .lerp(b.direction, share)
            .normalize_or(a.direction),
        irradiance,
        place: a.place.toward(&b.place, share),
        ..*a
    }
}

/// A lamp's distance from the observer, as far as it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampDistance {
    /// The reciprocal of the distance, 1/m; 0 if the lamp may be far.
    pub inverse: f32,
    /// Standard deviation of the reciprocal, 1/m.
    pub sigma: f32,
}

impl LampDistance {
    /// Infinitely far, as far as is known.
    pub const FAR: Self = Self {
        inverse: 0.0,
        sigma: f32::INFINITY,
    };

    /// Returns the distance and its standard deviation, metres; `None` if the lamp may be far.
    #[must_use]
    pub fn metres(&self) -> Option<(f32, f32)> {
        let inverse = self.inverse;
        (inverse > 0.0).then(|| (inverse.recip(), self.sigma / (inverse * inverse)))
    }
}

/// The plane of a window, or of another flat source that shines evenly: a point p is on it if `normal`·p = `offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LampPlane {
    /// Unit vector, world.
    pub normal: DVec3,
    /// Metres.
    pub offset: f64,
}

impl LampPlane {
    /// Returns the reciprocal of the distance, 1/m, at which a ray from `eye` meets the plane; 0 if it does not.
    #[must_use]
    pub fn inverse_from(&self, eye: DVec3, direction: DVec3) -> f32 {
        let away = self.offset - self.normal.dot(eye);
        let inverse = self.normal.dot(direction) / away;
        if inverse.is_finite() && inverse > 0.0 {
            inverse.min(LARGEST_INVERSE) as f32
        } else {
            0.0
        }
    }

    /// Returns the ratio of the source's extent across a direction, seen from one point, to that seen from another:
    /// `to` and `from` are the unit vectors from both to the source.
    fn turned(&self, to: DVec3, from: DVec3) -> f64 {
        let across = |direction: DVec3| self.normal.dot(direction).abs();
        across(to) / across(from).max(LEAST_ACROSS)
    }
}

/// Largest reciprocal of a window's distance, 1/m.
const LARGEST_INVERSE: f64 = 5.0;
/// Least cosine at which a flat source is seen.
const LEAST_ACROSS: f64 = 0.05;

/// How far a source is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Remote {
    /// All of it, by the reciprocal of its distance, 1/m; 0: infinitely far.
    Inverse(f32),
    /// Flat.
    Plane(LampPlane),
}

/// A light as it is seen from one point.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Unit vector to it, world.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it, RGB.
    pub irradiance: Vec3,
    /// Half angle of a cone with its solid angle, radians.
    pub angular_radius: f32,
}

/// Where lights are observed, and where they are needed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Viewpoints {
    /// The point from which the environment is seen, world, metres.
    pub observer: DVec3,
    /// The mirrored sphere in which it is seen, whose centre the observer is.
    pub mirrored: Option<MirroredView>,
    /// The point, world, metres, for which lights are stated: the middle of the virtual objects.
    pub reference: DVec3,
}

impl Viewpoints {
    /// The same without a mirrored sphere: lamps that are not seen are stated for the observer.
    #[must_use]
    pub const fn direct(&self) -> Self {
        Self {
            mirrored: None,
            ..*self
        }
    }

    /// Returns a light as it is seen from the reference, and its place.
    #[must_use]
    pub(super) fn moved(&self, seen: Seen, remote: Remote) -> (Seen, LightPlace) {
        let direction = seen.direction.as_dvec3();
        let offset = (self.mirrored).map_or(DVec3::ZERO, |sphere| sphere.viewpoint(direction));
        let eye = self.observer + offset;
        let inverse_distance = match remote {
            Remote::Inverse(inverse) => inverse,
            Remote::Plane(plane) => plane.inverse_from(eye, direction),
        };
        if inverse_distance <= 0.0 {
            return (seen, LightPlace::FAR);
        }
        let distance = f64::from(inverse_distance).recip();
        let light = eye + direction * distance;
        let to = light - self.reference;
        // A light cannot be inside the objects that it lights.
        let there = to.length().max(0.2 * distance);
        let nearer = (distance / there) as f32;
        let from_there = to.try_normalize().unwrap_or(direction);
        let turned = match remote {
            Remote::Inverse(_) => 1.0,
            Remote::Plane(plane) => plane.turned(from_there, direction) as f32,
        };
        let moved = Seen {
            direction: from_there.as_vec3(),
            irradiance: seen.irradiance * (nearer * nearer * turned),
            angular_radius: seen.angular_radius * (nearer * turned.sqrt()),
        };
        let place = LightPlace {
            reference: self.reference.as_vec3(),
            inverse_distance: there.recip() as f32,
        };
        (moved, place)
    }
}

#[cfg(test)]
mod tests {
    use super::super::light::LightKind;
    use super::*;

    fn light(place: LightPlace) -> DomeLight {
        DomeLight {
            direction: Vec3::Z,
            irradiance: Vec3::ONE,
            angular_radius: 0.1,
            kind: LightKind::Compact,
            place,
        }
    }

    #[test]
    fn a_near_light_follows_the_inverse_square_law() {
        let near = light(LightPlace {
            reference: Vec3::new(0.1, 0.2, 0.0),
            inverse_distance: 2.0,
        });
        let position = near.position().expect("near");
        assert!(position.distance(Vec3::new(0.1, 0.2, 0.5)) < 1e-6);
        for point in [Vec3::ZERO, Vec3::new(0.4, -0.2, 0.1), Vec3::Y] {
            let to = position - point;
            let expected = to.normalize().z * 0.25 / to.length_squared();
            assert!((near.facing(point, Vec3::Z) - expected).abs() < 1e-5);
        }
        assert_eq!(near.facing(Vec3::new(0.0, 0.0, 0.9), Vec3::Z), 0.0);
        let far = light(LightPlace::FAR);
        assert_eq!(far.facing(Vec3::splat(7.0), Vec3::Z), 1.0);
        assert_eq!(far.position(), None);
    }

    #[test]
    fn moving_the_viewpoint_keeps_the_lamp_and_its_power() {
        let views = Viewpoints {
            observer: DVec3::new(-0.2, -0.1, 0.05),
            mirrored: None,
            reference: DVec3::new(0.1, 0.0, 0.1),
        };
        let lamp = DVec3::new(-0.3, 0.2, 0.5);
        let distance = lamp.distance(views.observer);
        let seen = Seen {
            direction: ((lamp - views.observer) / distance).as_vec3(),
            irradiance: Vec3::splat((0.7 / (distance * distance)) as f32),
            angular_radius: (0.03 / distance) as f32,
        };
        let (moved, place) = views.moved(seen, Remote::Inverse(distance.recip() as f32));
        let there = lamp.distance(views.reference);
        let expected = 0.7 / (there * there);
        assert!((f64::from(moved.irradiance.x) - expected).abs() < 1e-5);
        assert!((f64::from(moved.angular_radius) - 0.03 / there).abs() < 1e-6);
        let at = place.reference + moved.direction / place.inverse_distance;
        assert!(at.as_dvec3().distance(lamp) < 1e-6);
        assert_eq!(views.moved(seen, Remote::Inverse(0.0)).1, LightPlace::FAR);
    }

    /// Patches of a window of the same radiance, seen at a slant, from elsewhere.
    #[test]
    fn window_has_the_same_radiance_from_everywhere() {
        let views = Viewpoints {
            observer: DVec3::ZERO,
            mirrored: None,
            reference: DVec3::new(0.6, 0.9, 0.1),
        };
        let plane = LampPlane {
            normal: DVec3::X,
            offset: 2.0,
        };
        for y in [-0.8, 0.0, 1.0] {
            let patch = DVec3::new(2.0, y, 0.7);
            let area = 0.01;
            // Irradiance and half angle of a patch of the radiance 3.
            let from = |eye: DVec3| {
                let to = patch - eye;
                let solid_angle = area * to.normalize().x / to.length_squared();
                (
                    3.0 * solid_angle,
                    (solid_angle / std::f64::consts::PI).sqrt(),
                )
            };
            let (here, there) = (from(views.observer), from(views.reference));
            let seen = Seen {
                direction: patch.normalize().as_vec3(),
                irradiance: Vec3::splat(here.0 as f32),
                angular_radius: here.1 as f32,
            };
            let (moved, place) = views.moved(seen, Remote::Plane(plane));
            let at = place.position(moved.direction).expect("near").as_dvec3();
            assert!(at.distance(patch) < 1e-5, "{at}");
            assert!((f64::from(moved.irradiance.x) / there.0 - 1.0).abs() < 1e-4);
            assert!((f64::from(moved.angular_radius) / there.1 - 1.0).abs() < 1e-4);
        }
        // Behind the observer there is no window.
        assert_eq!(plane.inverse_from(DVec3::ZERO, -DVec3::X), 0.0);
        assert_eq!(plane.inverse_from(DVec3::X * 2.0, DVec3::X), 0.0);
    }
}
