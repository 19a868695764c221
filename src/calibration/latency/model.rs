//! Motions of a camera between pictures, the offset of two clocks, and why none was found.

use super::image_motion::Flow;
use glam::DQuat;
use thiserror::Error;

/// Offset of the tracker's clock from the camera's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockOffset {
    /// The tracker's time stamp minus the camera's for the same instant: latency of the tracker
    /// minus latency of the camera, seconds.
    pub seconds: f64,
    /// 1σ, seconds.
    pub sigma: f64,
    /// Correlation of both motions at that offset, 0 to 1.
    pub correlation: f64,
    /// Number of pairs of pictures that were compared.
    pub samples: usize,
}

/// Rotation of a camera between two pictures in which its pose was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraRotation {
    /// Time stamp of the first picture, seconds.
    pub from: f64,
    /// Time stamp of the second picture, seconds.
    pub to: f64,
    /// `first_from_second`, camera frames.
    pub rotation: DQuat,
}

/// Image motion between two pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraMotion {
    /// Time stamp of the first picture, seconds.
    pub from: f64,
    /// Time stamp of the second picture, seconds.
    pub to: f64,
    /// The motion.
    pub flow: Flow,
}

/// Why the offset could not be found. Each message says what to do.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum LatencyError {
    /// Too few pictures within the tracker's record.
    #[error(
        "only {samples} pictures overlap the tracker's readings, {needed} are needed; move the rig for ten seconds"
    )]
    TooShort {
        /// Pictures that overlap.
        samples: usize,
        /// Pictures needed.
        needed: usize,
    },
    /// The two motions do not correlate at any offset.
    #[error(
        "the motions of picture and tracker correlate by {percent:.0} % only; rotate the rig briskly back and forth in front of a static scene, and check that the tracker is mounted on this camera"
    )]
    Uncorrelated {
        /// Largest correlation.
        percent: f64,
    },
    /// The tracker hardly rotated.
    #[error("the rig is at rest; rotate it briskly back and forth")]
    AtRest,
    /// The best offset is at the limit of the search.
    #[error("the clocks differ by more than {seconds:.2} s; check the time stamps")]
    OutOfRange {
        /// Maximum offset that was searched.
        seconds: f64,
    },
    /// Several offsets explain the motion, as it is periodic.
    #[error(
        "the motion is periodic: offsets of {first:.3} s and {second:.3} s fit equally well; move irregularly"
    )]
    Ambiguous {
        /// The best offset, seconds.
        first: f64,
        /// The next best offset, seconds.
        second: f64,
    },
    /// Every offset explains the motion.
    #[error(
        "the motion fits at any offset, as it is slow or oscillates at one frequency; rotate the rig briskly and irregularly"
    )]
    AnyOffset,
    /// The standard deviation is too large.
    #[error(
        "the offset has a standard deviation of {millis:.1} ms; rotate the rig more briskly and for longer"
    )]
    Uncertain {
        /// 1σ, milliseconds.
        millis: f64,
    },
}
