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
mod luminance;
mod patch;

use crate::TrackerPose;
use crate::motion::{difference, moved};
use crate::rate_limit::{RateLimiter, apart_pixels};
use adjustment::{Adjustment, Sighting, adjust};
use corners::CornerGrid;
use glam::{DVec2, DVec3};
use landmark::{Landmark, View};
use luminance::Luminance;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_interface::{MonotonicTime, RigidTransform};

/// Maximum number of landmarks.
const MAX_LANDMARKS: usize = 96;
/// Least number of landmarks that agree with a pose.
const MIN_AGREEING: usize = 10;
/// Least share of the landmarks found that agree.
const MIN_SHARE: f64 = 0.5;
/// Largest scale of the residuals, in standard deviations.
const MAX_SCALE: f64 = 6.0;
/// Factor of the tracker's stated standard deviations: errors of its timing are not in them.
const PRIOR_FACTOR: f64 = 2.0;
/// Smallest standard deviations of the prior: radians, metres.
const MIN_PRIOR: [f64; 2] = [1e-4, 1e-4];
/// Gate of the squared Mahalanobis distance from the prior, six degrees of freedom.
const GATE: f64 = 60.0;
/// Time over which the tracker's poses are averaged, seconds.
const MEMORY_SECONDS: f64 = 2.0;
/// Successive pictures without agreement after which the landmarks are dropped.
const MAX_FAILURES: u32 = 3;
/// Successive pictures in which a landmark may be missed.
const MAX_MISSES: u32 = 3;
/// Cells in which landmarks are looked for in a picture, beyond the first.
const CELLS_PER_PICTURE: usize = 16;
/// Pause after which the landmarks are dropped, seconds.
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
    /// Scale of their residuals, pixels per axis.
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

/// A pose by landmarks.
#[derive(Clone, Copy)]
struct Located {
    /// V.
    pose: RigidTransform,
    /// Number of landmarks that agree.
    agreeing: usize,
    /// Scale of their residuals, pixels per axis.
    scale: f64,
}

/// Steadies the poses of a camera, picture by picture. Does not allocate after the first pictures.
#[derive(Clone, Debug)]
pub struct Steadying {
    camera: PinholeCamera,
    /// Centre of the objects, world, metres.
    middle: DVec3,
    picture: Luminance,
    grid: CornerGrid,
    landmarks: Vec<Landmark>,
    sightings: Vec<Sighting>,
    scratch: Vec<f64>,
    /// Whether a cell of the grid holds a landmark.
    occupied: Vec<bool>,
    /// The cell that is looked at next.
    turn: usize,
    /// G.
    world_from_map: RigidTransform,
    /// Pictures since the landmarks were placed.
    count: u32,
    /// Successive pictures without agreement.
    failures: u32,
    last: Option<(MonotonicTime, RigidTransform)>,
    displayed: RateLimiter,
}

impl Steadying {
    /// Creates the steadying for `camera`. `middle`: centre of the objects, world, metres.
    #[must_use]
    pub fn new(camera: PinholeCamera, middle: DVec3) -> Self {
        let grid = CornerGrid::new([camera.width, camera.height]);
        Self {
            occupied: vec![false; grid.len()],
            landmarks: Vec::with_capacity(MAX_LANDMARKS),
            sightings: Vec::with_capacity(MAX_LANDMARKS),
            scratch: Vec::with_capacity(MAX_LANDMARKS),
            camera,
            middle,
            picture: Luminance::default(),
            grid,
            turn: 0,
            world_from_map: RigidTransform::IDENTITY,
            count: 0,
            failures: 0,
            last: None,
            displayed: RateLimiter::new(),
        }
    }

    /// Forgets everything.
    pub fn restart(&mut self) {
        self.forget_landmarks();
        self.last = None;
        self.displayed = RateLimiter::new();
    }

    fn forget_landmarks(&mut self) {
        self.landmarks.clear();
        self.world_from_map = RigidTransform::IDENTITY;
        self.count = 0;
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
        let (seconds, motion) = self.elapsed(input.at, tracked);
        self.picture.read(input.rgba, size);
        let expected = self.world_from_map.inverse() * tracked;
        let found = self.locate(expected, input);
        let by_landmarks = found.map(|found| found.pose);
        self.note_success(by_landmarks.is_some());
        if let Some(pose) = by_landmarks {
            self.average(pose, tracked, seconds);
        }
        let target = by_landmarks.map_or(tracked, |pose| self.world_from_map * pose);
        let distance = self.distance(&target);
        let displayed = self.displayed.approach(
            (&self.camera, distance),
            target,
            // Continues by the landmarks where there are any.
            (by_landmarks, Some(tracked)),
            (seconds, motion),
        );
        if self.landmarks.is_empty() {
            self.place_landmarks(tracked, input, self.grid.len());
            self.count = 1;
        } else if let Some(pose) = by_landmarks {
            self.place_landmarks(pose, input, CELLS_PER_PICTURE);
        }
        SteadiedPose {
            world_from_camera: displayed,
            landmarks: found.map_or(0, |found| found.agreeing),
            residual_pixels: found.map_or(0.0, |found| found.scale),
        }
    }

