//! What is known of a point of the lattice of mirror rays, and of what lies between four of them.

use glam::Vec3;

/// Differences of two points of a lattice below which what lies between them is interpolated: of
/// their distance, as a share of it, ...
const SAME_DISTANCE: f32 = 0.01;
/// ... of their normals, as a cosine, ...
const SAME_NORMAL: f32 = 0.97;
/// ... of the shares of rays, ...
const SAME_SHARE: f32 = 0.2;
/// ... and of the light, as a share of the brighter.
const SAME_LIGHT: f32 = 0.25;
/// Difference of light that is dark beside everything, in units of the camera's white.
const DARK: f32 = 0.004;

/// What the surface behind a point of the picture mirrors of its neighbourhood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearby {
    /// Radiance that the picture does not show.
    pub light: Vec3,
    /// Share of the rays that meet nothing close by.
    pub open: f32,
    /// Share of the rays that meet what the picture shows.
    pub seen: f32,
    /// The mean of where those are in the picture, in its width and height, and of their lengths as
    /// a share of the distance from there to the camera.
    pub place: Vec3,
    /// Distance of the surface along the camera's axis, metres, negative for a real mirror; 0 without
    /// a glossy surface.
    pub z: f32,
    /// Shading normal of the surface.
    pub normal: Vec3,
}

/// What lies between four points of a lattice.
pub enum Between {
    /// What lies on their surface and mirrors what they do.
    Known(Nearby),
    /// Several surfaces, or the edge of one.
    Outline,
    /// One surface that turns too much to know what lies between.
    Curve,
    /// One surface that mirrors several things.
    Reflections,
}

impl Nearby {
    /// No glossy surface.
    pub const NOTHING: Self = Self {
        light: Vec3::ZERO,
        open: 1.0,
        seen: 0.0,
        place: Vec3::ZERO,
        z: 0.0,
        normal: Vec3::ZERO,
    };

    /// What is between four points of a lattice, by their weights.
    pub fn between(corners: [&Self; 4], weights: [f32; 4]) -> Between {
        let first = corners[0];
        if corners.iter().all(|c| c.z == 0.0) {
            return Between::Known(Self::NOTHING);
        }
        if !corners.iter().all(|c| first.is_as_far_as(c)) {
            return Between::Outline;
        }
        if !corners.iter().all(|c| first.is_on_surface_of(c)) {
            return Between::Curve;
        }
        if !corners.iter().all(|c| first.mirrors_the_same(c)) {
            return Between::Reflections;
        }
        let mut sum = Self {
            open: 0.0,
            normal: first.normal,
            ..Self::NOTHING
        };
        for (corner, weight) in corners.iter().zip(weights) {
            sum.light += corner.light * weight;
            sum.open += corner.open * weight;
            sum.seen += corner.seen * weight;
            sum.place += corner.place * corner.seen * weight;
            sum.z += corner.z * weight;
        }
        sum.place /= sum.seen.max(1e-6);
        Between::Known(sum)
    }

    /// Whether it is what a real mirror shows.
    pub const fn is_in_real_mirror(&self) -> bool {
        self.z < 0.0
    }

    /// Whether another point may lie on the same surface.
    pub fn is_as_far_as(&self, other: &Self) -> bool {
        (self.z - other.z).abs() < SAME_DISTANCE * self.z.abs()
    }

    fn is_on_surface_of(&self, other: &Self) -> bool {
        self.is_as_far_as(other) && self.normal.dot(other.normal) > SAME_NORMAL
    }

    fn mirrors_the_same(&self, other: &Self) -> bool {
        let brightest = self.light.max(other.light).max_element();
        let shares = (self.open - other.open)
            .abs()
            .max((self.seen - other.seen).abs());
        shares < SAME_SHARE
            && (self.light - other.light).abs().max_element() < SAME_LIGHT * brightest + DARK
    }
}
