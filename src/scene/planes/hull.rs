//! Convex hulls and approximate convex decomposition (V-HACD, Mamou 2016) by the crate `parry3d`, which
//! uses single precision and may panic: coordinates are normalised and panics are caught.

use glam::DVec3;
use parry3d::math::Vector;
use parry3d::transformation::try_convex_hull;
use parry3d::transformation::vhacd::{VHACD, VHACDParameters};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Number of directions whose extreme points make up a hull; more only sharpen its corners.
const DIRECTIONS: usize = 400;
/// Voxels along the longest edge of a decomposed solid.
const VOXELS: u32 = 48;

/// Maps the world to a unit cube around the origin, where single precision suffices.
#[derive(Clone, Copy, Debug)]
struct Frame {
    middle: DVec3,
    scale: f64,
}

impl Frame {
    fn around(points: &[DVec3]) -> Option<Self> {
        let (low, high) = super::surface::bounds(points.iter().copied());
        let extent = (high - low).max_element();
        (extent.is_finite() && extent > 0.0).then(|| Self {
            middle: low.midpoint(high),
            scale: 1.0 / extent,
        })
    }

    fn map(self, p: DVec3) -> Vector {
        let q = ((p - self.middle) * self.scale).as_vec3();
        Vector::new(q.x, q.y, q.z)
    }
}

/// Returns unit normal and area (relative to the square of the extent) of each face of the convex
/// hull; empty for coplanar or invalid points.
pub(super) fn hull_faces(points: &[DVec3]) -> Vec<(DVec3, f64)> {
    let Some(frame) = Frame::around(points) else {
        return Vec::new();
    };
    let extreme: Vec<Vector> = extreme(points).into_iter().map(|p| frame.map(p)).collect();
    let hull = catch_panic(|| try_convex_hull(&extreme).ok()).flatten();
    let Some((corners, faces)) = hull else {
        return Vec::new();
    };
    let corner = |i: u32| {
        corners
            .get(i as usize)
            .map(|v| DVec3::new(v.x.into(), v.y.into(), v.z.into()))
    };
    faces
        .iter()
        .filter_map(|[a, b, c]| {
            let (a, b, c) = (corner(*a)?, corner(*b)?, corner(*c)?);
            let cross = (b - a).cross(c - a);
            Some((cross.try_normalize()?, cross.length() / 2.0))
        })
        .collect()
}

/// Returns the extreme points of [`DIRECTIONS`] directions, without duplicates.
fn extreme(points: &[DVec3]) -> Vec<DVec3> {
    let mut chosen: Vec<usize> = (0..DIRECTIONS)
        .filter_map(|i| {
            let z = 1.0 - (2.0 * i as f64 + 1.0) / DIRECTIONS as f64;
            let azimuth = i as f64 * 2.399_963_229_728_653;
            let out = (1.0 - z * z).sqrt();
            farthest(
                points,
                DVec3::new(out * azimuth.cos(), out * azimuth.sin(), z),
            )
        })
        .collect();
    chosen.sort_unstable();
    chosen.dedup();
    let mut out: Vec<DVec3> = chosen
        .into_iter()
        .filter_map(|i| points.get(i).copied())
        .collect();
    out.sort_by(|a, b| {
        a.to_array()
            .partial_cmp(&b.to_array())
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    out.dedup();
    out
}

fn farthest(points: &[DVec3], direction: DVec3) -> Option<usize> {
    let along = points.iter().map(|p| p.dot(direction)).enumerate();
    along
        .fold(None, |best: Option<(usize, f64)>, (i, d)| match best {
            Some((_, max)) if max >= d => best,
            _ => Some((i, d)),
        })
        .map(|(i, _)| i)
}

/// Clusters of a decomposition by voxel.
#[derive(Clone, Debug)]
pub(super) struct Clusters {
    frame: Frame,
    origin: DVec3,
    voxel: f64,
    /// Coordinates and cluster of each voxel of the decomposition.
    voxels: std::collections::HashMap<[i32; 3], u32>,
    /// Number of clusters.
    pub count: u32,
}

impl Clusters {
    /// Divides the solid that `triangles` bound, or the surface if it is open, into at most
    /// `max_clusters` nearly convex clusters. `None` if there is only one.
    pub fn divide(triangles: &[[DVec3; 3]], max_clusters: u32) -> Option<Self> {
        let points: Vec<DVec3> = triangles.iter().flatten().copied().collect();
        let frame = Frame::around(&points)?;
        let inside: Vec<Vector> = points.iter().map(|p| frame.map(*p)).collect();
        let indices: Vec<[u32; 3]> = (0..triangles.len() as u32)
            .map(|i| [3 * i, 3 * i + 1, 3 * i + 2])
            .collect();
        let parameters = VHACDParameters {
            resolution: VOXELS,
            max_convex_hulls: max_clusters,
            ..VHACDParameters::default()
        };
        let division = catch_panic(|| VHACD::decompose(&parameters, &inside, &indices, false))?;
        Self::from_division(&division, frame, max_clusters)
    }

    fn from_division(division: &VHACD, frame: Frame, max_clusters: u32) -> Option<Self> {
        let sets = division.voxel_parts();
        let first = sets.first().filter(|_| sets.len() > 1)?;
        let mut voxels = std::collections::HashMap::new();
        for (cluster, set) in sets.iter().enumerate() {
            // The library may return more: they are added to the last.
            let cluster = (cluster as u32).min(max_clusters.saturating_sub(1));
            for voxel in set.voxels() {
                voxels.insert([voxel.coords.x, voxel.coords.y, voxel.coords.z], cluster);
            }
        }
        Some(Self {
            frame,
            origin: DVec3::new(
                first.origin.x.into(),
                first.origin.y.into(),
                first.origin.z.into(),
            ),
            voxel: first.scale.into(),
            voxels,
            count: (sets.len() as u32).min(max_clusters),
        })
    }

    /// Returns the cluster at a point of the surface: that of its voxel or of the nearest one.
    pub fn at(&self, point: DVec3) -> u32 {
        let p = ((point - self.frame.middle) * self.frame.scale - self.origin) / self.voxel;
        let c = p.round().as_ivec3();
        for reach in 0..3 {
            if let Some(found) = self.nearest(p, c, reach) {
                return found;
            }
        }
        0
    }

    fn nearest(&self, p: DVec3, c: glam::IVec3, reach: i32) -> Option<u32> {
        let mut best: Option<(f64, u32)> = None;
        for (x, y, z) in cube(reach) {
            let at = c + glam::IVec3::new(x, y, z);
            let Some(cluster) = self.voxels.get(&at.to_array()) else {
                continue;
            };
            let distance = p.distance_squared(at.as_dvec3());
            if best.is_none_or(|(min, _)| distance < min) {
                best = Some((distance, *cluster));
            }
        }
        best.map(|(_, cluster)| cluster)
    }
}

fn cube(reach: i32) -> impl Iterator<Item = (i32, i32, i32)> {
    let side = move || -reach..=reach;
    side().flat_map(move |x| side().flat_map(move |y| side().map(move |z| (x, y, z))))
}

/// Returns the result of `work`; `None` if it panics.
fn catch_panic<T>(work: impl FnOnce() -> T) -> Option<T> {
    catch_unwind(AssertUnwindSafe(work)).ok()
}
