//! The hull of shadow casters, and the fit of shadow maps to it.

use glam::{Mat4, Vec2, Vec3};
use penumbra_lighting::{DomeLight, LightKind, LightPlace};

/// Extreme points of a set of casters, to which a shadow map is fitted from any direction.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CasterHull {
    pub points: Vec<Vec3>,
    /// Moving casters: the index of their first point in `points`, and their points in their own
    /// frames.
    moving: Vec<(usize, Vec<Vec3>)>,
}

/// Number of directions along which [`CasterHull`] keeps the outermost vertex.
const HULL_DIRECTIONS: usize = 512;
/// Share by which maps are larger than the hull: outermost vertices along finitely many directions
/// give a slightly too small hull.
const HULL_MARGIN: f32 = 0.01;

impl CasterHull {
    /// The outermost of `vertices` (world, metres) along directions spread over the sphere.
    #[must_use]
    pub fn around(vertices: &[[f32; 3]]) -> Self {
        let keep = Self::outermost(vertices).into_iter();
        Self {
            points: keep.map(|i| Vec3::from(vertices[i])).collect(),
            moving: Vec::new(),
        }
    }

    /// The indices of these vertices.
    #[must_use]
    pub fn outermost(vertices: &[[f32; 3]]) -> Vec<usize> {
        let mut keep: Vec<usize> = fibonacci_sphere(HULL_DIRECTIONS)
            .filter_map(|d| {
                let along = |i: &usize| Vec3::from(vertices[*i]).dot(d);
                (0..vertices.len()).max_by(|a, b| along(a).total_cmp(&along(b)))
            })
            .collect();
        keep.sort_unstable();
        keep.dedup();
        keep
    }

    /// Adds moving casters: their outermost points in their own frames, and their placements.
    #[must_use]
    pub fn with_moving(mut self, moving: impl Iterator<Item = (Vec<Vec3>, Mat4)>) -> Self {
        for (own, world) in moving {
            let first = self.points.len();
            self.points
                .extend(own.iter().map(|p| world.transform_point3(*p)));
            self.moving.push((first, own));
        }
        self
    }

    /// Moves moving caster `number` to `world`.
    pub fn place(&mut self, number: usize, world: Mat4) {
        if let Some((first, own)) = self.moving.get(number) {
            let points = self.points.iter_mut().skip(*first);
            for (point, own) in points.zip(own) {
                *point = world.transform_point3(*own);
            }
        }
    }

    /// The hull of both sets, without motion.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            points: [self.points.as_slice(), &other.points].concat(),
            moving: Vec::new(),
        }
    }

    /// Axis and half angle, radians, of a narrow cone from `eye` around all points. The angle is
    /// infinite if the eye is among the casters; `None` without points.
    #[must_use]
    pub fn cone_from(&self, eye: Vec3) -> Option<(Vec3, f32)> {
        let away = |p: &Vec3| (*p - eye).try_normalize().unwrap_or(Vec3::ZERO);
        let first = away(self.points.first()?);
        let bounds = self.points.iter().map(away);
        let (low, high) = bounds.fold((first, first), |(l, h), d| (l.min(d), h.max(d)));
        let axis = (low + high).try_normalize();
        let narrowest = self
            .points
            .iter()
            .map(away)
            .map(|d| d.dot(axis.unwrap_or_default()));
        let cosine = narrowest.fold(1.0, f32::min);
        Some(match axis {
            Some(axis) if cosine > 0.01 => (axis, cosine.acos()),
            _ => (Vec3::Z, f32::INFINITY),
        })
    }

    /// Half angle, radians, of the cone from `eye` about `axis` that holds all points.
    pub fn angle_around(&self, eye: Vec3, axis: Vec3) -> f32 {
        let cosine = |p: &Vec3| (*p - eye).try_normalize().map_or(-1.0, |d| d.dot(axis));
        self.points
            .iter()
            .map(cosine)
            .fold(1.0, f32::min)
            .clamp(-1.0, 1.0)
            .acos()
    }

    /// Minimum and maximum coordinate along `axis`; `None` without points.
    pub fn extent(&self, axis: Vec3) -> Option<(f32, f32)> {
        self.points
            .iter()
            .map(|p| p.dot(axis))
            .fold(None, |range, x| match range {
                None => Some((x, x)),
                Some((lo, hi)) => Some((lo.min(x), hi.max(x))),
            })
    }
}

/// Points spread evenly over the unit sphere along a golden spiral.
pub fn fibonacci_sphere(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * cos, r * sin, z)
    })
}

/// An affine map from the world to a shadow map: rows for u, v and depth; the size of a texel and
/// the length of the depth range, metres. All zero without casters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    pub rows: [[f32; 4]; 3],
    pub texel: f32,
    pub depth: f32,
}

impl Fit {
    pub const NOWHERE: Self = Self {
        rows: [[0.0; 4]; 3],
        texel: 0.0,
        depth: 0.0,
    };
}

/// Fits a shadow map of `map_size` texels a side to `hull` as seen from the direction `to_light`.
pub fn fit(hull: &CasterHull, to_light: Vec3, map_size: u32) -> Fit {
    let light = DomeLight {
        direction: to_light,
        irradiance: Vec3::ONE,
        angular_radius: 0.0,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    };
    let found = fit_light(hull, &light, map_size);
    if found == LightFit::NOWHERE {
        return Fit::NOWHERE;
    }
    let (right, up) = to_light.any_orthonormal_pair();
    let row = |axis: Vec3, scale: f32, offset: f32| (axis * scale).extend(offset).to_array();
    Fit {
        rows: [
            row(right, found.scale.x, found.offset.x),
            row(up, found.scale.y, found.offset.y),
            row(-to_light, found.depth_scale, found.depth_offset),
        ],
        texel: found.texel,
        depth: found.depth_scale.recip(),
    }
}

/// How a shadow map of a light is fitted to its casters: scales and offsets from the light's space
/// (metres; see `in_light_space` of the shaders) to texture coordinates and depth, and the size of
/// a texel, metres. All zero without casters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightFit {
    pub scale: Vec2,
    pub offset: Vec2,
    pub depth_scale: f32,
    pub depth_offset: f32,
    pub texel: f32,
}

impl LightFit {
    pub const NOWHERE: Self = Self {
        scale: Vec2::ZERO,
        offset: Vec2::ZERO,
        depth_scale: 0.0,
        depth_offset: 0.0,
        texel: 0.0,
    };
}

/// Fits a shadow map of `map_size` texels a side to `hull` as `light` sees it.
pub fn fit_light(hull: &CasterHull, light: &DomeLight, map_size: u32) -> LightFit {
    let (right, up) = light.direction.any_orthonormal_pair();
    let points = hull.points.iter();
    let seen = points.filter_map(|p| light.in_light_space([right, up], *p));
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) = seen.fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    if low.x > high.x {
        return LightFit::NOWHERE;
    }
    // A border of two texels keeps filtering at the edge free of casters.
    let pad = (high - low).max(Vec3::splat(1e-4)) * (HULL_MARGIN + 2.0 / map_size as f32);
    let (low, high) = (low - pad, high + pad);
    let scale = (high - low).recip();
    let offset = -low * scale;
    LightFit {
        scale: scale.truncate(),
        offset: offset.truncate(),
        depth_scale: scale.z,
        depth_offset: offset.z,
        texel: (high - low).truncate().max_element() / map_size as f32,
    }
}
