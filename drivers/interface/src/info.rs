//! What can be found out about a camera without streaming from it.

use serde::Serialize;

/// One camera, as it was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraInfo {
    /// What to write as `device`: the same after replugging, where there is such a name.
    pub identity: String,
    /// The camera's own name.
    pub name: String,
    /// The driver that serves it.
    pub driver: String,
    /// Where it is plugged in, as the driver says it.
    pub bus: String,
    /// Its device file now; its number changes from one plugging to the next.
    pub node: String,
    /// Its name under `/dev/v4l/by-id`.
    pub by_id: Option<String>,
    /// Its name under `/dev/v4l/by-path`: the socket rather than the camera.
    pub by_path: Option<String>,
    /// Its USB identity, if it is a USB camera.
    pub usb: Option<UsbIdentity>,
    /// What it can stream.
    pub formats: Vec<CameraFormat>,
    /// What can be set.
    pub controls: Vec<CameraControl>,
    /// Why something of the above is missing, in one line.
    pub trouble: Option<String>,
}

/// What a USB device says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct UsbIdentity {
    /// Vendor, four hexadecimal digits.
    pub vendor: String,
    /// Product, four hexadecimal digits.
    pub product: String,
    /// Serial number, if it has one.
    pub serial: Option<String>,
}

/// One way for a camera to spell pictures.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraFormat {
    /// The four letters that name it: `MJPG`.
    pub fourcc: String,
    /// In words, as the driver says it.
    pub description: String,
    /// Whether Penumbra reads it.
    pub usable: bool,
    /// In which sizes.
    pub sizes: Vec<CameraSize>,
}

/// One size, and how often in a second.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraSize {
    /// Pixels in a row; the largest, where any size in steps is offered.
    pub width: u32,
    /// Rows; the largest, where any size in steps is offered.
    pub height: u32,
    /// The smallest size and the steps, where any size in steps is offered.
    pub steps: Option<SizeSteps>,
    /// Frames a second, fastest first; the limits, where any rate between is offered.
    pub frames_per_second: Vec<f64>,
}

/// Sizes in steps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct SizeSteps {
    /// Smallest width.
    pub min_width: u32,
    /// Smallest height.
    pub min_height: u32,
    /// Pixels between one width and the next.
    pub step_width: u32,
    /// Rows between one height and the next.
    pub step_height: u32,
}

/// One control of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraControl {
    /// Name as in settings: `exposure_time_absolute`.
    pub name: String,
    /// Kind of its value: integer, boolean, menu, button, bitmask …
    pub kind: String,
    /// Smallest value.
    pub min: i64,
    /// Largest value.
    pub max: i64,
    /// From one value to the next.
    pub step: i64,
    /// Where the camera starts.
    pub default: i64,
    /// Now; `None` where it cannot be read.
    pub current: Option<i64>,
    /// What the values of a menu mean.
    pub menu: Vec<(i64, String)>,
    /// What stands in the way of setting it: `inactive` (an automatic mode owns it),
    /// `read-only`, `grabbed` …
    pub flags: Vec<String>,
}
