//! What every camera driver does.

use crate::{DeviceError, Frame, MonotonicTime, PixelFormat};
use std::sync::Arc;
use std::time::Duration;

/// A camera that is open and streams. Dropping it stops the stream and closes the device.
pub trait Camera: Send {
    /// Waits up to `timeout` for a picture that has not been handed over yet; `None` if
    /// none came. Of several that wait, the newest is handed over and the others are
    /// counted as superseded.
    ///
    /// # Errors
    /// [`DeviceError::recovery`] says whether to read on, to reopen or to give up.
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError>;

    /// What is known of the camera and of what it has done.
    fn report(&self) -> CameraReport;
}

/// A camera's own account of itself.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CameraReport {
    /// Who it is, the same after replugging: the name under `/dev/v4l/by-id`, or what comes
    /// nearest to it.
    pub identity: String,
    /// What is being streamed.
    pub mode: Option<StreamMode>,
    /// Where `captured_at` comes from.
    pub stamps: StampSource,
    /// Every control that the configuration names, and what became of it. Shared: it
    /// changes only when a control does.
    pub controls: Arc<[ControlReport]>,
    /// What happened so far.
    pub counters: CameraCounters,
    /// What its user should know, a line each: a mode that is not quite the one asked for,
    /// a habit of the camera that was worked around.
    pub notes: Arc<[String]>,
}

/// Size, format and rate of a stream.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StreamMode {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// How the bytes spell the picture.
    pub format: PixelFormat,
    /// Frames a second that the camera promises; `None` if it does not say.
    pub frames_per_second: Option<f64>,
}

/// Where a camera's `captured_at` comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StampSource {
    /// The driver stamps the start of the exposure on the monotonic clock.
    StartOfExposure,
    /// The driver stamps the arrival of a frame's first bytes on the monotonic clock: the
    /// exposure of the first row is over by then.
    FirstBytes,
    /// The driver stamps the end of the frame on the monotonic clock.
    EndOfFrame,
    /// Nobody stamps: the time at which the bytes reached us.
    #[default]
    Arrival,
    /// Stamped on the wall clock, which may jump.
    WallClock,
    /// Recorded earlier, shifted to now.
    Recorded,
}

/// What a camera has done since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CameraCounters {
    /// Pictures handed over.
    pub frames: u64,
    /// Pictures that the camera's counter says were lost on the way.
    pub lost: u64,
    /// Pictures that the driver flagged as erroneous, or that are cut short.
    pub damaged: u64,
    /// Good pictures passed over for a newer one.
    pub superseded: u64,
    /// Good pictures of a bracketing camera that were dropped, because the exposure changed
    /// about then, and which one they have is not certain.
    pub unattributed: u64,
    /// Times that a control was found changed by somebody else.
    pub controls_changed: u64,
}

/// What became of one control that the configuration names.
#[derive(Clone, Debug, PartialEq)]
pub struct ControlReport {
    /// Name as in the configuration and in `v4l2-ctl`: `exposure_time_absolute`.
    pub name: Arc<str>,
    /// The value asked for, in the device's unit.
    pub wanted: i64,
    /// The value that the device reports.
    pub in_force: Option<i64>,
    /// How the two compare.
    pub standing: ControlStanding,
}

/// How a control stands to what was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ControlStanding {
    /// The device reports the value asked for.
    Held,
    /// The device has no such control, which is normal.
    Missing,
    /// The device took another value: out of range, or in steps.
    Adjusted,
    /// The device refused it, with its reason.
    Refused(String),
    /// Another program changed it, and the configuration says to leave it.
    Changed,
}

/// The controls in force while a frame was exposed, by name; see [`Frame::controls`].
pub type ControlsInForce = Arc<[(Arc<str>, i64)]>;

/// Middle of an exposure from a stamp at its start or at the frame's end.
///
/// A rolling or global shutter alike: the stamp of the start lies half an exposure before
/// the middle; the stamp of the end, or of the first bytes, lies half an exposure and the
/// read-out or a part of it after it. Read-out is a constant of the camera and part of its calibrated latency.
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
