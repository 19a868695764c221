//! Predicts the camera's pose at the instant at which its picture is displayed.
//!
//! The tracker's motion is extrapolated to that instant and applied to the registered pose of the
//! picture, which keeps the correction by markers. Without a tracker, the registered poses of the
//! earlier pictures are extrapolated. The reported error is the recent error of predictions over
//! the same time.

use crate::feed::TrackerHistory;
use crate::setup::RigSetup;
use glam::{DQuat, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_compositor::Reprojection;
use penumbra_config::Config;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_status::{DisplayStatus, RegistrationStatus};
use penumbra_sync::{HistoryConfig, PoseAt, PoseHistory, RigFrame};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

/// Maximum prediction time after the newest reading, nanoseconds.
const MAX_PREDICTION_NANOS: i64 = 250_000_000;
/// Number of picture poses kept: a few seconds.
const MAX_PICTURE_POSES: usize = 128;
/// Maximum rotation between a picture and its display, radians; a head turns less, so a larger one
/// is a fault.
const MAX_ROTATION: f64 = 0.4;
/// Range of the depth at which the picture is reprojected, metres.
const DEPTH_RANGE: std::ops::RangeInclusive<f64> = 0.1..=20.0;

/// Moving average of the time from a picture's arrival until it is passed to the window,
/// nanoseconds.
#[derive(Debug, Default)]
pub(super) struct DisplayLatency(AtomicI64);

impl DisplayLatency {
    /// Adds a picture's time, with a weight of one eighth.
    pub fn add(&self, nanos: i64) {
        let known = self.0.load(Ordering::Relaxed);
        let next = if known == 0 {
            nanos
        } else {
            known + (nanos - known) / 8
        };
        self.0.store(next.max(1), Ordering::Relaxed);
    }

    fn nanos(&self) -> i64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Predicts the camera's pose for the display of its pictures.
pub(super) struct DisplayPredictor {
    /// Time from passing a picture to the window until its display.
    delay_nanos: i64,
    /// Time from arrival to the window in a live rig. In a replay, this is only the time that a
    /// live rig would have waited for the tracker, so that the result does not depend on the
    /// computer.
    latency: Option<Arc<DisplayLatency>>,
    /// Maximum time that a live rig waits for the tracker.
    max_wait_nanos: i64,
    /// The camera's registered poses.
    registered: PoseHistory,
    camera: PinholeCamera,
    /// Centre of the virtual objects, world, metres.
    centre: DVec3,
}

/// The camera's predicted pose when its picture is displayed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayPrediction {
    /// The instant of display.
    pub at: MonotonicTime,
    /// The predicted pose.
    pub world_from_camera: RigidTransform,
    /// The reprojection from the registered pose to the predicted pose.
    pub reprojection: Reprojection,
    /// The status of the prediction.
    pub status: DisplayStatus,
}

impl DisplayPredictor {
    /// Creates the predictor of a rig; a live rig passes its measured `latency`.
    pub fn new(
        setup: &RigSetup,
        config: &Config,
        centre: DVec3,
        latency: Option<Arc<DisplayLatency>>,
    ) -> Self {
        let rig = &setup.calibration;
        Self {
            delay_nanos: config.registration.display_delay_nanos,
            latency,
            max_wait_nanos: config.sync.max_wait_nanos,
            registered: PoseHistory::new(HistoryConfig {
                capacity: MAX_PICTURE_POSES,
                ..HistoryConfig::default()
            }),
            camera: rig.scene_camera.camera.clone(),
            centre,
        }
    }

    /// Predicts the camera's pose when `frame` is displayed; `None` if its pose or motion is
    /// unknown.
    pub fn predict(
        &mut self,
        setup: &RigSetup,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
        registered: Option<RigidTransform>,
        status: &RegistrationStatus,
    ) -> Option<DisplayPrediction> {
        let registered = registered?;
        self.registered.push(frame.captured_at, registered);
        let (known, output_at) = self.known_and_output(tracker, frame);
        let at = output_at.offset_nanos(self.delay_nanos);
        let (motion, noise) = self
            .tracked_motion(setup, tracker, frame, (known, at))
            .or_else(|| self.registered_motion(frame.captured_at, registered, at))?;
        let camera_from_eye = shrink_by_noise(motion, noise);
        let rotation = 2.0 * camera_from_eye.rotation.w.abs().min(1.0).acos();
        if rotation > MAX_ROTATION {
            return None;
        }
        let in_camera = registered.inverse().transform_point(self.centre);
        let depth = in_camera.z.clamp(*DEPTH_RANGE.start(), *DEPTH_RANGE.end());
        let or_zero = |sigma: Option<f64>| sigma.unwrap_or(0.0);
        let noise = noise.map(|[metres, radians]| {
            let metres = metres.hypot(1e-3 * or_zero(status.sigma_mm));
            [
                metres,
                radians.hypot(or_zero(status.sigma_deg).to_radians()),
            ]
        });
        let world_from_camera = registered * camera_from_eye;
        let centre_pixel = |pose: RigidTransform| {
            let point = pose.inverse().transform_point(self.centre);
            self.camera.project(point)
        };
        let moved = centre_pixel(registered).zip(centre_pixel(world_from_camera));
        Some(DisplayPrediction {
            at,
            world_from_camera,
            reprojection: Reprojection {
                camera_from_eye,
                depth,
            },
            status: DisplayStatus {
                ahead_ms: 1e3 * at.seconds_since(frame.captured_at),
                moved_px: moved.map_or(0.0, |(a, b)| a.distance(b)),
                sigma_mm: noise.map(|[metres, _]| 1e3 * metres),
                sigma_deg: noise.map(|[_, radians]| radians.to_degrees()),
                sigma_px: noise.map(|[metres, radians]| {
                    let all = (metres / depth).hypot(radians);
                    self.camera.focal.x * all / 3.0_f64.sqrt()
                }),
            },
        })
    }

    /// Returns the instant of the newest tracker reading that may be used for a picture, and the
    /// instant at which the picture is passed to the window.
    fn known_and_output(
        &self,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
    ) -> (MonotonicTime, MonotonicTime) {
        let (history, arrived_at) = (tracker.poses, frame.scene.arrived_at);
        if let Some(latency) = &self.latency {
            let known = history.newest().unwrap_or(frame.captured_at);
            return (known, arrived_at.offset_nanos(latency.nanos()));
        }
        let latency = tracker.latency_nanos;
        let waited = frame.pose.and_then(|_| {
            let next = history.first_since(frame.captured_at)?;
            Some(next.offset_nanos(latency).nanos_since(arrived_at))
        });
        let waited = waited.unwrap_or(0).clamp(0, self.max_wait_nanos);
        let output_at = arrived_at.offset_nanos(waited);
        (output_at.offset_nanos(-latency), output_at)
    }

    /// Returns the camera's motion by the tracker from the exposure until `at`, from the readings
    /// up to `known`, and its standard deviations over all axes, metres and radians.
    fn tracked_motion(
        &self,
        setup: &RigSetup,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
        (known, at): (MonotonicTime, MonotonicTime),
    ) -> Option<(RigidTransform, Option<[f64; 2]>)> {
        let now = setup.world_from_scene_camera(frame.pose.as_ref()?.transmitter_from_sensor);
        let then = tracker.poses.expected(at, known, MAX_PREDICTION_NANOS)?;
        let noise = setup.camera_noise(&then);
        let then = setup.world_from_scene_camera(then.transmitter_from_sensor);
        Some((now.inverse() * then, noise))
    }

    /// Returns the same motion from the registered poses of the pictures.
    fn registered_motion(
        &self,
        captured_at: MonotonicTime,
        registered: RigidTransform,
        at: MonotonicTime,
    ) -> Option<(RigidTransform, Option<[f64; 2]>)> {
        let PoseAt {
            transmitter_from_sensor: then,
            sigma,
            ..
        } = self
            .registered
            .expected(at, captured_at, MAX_PREDICTION_NANOS)?;
        Some((registered.inverse() * then, sigma))
    }
}

/// Shrinks a motion according to its error, so that the tracker's noise does not shake a camera at
/// rest: the estimator of James and Stein (1961) for three numbers scales rotation and translation
/// each by `max(0, 1 − σ²/|x|²)`, with σ along an axis.
fn shrink_by_noise(motion: RigidTransform, noise: Option<[f64; 2]>) -> RigidTransform {
    let Some([metres, radians]) = noise else {
        return motion;
    };
    let factor = |all: f64, length: f64| {
        let axis_variance = all * all / 3.0;
        (1.0 - axis_variance / (length * length).max(1e-18)).max(0.0)
    };
    let rotation = motion.rotation.to_scaled_axis();
    let rotation = rotation * factor(radians, rotation.length());
    let translation = motion.translation;
    RigidTransform::new(
        DQuat::from_scaled_axis(rotation),
        translation * factor(metres, translation.length()),
    )
}

#[cfg(test)]
mod tests;
