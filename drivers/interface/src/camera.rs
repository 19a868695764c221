//! The interface of camera drivers.

use crate::error::DeviceError;
use crate::frame::{Frame, PixelFormat};
use crate::time::MonotonicTime;
use std::sync::Arc;
use std::time::Duration;

/// An open, streaming camera. Dropping it stops the stream and closes the device.
pub trait Camera: Send {
    /// Waits up to `timeout` for a new frame; `None` if none came. If several are waiting, the
    /// newest is returned and the others are counted as superseded.
    ///
    /// # Errors
    /// The device fails; [`DeviceError::recovery`] tells whether to read on, reopen or stop.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError>;

    /// Reports the state and the counters of the camera.
    fn report(&self) -> CameraReport;
}

/// The state of a camera.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraReport {
    /// An identity that stays the same after replugging: the name under `/dev/v4l/by-id`, or
    /// what comes closest to it.
    pub identity: String,
    /// Format of the stream.
    pub mode: Option<StreamMode>,
    /// Where `captured_at` comes from.
    pub stamps: StampSource,
    /// The state of every configured control. Shared between reports until a control changes.
    pub controls: Arc<[ControlReport]>,
    /// Counters since the camera was opened.
    pub counters: CameraCounters,
    /// Notes for the user, one line each: a mode that differs from the configured one, a defect of
    /// the camera that is worked around.
    pub notes: Arc<[String]>,
}

/// Size, format and rate of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamMode {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Encoding of a frame.
    pub format: PixelFormat,
    /// Frames a second that the camera announces; `None` if it announces none.
    pub frames_per_second: Option<f64>,
}

/// Where a camera's `captured_at` comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StampSource {
    /// Start of the exposure, stamped by the driver on the monotonic clock.
    StartOfExposure,
    /// Arrival of the first bytes of a frame, after the exposure of its first row, stamped by
    /// the driver on the monotonic clock.
    FirstBytes,
    /// End of the frame, stamped by the driver on the monotonic clock.
    EndOfFrame,
    /// No stamp: the time at which the driver delivered the bytes.
    #[default]
    Arrival,
    /// A stamp of the wall clock, which may jump.
    WallClock,
    /// A recorded time, shifted to the present.
    Recorded,
}

/// Counters of a camera since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraCounters {
    /// Frames delivered.
    pub frames: u64,
    /// Frames lost before they reached the driver, by gaps in the device's counter.
    pub lost: u64,
    /// Frames that the driver flagged as erroneous, and truncated frames.
    pub damaged: u64,
    /// Good frames dropped in favour of a newer one.
    pub superseded: u64,
    /// Good frames of a bracketing camera that were dropped because they were taken while the
    /// exposure changed, so that their exposure is not certain.
    pub unattributed: u64,
    /// How often a control was found changed by another program.
    pub controls_changed: u64,
}

/// The state of one configured control.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlReport {
    /// Name as in the configuration and in `v4l2-ctl`, such as `exposure_time_absolute`.
    pub name: Arc<str>,
    /// The configured value, in the device's unit.
    pub wanted: i64,
    /// The value that the device reports.
    pub in_force: Option<i64>,
    /// The result of setting it.
    pub standing: ControlStanding,
}

/// The result of setting a control.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ControlStanding {
    /// The device reports the configured value.
    Held,
    /// The device has no such control. That is no error.
    Missing,
    /// The device uses another value, because the configured one is out of range or between
    /// two steps.
    Adjusted,
    /// The device refused the value, for this reason.
    Refused(String),
    /// Another program changed it, and the configuration requests only a report.
    Changed,
}

/// The middle of an exposure, from a stamp and the exposure time in microseconds.
///
/// Applies to rolling and global shutters: a stamp of the start is half an exposure before the
/// middle. A stamp of the end or of the first bytes is half an exposure after it, plus the
/// read-out or a part of it, which is constant and belongs to the camera's calibrated latency.
#[must_use]
pub fn middle_of_exposure(
    stamp: MonotonicTime,
    source: StampSource,
    exposure_micros: Option<f64>,
) -> MonotonicTime {
    let half_nanos = (exposure_micros.unwrap_or(0.0).clamp(0.0, 1e7) * 500.0) as i64;
    match source {
        StampSource::StartOfExposure => stamp.offset_nanos(half_nanos),
        StampSource::FirstBytes | StampSource::EndOfFrame => stamp.offset_nanos(-half_nanos),
        StampSource::Arrival | StampSource::WallClock | StampSource::Recorded => stamp,
    }
}
