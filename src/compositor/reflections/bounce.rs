//! The second and the third reflection: in surfaces that a mirror ray has met.

use super::nearby_scene::{Met, Surface};
use glam::Vec3;

/// Sine of the least angle between a mirror ray and the triangle from which it starts.
const LEAST_ELEVATION: f32 = 0.01;
/// Least cosine of the angle of incidence by which a beam widens.
const LEAST_COSINE: f32 = 0.2;

/// The width of what a ray stands for, up to the ray of the neighbouring point (Igehy 1999, with the
/// greatest curvature for all directions).
#[derive(Clone, Copy)]
pub struct Beam {
    /// At the surface, metres.
    pub width: f32,
    /// The angle by which it opens, radians.
    pub angle: f32,
}

impl Beam {
    /// After `distance` metres and the reflection in a surface.
    pub fn reflected(self, distance: f32, met: &Met<'_>, cosine: f32) -> Self {
        let width = (self.width + self.angle * distance) / cosine.abs().max(LEAST_COSINE);
        Self {
            width,
            angle: self.angle + 2.0 * met.curvature * width,
        }
    }
}

/// A reflection in a surface that a mirror ray has met.
#[derive(Clone, Copy)]
pub struct Bounce {
    /// Share of the light that reaches the first surface from there, RGB.
    pub reflectance: Vec3,
    /// Unit vector to what it shows, world.
    pub direction: Vec3,
    /// Where it is, world, metres.
    pub origin: Vec3,
    /// Width, as GGX's α, of the lobe in which the environment is seen.
    pub width: f32,
    /// What the ray stands for.
    pub beam: Beam,
    /// Width, as GGX's α, of a lobe that reaches to what the rays of neighbouring points reflect: a
    /// lamp between them would be in none of these rays, or fill one of them.
    pub spread: f32,
}

/// A direction that points away from a triangle with normal `n`: interpolated normals may reflect
/// it into the surface.
pub fn lifted(direction: Vec3, n: Vec3) -> Vec3 {
    let elevation = direction.dot(n);
    if elevation >= LEAST_ELEVATION {
        return direction;
    }
    (direction + n * (LEAST_ELEVATION - elevation)).normalize()
}

/// The reflection in a surface at `from`; `None` if it reflects nothing specularly. It is blurred by that
/// surface's lobe and by the `part` of the one before, as a width, that the ray stands for.
pub fn bounce(
    met: &Met<'_>,
    from: Vec3,
    direction: Vec3,
    (part, beam): (f32, Beam),
) -> Option<Bounce> {
    let Surface { f0, width: own, .. } = *met.surface;
    (f0 != Vec3::ZERO).then(|| {
        let n = met.shading_normal;
        let cosine = direction.dot(n);
        let beam = beam.reflected(met.distance, met, cosine);
        // Half vectors, of which α tells the spread, turn by half as much as directions.
        let lobe = Beam {
            width: 0.0,
            angle: 2.0 * part,
        };
        // A curved surface may widen it in one direction alone: by the root, its area is right then.
        let width = 0.5 * (lobe.angle * lobe.reflected(met.distance, met, cosine).angle).sqrt();
        // To both sides.
        let spread = (0.25 * beam.angle).min(1.0);
        Bounce {
            reflectance: met.surface.fresnel(-direction.dot(n)),
            direction: lifted(direction.reflect(n), met.normal),
            origin: from,
            width: own.hypot(width).min(1.0),
            beam,
            spread,
        }
    })
}

impl Bounce {
    /// The reflection of this one in the surface that it meets, at `from`.
    pub fn again(&self, met: &Met<'_>, from: Vec3) -> Option<Self> {
        let next = bounce(met, from, self.direction, (self.width, self.beam))?;
        let reflectance = self.reflectance * next.reflectance;
        Some(Self {
            reflectance,
            ..next
        })
    }
}
