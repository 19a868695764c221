//! Which pages of the surface cache a viewer may see.

use glam::{DMat4, DVec3, Vec3};
use penumbra_surface_cache::{Bounds, ReceiverPage};

/// The viewer of a frame: clip space from the world, and the eye.
pub(super) type Viewer = (DMat4, DVec3);

/// Normals of a page: all lie within the angle of the given sine and cosine about the axis.
pub(super) struct Cone {
    axis: Vec3,
    sine: f32,
    cosine: f32,
}

impl Cone {
    pub fn of(page: &ReceiverPage) -> Self {
        let texels = page.texels.normals.iter().zip(&page.texels.is_used);
        let normals = || texels.clone().filter(|(_, used)| **used).map(|(n, _)| *n);
        let axis = normals().sum::<Vec3>().normalize_or_zero();
        let cosine = normals().map(|n| n.dot(axis)).fold(1.0, f32::min);
        Self {
            axis,
            sine: (1.0 - cosine * cosine).max(0.0).sqrt(),
            cosine,
        }
    }

    /// Whether some surface in `bounds` may face the eye.
    fn may_face(&self, bounds: &Bounds, eye: Vec3) -> bool {
        let radius = 0.5 * bounds.low.distance(bounds.high);
        let to_eye = eye - 0.5 * (bounds.low + bounds.high);
        let distance = to_eye.length();
        if self.cosine <= 0.0 || distance <= radius {
            return true;
        }
        // The most that a normal of the cone points towards the eye, seen from the centre.
        let along = self.axis.dot(to_eye);
        let aside = (distance * distance - along * along).max(0.0).sqrt();
        along * self.cosine + aside * self.sine > -radius
    }
}

/// Share of the picture by which a page may lie outside it: a rolling shutter displaces surfaces.
const OUTSIDE: f64 = 0.1;

/// Whether a page may be seen.
pub(super) fn may_see((clip_from_world, eye): &Viewer, bounds: &Bounds, cone: &Cone) -> bool {
    let mut outside = [true; 5];
    for corner in bounds.corners() {
        let clip = *clip_from_world * corner.as_dvec3().extend(1.0);
        let limit = clip.w * (1.0 + 2.0 * OUTSIDE);
        let beyond = [
            clip.x < -limit,
            clip.x > limit,
            clip.y < -limit,
            clip.y > limit,
            clip.w <= 0.0,
        ];
        outside
            .iter_mut()
            .zip(beyond)
            .for_each(|(all, beyond)| *all &= beyond);
    }
    !outside.contains(&true) && cone.may_face(bounds, eye.as_vec3())
}
