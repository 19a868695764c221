//! Where the camera will be when its picture is seen.
//!
//! The tracker's motion is drawn on to that instant and put upon the pose that the picture
//! was registered by, so that what markers corrected stays corrected. Without a tracker the
//! poses of the pictures before are drawn on. How far predictions as long were off lately is
//! the error that is told.

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

/// Nothing is predicted further than this beyond the newest reading, nanoseconds.
const LONGEST_NANOS: i64 = 250_000_000;
/// Poses of pictures that are kept: a few seconds.
const KEPT: usize = 128;
/// A way, radians, that no head turns between a picture and its display: a fault.
const WIDEST_TURN: f64 = 0.4;
/// How near and far, metres, the picture may hang.
const DEPTHS: std::ops::RangeInclusive<f64> = 0.1..=20.0;

/// How long pictures took lately from their arrival until they were handed to the window,
/// nanoseconds.
#[derive(Debug, Default)]
pub(super) struct DisplayLatency(AtomicI64);

impl DisplayLatency {
    /// One more picture: a new figure counts an eighth.
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

/// Looks ahead to the instant at which a picture is seen.
pub(super) struct Display {
    /// From being handed over until that.
    delay_nanos: i64,
    /// From arrival to being handed over. Pictures of a recording need no time but that for
    /// which a live rig would have waited for the tracker, so that they come out alike wherever
    /// it is played.
    handing: Option<Arc<DisplayLatency>>,
    /// A live rig waits for the tracker no longer.
    max_wait_nanos: i64,
    /// The camera's poses as its pictures were registered.
    seen: PoseHistory,
    camera: PinholeCamera,
    /// What the virtual objects stand about, world, metres.
    middle: DVec3,
}

/// Where the camera is expected when its picture is seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shown {
    /// When that is.
    pub at: MonotonicTime,
    /// The pose.
    pub world_from_camera: RigidTransform,
    /// From the pose that the picture was registered by.
    pub reprojection: Reprojection,
    /// For the status.
    pub status: DisplayStatus,
}

impl Display {
    /// Of a rig; `handing` where it is live.
    pub fn new(
        setup: &RigSetup,
        config: &Config,
        middle: DVec3,
        handing: Option<Arc<DisplayLatency>>,
    ) -> Self {
        let rig = &setup.calibration;
        Self {
            delay_nanos: config.registration.display_delay_nanos,
            handing,
            max_wait_nanos: config.sync.max_wait_nanos,
            seen: PoseHistory::new(HistoryConfig {
                capacity: KEPT,
                ..HistoryConfig::default()
            }),
            camera: rig.scene_camera.camera.clone(),
            middle,
        }
    }

    /// Where the camera will be; `None` where its pose is unknown or its motion is.
    pub fn predict(
        &mut self,
        setup: &RigSetup,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
        registered: Option<RigidTransform>,
        status: &RegistrationStatus,
    ) -> Option<Shown> {
        let registered = registered?;
        self.seen.push(frame.captured_at, registered);
        let (known, handed_at) = self.knowledge(tracker, frame);
        let at = handed_at.offset_nanos(self.delay_nanos);
        let (motion, noise) = self
            .tracked(setup, tracker, frame, (known, at))
            .or_else(|| self.drawn_on(frame.captured_at, registered, at))?;
        let camera_from_eye = believed(motion, noise);
        let turn = 2.0 * camera_from_eye.rotation.w.abs().min(1.0).acos();
        if turn > WIDEST_TURN {
            return None;
        }
        let in_camera = registered.inverse().transform_point(self.middle);
        let depth = in_camera.z.clamp(*DEPTHS.start(), *DEPTHS.end());
        let told = |sigma: Option<f64>| sigma.unwrap_or(0.0);
        let noise = noise.map(|[metres, radians]| {
            let metres = metres.hypot(1e-3 * told(status.sigma_mm));
            [metres, radians.hypot(told(status.sigma_deg).to_radians())]
        });
        let world_from_camera = registered * camera_from_eye;
        let middle = |pose: RigidTransform| {
            let point = pose.inverse().transform_point(self.middle);
            self.camera.project(point)
        };
        let moved = middle(registered).zip(middle(world_from_camera));
        Some(Shown {
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

    /// The tracker's newest reading that counts for a picture, and when the picture is handed
    /// over.
    fn knowledge(
        &self,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
    ) -> (MonotonicTime, MonotonicTime) {
        let (history, arrived_at) = (tracker.poses, frame.scene.arrived_at);
        if let Some(handing) = &self.handing {
            let known = history.newest().unwrap_or(frame.captured_at);
            return (known, arrived_at.offset_nanos(handing.nanos()));
        }
        let latency = tracker.latency_nanos;
        let waited = frame.pose.and_then(|_| {
            let next = history.first_since(frame.captured_at)?;
            Some(next.offset_nanos(latency).nanos_since(arrived_at))
        });
        let waited = waited.unwrap_or(0).clamp(0, self.max_wait_nanos);
        let handed_at = arrived_at.offset_nanos(waited);
        (handed_at.offset_nanos(-latency), handed_at)
    }

    /// The tracker's motion from the exposure until an instant, as the camera makes it, by the
    /// readings up to `known`, and its error: metres and radians over all axes.
    fn tracked(
        &self,
        setup: &RigSetup,
        tracker: TrackerHistory<'_>,
        frame: &RigFrame,
        (known, at): (MonotonicTime, MonotonicTime),
    ) -> Option<(RigidTransform, Option<[f64; 2]>)> {
        let now = setup.camera_of(frame.pose.as_ref()?.transmitter_from_sensor);
        let then = tracker.poses.expected(at, known, LONGEST_NANOS)?;
        let noise = setup.camera_noise(&then);
        let then = setup.camera_of(then.transmitter_from_sensor);
        Some((now.inverse() * then, noise))
    }

    /// The same by the pictures' own poses.
    fn drawn_on(
        &self,
        captured_at: MonotonicTime,
        registered: RigidTransform,
        at: MonotonicTime,
    ) -> Option<(RigidTransform, Option<[f64; 2]>)> {
        let PoseAt {
            transmitter_from_sensor: then,
            sigma,
            ..
        } = self.seen.expected(at, captured_at, LONGEST_NANOS)?;
        Some((registered.inverse() * then, sigma))
    }
}

/// As much of a motion as stands out of its error: James and Stein's estimate (1961) of three
/// numbers, `1 − σ²/|x|²` of them, for the turn and for the way. So a camera that rests is not
/// shaken by its tracker's noise.
fn believed(motion: RigidTransform, noise: Option<[f64; 2]>) -> RigidTransform {
    let Some([metres, radians]) = noise else {
        return motion;
    };
    let share = |all: f64, length: f64| {
        let along_an_axis = all * all / 3.0;
        (1.0 - along_an_axis / (length * length).max(1e-18)).max(0.0)
    };
    let turned = motion.rotation.to_scaled_axis();
    let turned = turned * share(radians, turned.length());
    let moved = motion.translation;
    RigidTransform::new(
        DQuat::from_scaled_axis(turned),
        moved * share(metres, moved.length()),
    )
}

#[cfg(test)]
mod tests;
