//! Properties of a camera that can be queried without streaming.

use serde::Serialize;

/// The properties of one camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraInfo {
    /// Name for the setting `device`; stays the same after replugging, if possible.
    pub identity: String,
    /// The name that the camera reports.
    pub name: String,
    /// Name of its driver.
    pub driver: String,
    /// Where it is connected, as the driver reports it.
    pub bus: String,
    /// Its present device file. The number depends on the order of plugging in.
    pub node: String,
    /// Its name under `/dev/v4l/by-id`.
    pub by_id: Option<String>,
    /// Its name under `/dev/v4l/by-path`, which identifies the socket rather than the camera.
    pub by_path: Option<String>,
    /// Its USB identity, if it is a USB camera.
    pub usb: Option<UsbIdentity>,
    /// Formats that it can stream.
    pub formats: Vec<CameraFormat>,
    /// Controls that can be set.
    pub controls: Vec<CameraControl>,
    /// Why some of these properties are missing, one line.
    pub trouble: Option<String>,
}

/// The identity that a USB device reports.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct UsbIdentity {
    /// Vendor ID, four hexadecimal digits.
    pub vendor: String,
    /// Product ID, four hexadecimal digits.
    pub product: String,
    /// Serial number, if it has one.
    pub serial: Option<String>,
}

/// One pixel format of a camera.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraFormat {
    /// Its four-character code, such as `MJPG`.
    pub fourcc: String,
    /// The driver's description.
    pub description: String,
    /// Whether Penumbra can decode it.
    pub usable: bool,
    /// Frame sizes.
    pub sizes: Vec<CameraSize>,
}

/// One frame size with its frame rates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CameraSize {
    /// Pixels in a row; the maximum for a range of sizes.
    pub width: u32,
    /// Rows; the maximum for a range of sizes.
    pub height: u32,
    /// Minimum and steps for a range of sizes.
    pub steps: Option<SizeSteps>,
    /// Frames a second, highest first; the limits for a range of rates.
    pub frames_per_second: Vec<f64>,
}

/// Minimum and steps of a range of frame sizes.
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
    /// Name as in the configuration, such as `exposure_time_absolute`.
    pub name: String,
    /// Type of its value: integer, boolean, menu, button, bitmask …
    pub kind: String,
    /// Minimum.
    pub min: i64,
    /// Maximum.
    pub max: i64,
    /// Step between values.
    pub step: i64,
    /// Default value.
    pub default: i64,
    /// Present value; `None` if it cannot be read.
    pub current: Option<i64>,
    /// Values of a menu with their names.
    pub menu: Vec<(i64, String)>,
    /// Reasons that prevent setting it: `inactive` (an automatic mode controls it), `read-only`,
    /// `grabbed` …
    pub flags: Vec<String>,
}
