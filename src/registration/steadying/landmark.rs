//! A point of a real surface that is followed from picture to picture.

use super::adjustment::{Coordinate, Sighting};
use super::luminance::Luminance;
use super::patch::Patch;
use super::{SurfaceAt, Surfaces};
use crate::motion::moved;
use glam::{DMat2, DVec2, DVec3};
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::RigidTransform;

/// Distance of the pixels whose surface is compared with the landmark's, pixels.
const BESIDE: f64 = 5.0;
/// Largest distance of the surface beside a landmark from its plane, share of its distance from the
/// camera.
const FLAT: f64 = 0.01;
/// Least cosine between a surface's normal and the direction to the camera.
const MIN_COSINE: f64 = 0.15;
/// Change of a patch's size in the picture, in area, up to which it is looked for.
const MAX_SCALING: f64 = 1.6;
/// Largest aspect ratio of a patch's change.
const MAX_SHEAR: f64 = 1.6;
/// Share of a picture in the mean square of a landmark's residuals.
const SPREAD_SHARE: f64 = 0.25;
/// Length over which the projection is differentiated, share of the distance.
const STEP: f64 = 1e-4;

/// A camera that takes a picture.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub camera: &'a PinholeCamera,
    /// Motion during the readout.
    pub motion: Option<RollingShutter>,
    /// `world_from_camera` at the middle row.
    pub pose: RigidTransform,
}

impl View<'_> {
    fn project(&self, point_in_camera: DVec3) -> Option<DVec2> {
        match &self.motion {
            Some(motion) => motion.project(self.camera, point_in_camera),
            None => self.camera.project(point_in_camera),
        }
    }

    /// Origin and direction of the ray through a pixel, in the world.
    fn ray(&self, pixel: DVec2) -> (DVec3, DVec3) {
        let pose = self.motion.map_or(self.pose, |motion| {
            let rows = pixel.y - RollingShutter::middle_row(self.camera);
            let [rotation, translation] = [motion.rotation_per_row, motion.translation_per_row]
                .map(|per_row| self.pose.rotation * per_row * rows);
            moved(self.pose, rotation, translation)
        });
        let direction = pose.rotation * self.camera.unproject(pixel);
        (pose.translation, direction)
    }
}

/// A landmark.
#[derive(Clone, Debug)]
pub(super) struct Landmark {
    /// World, metres.
    position: DVec3,
    /// What a pixel along x and y of the picture in which it was found is on the surface, world, metres.
    axes: [DVec3; 2],
    patch: Patch,
    /// Successive pictures in which it was not found, or disagreed.
    pub misses: u32,
    /// Recent mean square of its residuals, variances.
    spread: f64,
}

impl Landmark {
    /// Makes a landmark of what a picture shows around a pixel; `None` if that isn't a flat part of a
    /// known surface with texture.
    pub fn new(
        picture: &Luminance,
        pixel: [usize; 2],
        view: &View<'_>,
        surfaces: &Surfaces<'_>,
    ) -> Option<Self> {
        let centre = DVec2::new(pixel[0] as f64, pixel[1] as f64);
        let (origin, direction) = view.ray(centre);
        let SurfaceAt { point, normal } = surfaces(origin, direction)?;
        let distance = point.distance(origin);
        let cosine = normal.dot(direction).abs() / direction.length();
        if !(cosine >= MIN_COSINE && distance > 0.0) {
            return None;
        }
        let beside = [DVec2::X, DVec2::Y, -DVec2::X, -DVec2::Y].map(|d| d * BESIDE);
        let is_flat = beside.into_iter().all(|offset| {
            let (origin, direction) = view.ray(centre + offset);
            surfaces(origin, direction)
                .is_some_and(|s| (s.point - point).dot(normal).abs() <= FLAT * distance)
        });
        if !is_flat {
            return None;
        }
        let on_plane = |offset: DVec2| {
            let (origin, direction) = view.ray(centre + offset);
            let along = (point - origin).dot(normal) / direction.dot(normal);
            (origin + direction * along - point) / offset.length()
        };
        Some(Self {
            position: point,
            axes: [on_plane(DVec2::X), on_plane(DVec2::Y)],
            patch: Patch::read(picture, pixel)?,
            misses: 0,
            spread: 1.0,
        })
    }

    /// Notes a residual, in standard deviations as they were stated.
    pub fn note(&mut self, residual: f64) {
        let square = residual * residual * self.spread.max(1.0);
        self.spread += SPREAD_SHARE * (square - self.spread);
    }

    /// Predicts the landmark's place in a picture, and what its patch's axes are there; `None` if it
    /// is out of sight or looks too different.
    pub fn predict(&self, view: &View<'_>) -> Option<(DVec2, DMat2)> {
        let from_world = view.pose.inverse();
        let shown = |point: DVec3| view.project(from_world.transform_point(point));
        let place = shown(self.position)?;
        let [x, y] = self.axes.map(|axis| shown(self.position + axis));
        let axes = DMat2::from_cols(x? - place, y? - place);
        let area = axes.determinant();
        let squares = axes.x_axis.length_squared() + axes.y_axis.length_squared();
        let is_similar = (MAX_SCALING.recip()..MAX_SCALING).contains(&area)
            && squares <= (MAX_SHEAR + MAX_SHEAR.recip()) * area;
        is_similar.then_some((place, axes))
    }

    /// Looks for the landmark in a picture, near its predicted place.
    pub fn find(&self, landmark: usize, picture: &Luminance, view: &View<'_>) -> Option<Sighting> {
        let (place, axes) = self.predict(view)?;
        let found = self.patch.find(picture, place, axes)?;
        let jacobian = self.jacobian(view)?;
        let to_patch = axes.inverse();
        let coordinates = found.shifts.map(|shift| {
            let Some((direction, shift, sigma)) = shift else {
                return Coordinate::default();
            };
            let sigma = sigma * self.spread.max(1.0).sqrt();
            Coordinate {
                residual: shift / sigma,
                derivative: jacobian.map(|column| direction.dot(to_patch * column) / sigma),
                sigma,
            }
        });
        Some(Sighting {
            landmark,
            coordinates,
        })
    }

    /// Derivative of the place in the picture by a rotation vector and a translation of the camera,
    /// both in its axes.
    fn jacobian(&self, view: &View<'_>) -> Option<[DVec2; 6]> {
        let point = view.pose.inverse().transform_point(self.position);
        let place = view.camera.project(point)?;
        let step = STEP * point.length();
        let mut by_point = [DVec2::ZERO; 3];
        for (derivative, axis) in by_point.iter_mut().zip(DVec3::AXES) {
            *derivative = (view.camera.project(point + axis * step)? - place) / step;
        }
        let along = |v: DVec3| by_point[0] * v.x + by_point[1] * v.y + by_point[2] * v.z;
        let [x, y, z] = DVec3::AXES;
        // The point moves by −ω × p − t in the camera's axes.
        Some([
            along(point.cross(x)),
            along(point.cross(y)),
            along(point.cross(z)),
            along(-x),
            along(-y),
            along(-z),
        ])
    }
}