    /// Seconds since the previous picture, and its motion in pixels. After a pause or a jump in time,
    /// everything starts again.
    fn elapsed(&mut self, at: MonotonicTime, tracked: RigidTransform) -> (f64, f64) {
        let Some((then, from)) = self.last.replace((at, tracked)) else {
            return (0.0, 0.0);
        };
        let seconds = at.seconds_since(then);
        if !(0.0..MAX_PAUSE_SECONDS).contains(&seconds) {
            self.restart();
            self.last = Some((at, tracked));
            return (0.0, 0.0);
        }
        let motion = apart_pixels(&self.camera, from, tracked, self.distance(&tracked));
        (seconds, motion)
    }

    /// Distance of the objects' centre along the optical axis, metres, limited to 0.1 to 10.
    fn distance(&self, world_from_camera: &RigidTransform) -> f64 {
        let z = world_from_camera.inverse().transform_point(self.middle).z;
        z.clamp(0.1, 10.0)
    }

    /// Returns the pose by the landmarks near the `expected` one and how many of them agree; `None` if
    /// it cannot be trusted.
    fn locate(&mut self, expected: RigidTransform, input: &SteadyingInput<'_>) -> Option<Located> {
        let view = View {
            camera: &self.camera,
            motion: input.motion,
            pose: expected,
        };
        self.sightings.clear();
        let all = self.landmarks.iter().enumerate();
        let found = all.filter_map(|(i, landmark)| landmark.find(i, &self.picture, &view));
        self.sightings.extend(found);
        let [metres, radians] = input.tracked.noise;
        let sigmas = [
            (PRIOR_FACTOR * radians).max(MIN_PRIOR[0]),
            (PRIOR_FACTOR * metres).max(MIN_PRIOR[1]),
        ];
        let adjusted = adjust(&self.sightings, sigmas, &mut self.scratch)?;
        let agreeing = self.note_misses(&adjusted);
        let departure: f64 = (0..6)
            .map(|i| (adjusted.x[i] / sigmas[i / 3]).powi(2))
            .sum();
        let is_trusted = agreeing >= MIN_AGREEING
            && agreeing as f64 >= MIN_SHARE * self.sightings.len() as f64
            && adjusted.scale <= MAX_SCALE
            && departure <= GATE;
        let [rotation, translation] = [0, 3].map(|k| {
            let x = &adjusted.x[k..k + 3];
            expected.rotation * DVec3::new(x[0], x[1], x[2])
        });
        is_trusted.then(|| Located {
            pose: moved(expected, rotation, translation),
            agreeing,
            scale: adjusted.scale,
        })
    }

    /// Counts the pictures in which landmarks were missed; returns the number of those that agree.
    fn note_misses(&mut self, adjusted: &Adjustment) -> usize {
        for landmark in &mut self.landmarks {
            landmark.misses += 1;
        }
        let mut agreeing = 0;
        for sighting in &self.sightings {
            let landmark = &mut self.landmarks[sighting.landmark];
            let residual = adjusted.residual(sighting);
            landmark.note(residual);
            if adjusted.agrees(residual) {
                landmark.misses = 0;
                agreeing += 1;
            }
        }
        agreeing
    }

    fn note_success(&mut self, success: bool) {
        self.failures = if success { 0 } else { self.failures + 1 };
        if self.failures >= MAX_FAILURES {
            self.forget_landmarks();
        }
    }

    /// Moves G by this picture's share towards tracked · V⁻¹.
    fn average(&mut self, by_landmarks: RigidTransform, tracked: RigidTransform, seconds: f64) {
        self.count = self.count.saturating_add(1);
        let share = f64::from(self.count).recip().max(seconds / MEMORY_SECONDS);
        let now = self.world_from_map * by_landmarks;
        let (rotation, translation) = difference(&now, &tracked);
        let moved = moved(now, rotation * share, translation * share);
        self.world_from_map = moved * by_landmarks.inverse();
    }

    /// Places landmarks in up to `cells` cells without one, by the pose `pose` of the map.
    fn place_landmarks(&mut self, pose: RigidTransform, input: &SteadyingInput<'_>, cells: usize) {
        let view = View {
            camera: &self.camera,
            motion: input.motion,
            pose,
        };
        self.occupied.fill(false);
        let (grid, occupied, picture) = (&mut self.grid, &mut self.occupied, &self.picture);
        self.landmarks.retain(|landmark| {
            let place = landmark.predict(&view).map(|(place, _)| place);
            let place = place.filter(|p| picture.contains(*p, 1.0));
            let cell = place.and_then(|p: DVec2| grid.cell_of([p.x as usize, p.y as usize]));
            if let Some(cell) = cell {
                occupied[cell] = true;
            }
            cell.is_some() && landmark.misses < MAX_MISSES
        });
        for _ in 0..cells.min(grid.len()) {
            if self.landmarks.len() >= MAX_LANDMARKS {
                return;
            }
            let cell = self.turn;
            self.turn = (self.turn + 1) % grid.len();
            if occupied[cell] {
                continue;
            }
            let corner = grid.best_in(picture, cell);
            let new = corner.and_then(|c| Landmark::new(picture, c, &view, input.surfaces));
            self.landmarks.extend(new);
        }
    }
}
