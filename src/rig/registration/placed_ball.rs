//! A mirrored ball that a hand has put onto its marked place: where it really lies, learned from its
//! rim in the pictures.
//!
//! ```text
//!  The rim gives the ray to the ball's centre; the ball's height is known, because it lies on the
//!  ground, so the ray's point at that height is a measurement of the place. The place is the median
//!  of the last measurements: a rim of low contrast is sometimes found beside the true one.
//! ```

use glam::{DVec2, DVec3};
use penumbra_camera::{MirrorSphere, PinholeCamera, SphereInCamera};
use penumbra_interface::RigidTransform;
use penumbra_lighting::SpherePosition;
use penumbra_lighting::outline::{LocatedSphere, locate};
use penumbra_numerics::median;
use penumbra_picture::Picture;
use std::collections::VecDeque;

/// Minimum share of the rim that must be visible.
pub(super) const MIN_SUPPORT: f64 = 0.4;
/// Minimum standard deviation of a measured place, pixels: lens and pose.
const MIN_SIGMA: f64 = 0.5;
/// Minimum slope of a ray: a flatter one meets the height of the centre at a wide angle of error.
const MIN_SLOPE: f64 = 0.15;
/// Number of measurements of which the place is the median.
const MEASUREMENTS: usize = 31;
/// Measurements from which on the ball is searched near their median, and its standard deviation
/// then, metres.
const ENOUGH: usize = 5;
const MEDIAN_SIGMA: f64 = 0.0012;
/// Pictures without the ball after which its place counts as unknown again.
const MAX_MISSES: u32 = 15;

/// The ball, as stated and as found.
pub(super) struct PlacedBall {
    stated: DVec3,
    radius: f64,
    /// Standard deviation of the stated place, metres.
    sigma: f64,
    /// The last places that were found, on the ground, oldest first.
    places: VecDeque<DVec2>,
    misses: u32,
}

/// What a picture shows of the ball.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct BallView {
    /// The ball's position for the light; `None` if it is not known.
    pub position: Option<SpherePosition>,
    /// Share of the rim that was found in this picture.
    pub support: Option<f64>,
    /// Distance of the place that was found from the stated one, metres.
    pub off: Option<f64>,
}

impl PlacedBall {
    /// Creates the ball; `None` if its centre was measured.
    pub fn new(sphere: &MirrorSphere) -> Option<Self> {
        (sphere.position_sigma > 0.0).then_some(Self {
            stated: sphere.centre_in_world,
            radius: sphere.radius,
            sigma: sphere.position_sigma,
            places: VecDeque::with_capacity(MEASUREMENTS),
            misses: 0,
        })
    }

    /// Searches a picture for the ball.
    pub fn look(
        &mut self,
        picture: &Picture,
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
    ) -> BallView {
        let located = self.locate(picture, camera, world_from_camera);
        let support = located.map(|l| l.support);
        let seen = located.filter(|l| l.support >= MIN_SUPPORT);
        let measured = seen.and_then(|l| self.place(&l.sphere, world_from_camera));
        if let Some(place) = measured {
            if self.places.len() == MEASUREMENTS {
                self.places.pop_front();
            }
            self.places.push_back(place);
            self.misses = 0;
        } else {
            self.misses = self.misses.saturating_add(1);
            if self.misses > MAX_MISSES {
                self.places.clear();
            }
        }
        let centre = self.centre();
        let position = centre.map(|centre_in_world| SpherePosition {
            centre_in_world,
            sigma: MIN_SIGMA,
        });
        BallView {
            position,
            support,
            off: centre.map(|centre| centre.distance(self.stated)),
        }
    }

    fn locate(
        &self,
        picture: &Picture,
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
    ) -> Option<LocatedSphere> {
        let metres = if self.places.len() < ENOUGH {
            self.sigma
        } else {
            MEDIAN_SIGMA.min(self.sigma)
        };
        let centre = self.centre().unwrap_or(self.stated);
        let centre = world_from_camera.inverse().transform_point(centre);
        let in_pixels = camera.focal.x * metres / centre.z.max(0.05);
        let predicted = SphereInCamera {
            centre,
            radius: self.radius,
            sigma: in_pixels.hypot(MIN_SIGMA),
        };
        // The rays of a rim that is behind the camera have no pixels.
        let is_in_front = centre.z > self.radius;
        locate(picture, camera, &predicted).filter(|_| is_in_front)
    }

    /// Returns the median of the measured places; `None` before the first.
    fn centre(&self) -> Option<DVec3> {
        let along = |axis: usize| median(self.places.iter().map(|place| place[axis]));
        Some(DVec3::new(along(0)?, along(1)?, self.stated.z))
    }

    /// Returns the place at which a picture shows the ball; `None` if it is farther from the stated
    /// one than a hand misses, or seen from the side.
    fn place(&self, seen: &SphereInCamera, world_from_camera: RigidTransform) -> Option<DVec2> {
        let eye = world_from_camera.translation;
        let ray = world_from_camera.rotation * seen.centre.normalize();
        let along = (self.stated.z - eye.z) / ray.z;
        let centre = eye + ray * along;
        let is_near = centre.distance(self.stated) < 5.0 * self.sigma;
        let is_steep = ray.z.abs() > MIN_SLOPE;
        (along > 0.0 && is_near && is_steep && centre.is_finite()).then(|| centre.truncate())
    }
}
