//! What a camera is asked to do: plain data, the same for every camera driver.

use crate::PixelFormat;
use std::time::Duration;

/// How a camera is to be opened. [`Default`] asks for whatever the first camera offers,
/// locks nothing and reports what other programs change.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSettings {
    /// Which camera: a name under `/dev/v4l/by-id` or `/dev/v4l/by-path`, a path, or
    /// `usb:VID:PID[:SERIAL]` in hexadecimal. Paths like `/dev/video0` are taken, but their
    /// numbers change from one plugging to the next. Empty: the only camera there is.
    pub device: String,
    /// Pixels in a row; 0 leaves the choice to the driver.
    pub width: u32,
    /// Rows; 0 leaves the choice to the driver.
    pub height: u32,
    /// Frames a second; `None` leaves the choice to the camera.
    pub frames_per_second: Option<f64>,
    /// Formats in order of preference; the first that the camera has at the wanted size
    /// and rate is taken. Empty: the driver's own order.
    pub formats: Vec<PixelFormat>,
    /// Buffers that the camera may fill ahead, 2..=32.
    pub buffers: u32,
    /// What is locked: names as `v4l2-ctl --list-ctrls` prints them, values in the device's
    /// units. Old names (`exposure_absolute`) are understood. The order does not matter:
    /// automatic modes are set before the values they own.
    pub controls: Vec<(String, i64)>,
    /// What to do when another program changes a locked control.
    pub on_change: OnChange,
    /// Bracketed exposures; `None`: one exposure for all frames.
    pub bracket: Option<BracketSettings>,
    /// Linear gain for one unit of the control `gain`; `None` where it is not known, and
    /// frames then say gain 1.
    pub gain_per_unit: Option<f64>,
    /// No frame for so long means that the camera hangs.
    pub silence: Duration,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            device: String::new(),
            width: 0,
            height: 0,
            frames_per_second: None,
            formats: Vec::new(),
            buffers: 4,
            controls: Vec::new(),
            on_change: OnChange::default(),
            bracket: None,
            gain_per_unit: None,
            silence: Duration::from_secs(2),
        }
    }
}

/// What to do when another program changes a locked control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum OnChange {
    /// Set it back, and count it.
    Restore,
    /// Leave it, and say so in the report.
    #[default]
    Report,
}

/// A cycle of exposure times, for pictures of more range than the sensor has.
#[derive(Clone, Debug, PartialEq)]
pub struct BracketSettings {
    /// Stops relative to the base exposure (the locked `exposure_time_absolute`, or the one
    /// found in force), in the order of the cycle. One of them must be 0, the base.
    pub stops: Vec<f64>,
    /// Frames for which each exposure is kept, 1..=30. From 2 on, the first frame of each
    /// is dropped, because it may have been exposed while the change came.
    pub hold: u32,
    /// Frames that still come with the old exposure after a new one was set, 0..=10;
    /// `None`: measured from the pictures' brightness when the stream starts.
    pub lag: Option<u32>,
}

impl Default for BracketSettings {
    fn default() -> Self {
        Self {
            stops: vec![0.0, -2.0, -4.0],
            hold: 2,
            lag: None,
        }
    }
}
