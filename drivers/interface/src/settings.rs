//! The settings with which a camera is opened: plain data, the same for every driver.

use crate::frame::PixelFormat;
use std::time::Duration;

/// Settings of a camera. The [`Default`] opens the only camera in its default mode and locks no
/// control.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraSettings {
    /// The camera: a name under `/dev/v4l/by-id` or `/dev/v4l/by-path`, a path, or
    /// `usb:VID:PID[:SERIAL]` in hexadecimal. The number in a path like `/dev/video0` depends on
    /// the order of plugging in. Empty: the only camera.
    pub device: String,
    /// Pixels in a row; 0 for the driver's choice.
    pub width: u32,
    /// Rows; 0 for the driver's choice.
    pub height: u32,
    /// Frames a second; `None` for the camera's choice.
    pub frames_per_second: Option<f64>,
    /// Formats in order of preference; the first one that the camera offers at this size and rate
    /// is used. Empty: the driver's own order.
    pub formats: Vec<PixelFormat>,
    /// Number of buffers that the camera can fill in advance, 2..=32.
    pub buffers: u32,
    /// Controls to lock: names as `v4l2-ctl --list-ctrls` prints them, values in the device's
    /// units. Old names (`exposure_absolute`) are accepted. Their order does not matter:
    /// automatic modes are set before the values that they control.
    pub controls: Vec<(String, i64)>,
    /// What to do when another program changes a locked control.
    pub on_change: OnChange,
    /// Bracketed exposures; `None` for one exposure.
    pub bracket: Option<BracketSettings>,
    /// Linear gain for one unit of the control `gain`. `None` if it is not known; frames then
    /// report a gain of 1.
    pub gain_per_unit: Option<f64>,
    /// A camera that delivers no frame for this long counts as silent.
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
    /// Restore the configured value, and count the change.
    Restore,
    /// Leave the new value, and report it.
    #[default]
    Report,
}

/// A cycle of exposure times, for a larger dynamic range than the sensor has.
#[derive(Clone, Debug, PartialEq)]
pub struct BracketSettings {
    /// Stops relative to the base exposure (the locked `exposure_time_absolute`, or the present
    /// one), in the order of the cycle. One of them must be 0, the base.
    pub stops: Vec<f64>,
    /// Number of frames with each exposure, 1..=30. From 2 on, the first frame of each is dropped,
    /// because it may have been taken while the exposure changed.
    pub hold: u32,
    /// Number of frames that still have the old exposure after a new one was set, 0..=10; `None`
    /// to measure it from the brightness of the first frames.
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
