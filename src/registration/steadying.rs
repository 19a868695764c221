//! Steadies the tracker's pose by the picture: what the tracker's noise adds from picture to picture
//! is removed, while the mean over time remains the tracker's.
//!
//! Points of real surfaces, the landmarks, are followed from picture to picture (Klein & Murray 2007,
//! "Parallel tracking and mapping for small AR workspaces"; patches as by Lucas & Kanade 1981). Each
//! has its place in the world from the surface that the picture shows there. The pose that fits them
//! is precise relative to the pictures before, but keeps the error of the pose from which they were
//! placed:
//!
//! ```text
//!   world_from_camera = G · V          V: the pose by landmarks, G: their common error
//!   G: mean of tracked · V⁻¹           over the pictures so far, at most some seconds
//! ```
//! The tracker's errors average out in G. Without landmarks V = G⁻¹ · tracked, by its prior.

mod adjustment;
mod corners;
mod landmark;
mod landmarks;
mod luminance;
mod patch;
mod tracker_mean;

use crate::TrackerPose;
use crate::motion::{difference, moved};
use crate::rate_limit::{RateLimiter, apart_pixels};
use glam::DVec3;
use landmark::View;
use landmarks::{Agreement, Landmarks};
use luminance::Luminance;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::{MonotonicTime, RigidTransform};
use tracker_mean::TrackerMean;

/// Gate of the squared Mahalanobis distance of the pose by landmarks from the tracker's: χ² of six degrees
/// of freedom at a probability of 1e-3.
const GATE: f64 = 22.5;
/// Successive pictures without agreement after which the landmarks are dropped.
const MAX_FAILURES: u32 = 3;
/// Pause after which everything starts again, seconds.
const MAX_PAUSE_SECONDS: f64 = 0.5;

/// A real surface where a ray meets it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceAt {
    /// World, metres.
    pub point: DVec3,
    /// Unit normal.
    pub normal: DVec3,
}

/// Returns where a ray (origin, direction; world) meets a real surface that does not mirror.
pub type Surfaces<'a> = dyn Fn(DVec3, DVec3) -> Option<SurfaceAt> + 'a;

/// A picture whose pose is to be steadied.
pub struct SteadyingInput<'a> {
    /// Middle of the exposure.
    pub at: MonotonicTime,
    /// The camera. Another lens than before drops the landmarks.
    pub camera: &'a PinholeCamera,
    /// 8-bit RGBA, rows tightly packed. If it hasn't the camera's size, the tracker's pose is returned.
    pub rgba: &'a [u8],
    /// The tracker's pose.
    pub tracked: TrackerPose,
    /// Motion of the camera during the readout.
    pub motion: Option<RollingShutter>,
    /// The real surfaces.
    pub surfaces: &'a Surfaces<'a>,
}

/// A steadied pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SteadiedPose {
    /// The pose to render with: `world_from_camera`.
    pub world_from_camera: RigidTransform,
    /// Number of landmarks that agree with it; 0 if it is the tracker's alone.
    pub landmarks: usize,
    /// Their median residual, pixels.
    pub residual_pixels: f64,
}

impl SteadiedPose {
    /// The tracker's pose as it is.
    const fn tracked(world_from_camera: RigidTransform) -> Self {
        Self {
            world_from_camera,
            landmarks: 0,
            residual_pixels: 0.0,
        }
    }
}

/// A picture's distance from the one before.
#[derive(Clone, Copy, Default)]
struct Elapsed {
    seconds: f64,
    /// Motion of the objects, pixels.
    pixels: f64,
    /// Speed of the camera: radians and metres per second.
    speed: [f64; 2],
}

/// Steadies the poses of a camera, picture by picture. Does not allocate after the first picture.
#[derive(Clone, Debug)]
pub struct Steadying {
    camera: PinholeCamera,
    /// Centre of the objects, world, metres.
    middle: DVec3,
    picture: Luminance,
    landmarks: Landmarks,
    mean: TrackerMean,
    /// Successive pictures without agreement.
    failures: u32,
    /// Time and tracked pose of the previous picture.
    last: Option<(MonotonicTime, RigidTransform)>,
    displayed: RateLimiter,
}

impl Steadying {
    /// Creates the steadying for `camera`. `middle`: centre of the objects, world, metres.
    #[must_use]
    pub fn new(camera: PinholeCamera, middle: DVec3) -> Self {
        Self {
            landmarks: Landmarks::new([camera.width, camera.height]),
            camera,
            middle,
            picture: Luminance::default(),
            mean: TrackerMean::new(),
            failures: 0,
            last: None,
            displayed: RateLimiter::new(),
        }
    }

    /// Forgets the pictures before.
    pub fn restart(&mut self) {
        self.landmarks.restart();
        self.mean = TrackerMean::new();
        self.failures = 0;
        self.last = None;
        self.displayed = RateLimiter::new();
    }

