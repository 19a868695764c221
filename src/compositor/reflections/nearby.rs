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
/// The same of two pixels, above which more rays tell what each of them mirrors: of the shares of rays, ...
const UNLIKE_SHARE: f32 = 0.35;
/// ... of the light, as a share of the brighter, ...
const UNLIKE_LIGHT: f32 = 0.4;
/// ... beyond this, in units of the camera's white.
const UNLIKE_DARK: f32 = 0.02;
/// Points of a lattice, each way, over which a soft one is averaged: half of [`PERIOD`].
const REACH: isize = 2;
/// Points of a lattice, each way, after which the rays of soft ones are the same again.
pub const PERIOD: usize = 4;
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
    /// a share of the distance from there to the camera, times the cosine at which it sees that place.
    pub place: Vec3,
    /// Distance of the surface along the camera's axis, metres, negative for a real mirror; 0 without
    /// a glossy surface.
    pub z: f32,
    /// Shading normal of the surface.
    pub normal: Vec3,
    /// Whether its lobe is wider than what the points around it mirror: each of them has other rays
    /// of the lobe, and the mean over them counts.
    pub is_soft: bool,
}

/// A weighted mean.
#[derive(Default)]
struct Mean {
    light: Vec3,
    open: f32,
    seen: f32,
    place: Vec3,
    z: f32,
    weight: f32,
}

impl Mean {
    fn add(&mut self, point: &Nearby, weight: f32) {
        self.light += point.light * weight;
        self.open += point.open * weight;
        self.seen += point.seen * weight;
        // A mean over what is seen.
        self.place += point.place * (point.seen * weight);
        self.z += point.z * weight;
        self.weight += weight;
    }

    fn of(self) -> Nearby {
        let scale = self.weight.max(1e-6).recip();
        Nearby {
            light: self.light * scale,
            open: self.open * scale,
            seen: self.seen * scale,
            place: self.place / self.seen.max(1e-6),
            z: self.z * scale,
            ..Nearby::NOTHING
        }
    }
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
        is_soft: false,
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
        let is_soft = corners.iter().all(|c| c.is_soft);
        if !is_soft && !corners.iter().all(|c| first.mirrors_the_same(c)) {
            return Between::Reflections;
        }
        let mut mean = Mean::default();
        for (corner, weight) in corners.into_iter().zip(weights) {
            mean.add(corner, weight);
        }
        let normal = first.normal;
        Between::Known(Self {
            normal,
            ..mean.of()
        })
    }

    /// The mean of a soft point and of those around it on its surface: the points of a lattice, `across`
    /// in a row, number `own` of which it is.
    pub fn softened(lattice: &[Self], across: usize, own: usize) -> Self {
        let point = &lattice[own];
        let (x, y) = ((own % across) as isize, (own / across) as isize);
        let mut mean = Mean::default();
        for dy in -REACH..=REACH {
            for dx in -REACH..=REACH {
                let (u, v) = (x + dx, y + dy);
                if u < 0 || u >= across as isize || v < 0 {
                    continue;
                }
                let Some(other) = lattice.get(v as usize * across + u as usize) else {
                    continue;
                };
                if other.is_soft && point.is_on_surface_of(other) {
                    // Each set of rays counts once: those at both ends are the same.
                    let half = |d: isize| if d.abs() == REACH { 0.5 } else { 1.0 };
                    mean.add(other, half(dx) * half(dy));
                }
            }
        }
        Self {
            z: point.z,
            normal: point.normal,
            is_soft: true,
            ..mean.of()
        }
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
        let (shares, light, brighter) = self.differences(other);
        shares < SAME_SHARE && light < SAME_LIGHT * brighter + DARK
    }

    /// Whether another pixel of the same surface shows something else.
    pub fn is_unlike(&self, other: &Self) -> bool {
        let (shares, light, brighter) = self.differences(other);
        shares > UNLIKE_SHARE || light > UNLIKE_LIGHT * brighter + UNLIKE_DARK
    }

    /// Differences of the shares of rays and of the light, and the brighter light.
    fn differences(&self, other: &Self) -> (f32, f32, f32) {
        let shares = (self.open - other.open)
            .abs()
            .max((self.seen - other.seen).abs());
        let light = (self.light - other.light).abs().max_element();
        (shares, light, self.light.max(other.light).max_element())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACROSS: usize = 9;

    fn point(seen: f32, z: f32) -> Nearby {
        Nearby {
            seen,
            open: 1.0 - seen,
            place: Vec3::new(seen, 0.5, 1.0),
            z,
            normal: Vec3::Z,
            is_soft: true,
            ..Nearby::NOTHING
        }
    }

    #[test]
    fn every_set_of_rays_counts_alike_in_a_soft_point() {
        // Each set of a square of four points sees something else; any such square has the same mean.
        let set = |i: usize| i % ACROSS % PERIOD + i / ACROSS % PERIOD * PERIOD;
        let lattice: Vec<Nearby> = (0..ACROSS * ACROSS)
            .map(|i| point(set(i) as f32 / 16.0, 1.0))
            .collect();
        for own in [2 * ACROSS + 2, 4 * ACROSS + 3, 5 * ACROSS + 6] {
            let soft = Nearby::softened(&lattice, ACROSS, own);
            assert!((soft.seen - 7.5 / 16.0).abs() < 1e-5, "{soft:?}");
            assert!((soft.open + soft.seen - 1.0).abs() < 1e-5, "{soft:?}");
        }
    }

    #[test]
    fn soft_points_are_averaged_over_their_own_surface_alone() {
        let mut lattice = vec![point(0.25, 1.0); ACROSS * ACROSS];
        for row in lattice.chunks_exact_mut(ACROSS) {
            // Behind it, and beside it without a wide lobe.
            row[5..].fill(point(0.75, 1.2));
            row[2] = Nearby {
                is_soft: false,
                ..point(0.75, 1.0)
            };
        }
        let own = 4 * ACROSS + 4;
        let soft = Nearby::softened(&lattice, ACROSS, own);
        assert!((soft.seen - 0.25).abs() < 1e-6, "{soft:?}");
        assert!((soft.place.x - 0.25).abs() < 1e-6, "{soft:?}");
    }
}