    fn forget_landmarks(&mut self) {
        self.landmarks.clear();
        self.mean.restart();
        self.failures = 0;
    }

    /// Steadies the pose of a picture.
    pub fn steady(&mut self, input: &SteadyingInput<'_>) -> SteadiedPose {
        let tracked = input.tracked.world_from_camera;
        if *input.camera != self.camera {
            *self = Self::new(input.camera.clone(), self.middle);
        }
        let size = [self.camera.width, self.camera.height];
        if input.rgba.len() != 4 * size[0] as usize * size[1] as usize {
            self.restart();
            return SteadiedPose::tracked(tracked);
        }
        let elapsed = self.elapsed(input.at, tracked);
        self.picture.read(input.rgba, size);
        let found = self.locate(input, &elapsed);
        let by_landmarks = found.map(|(pose, _)| pose);
        let target = by_landmarks.map_or(tracked, |pose| self.mean.apply(pose));
        let displayed = self.displayed.approach(
            (&self.camera, self.distance(&target)),
            target,
            // Continues by the landmarks where there are any.
            (by_landmarks, Some(tracked)),
            (elapsed.seconds, elapsed.pixels),
        );
        self.renew_landmarks(input, by_landmarks);
        SteadiedPose {
            world_from_camera: displayed,
            landmarks: found.map_or(0, |(_, agreement)| agreement.count),
            residual_pixels: found.map_or(0.0, |(_, agreement)| agreement.adjustment.pixels),
        }
    }

    /// Compares a picture with the one before. After a pause or a jump in time, everything starts again.
    fn elapsed(&mut self, at: MonotonicTime, tracked: RigidTransform) -> Elapsed {
        let Some((then, from)) = self.last.replace((at, tracked)) else {
            return Elapsed::default();
        };
        let seconds = at.seconds_since(then);
        if !(0.0..MAX_PAUSE_SECONDS).contains(&seconds) {
            self.restart();
            self.last = Some((at, tracked));
            return Elapsed::default();
        }
        let (rotation, translation) = difference(&from, &tracked);
        let speed = |length: f64| length / seconds.max(1e-3);
        Elapsed {
            seconds,
            pixels: apart_pixels(&self.camera, from, tracked, self.distance(&tracked)),
            speed: [speed(rotation.length()), speed(translation.length())],
        }
    }

    /// Distance of the objects' centre along the optical axis, metres, limited to 0.1 to 10.
    fn distance(&self, world_from_camera: &RigidTransform) -> f64 {
        let z = world_from_camera.inverse().transform_point(self.middle).z;
        z.clamp(0.1, 10.0)
    }

    /// Returns V and the landmarks that agree with it, after moving G; `None` if it cannot be trusted.
    fn locate(
        &mut self,
        input: &SteadyingInput<'_>,
        elapsed: &Elapsed,
    ) -> Option<(RigidTransform, Agreement)> {
        let tracked = &input.tracked;
        let expected = self.mean.expected(tracked.world_from_camera);
        let view = View {
            camera: &self.camera,
            motion: input.motion,
            pose: expected,
        };
        let sigmas = self.mean.sigmas(tracked, elapsed.speed);
        let found = self.landmarks.locate(&self.picture, &view, sigmas)?;
        let x = found.adjustment.x;
        self.mean.learn(&x, tracked, elapsed.speed);
        let departure = (0..6).map(|i| (x[i] / sigmas[i / 3]).powi(2));
        if departure.sum::<f64>() > GATE {
            return None;
        }
        let [rotation, translation] =
            [0, 3].map(|k| expected.rotation * DVec3::new(x[k], x[k + 1], x[k + 2]));
        let pose = moved(expected, rotation, translation);
        self.mean
            .average(pose, tracked.world_from_camera, sigmas, elapsed.seconds);
        Some((pose, found))
    }

    /// Makes landmarks for the next pictures by the pose V of this one. After several pictures without
    /// it, they are dropped and made anew by the tracker's pose.
    fn renew_landmarks(
        &mut self,
        input: &SteadyingInput<'_>,
        by_landmarks: Option<RigidTransform>,
    ) {
        self.failures = match by_landmarks {
            Some(_) => 0,
            None => self.failures + 1,
        };
        if self.failures >= MAX_FAILURES || self.landmarks.is_empty() {
            self.forget_landmarks();
        }
        let pose = match by_landmarks {
            Some(pose) => pose,
            None if self.landmarks.is_empty() => input.tracked.world_from_camera,
            None => return,
        };
        let view = View {
            camera: &self.camera,
            motion: input.motion,
            pose,
        };
        self.landmarks.renew(&self.picture, &view, input.surfaces);
    }
}

#[cfg(test)]
mod tests;
