//! The interface of a device for the supervisor, common to cameras and trackers.

use penumbra_interface::{
    Camera, CameraReport, DeviceError, Frame, Tracker, TrackerBytes, TrackerReport,
};
use std::time::Duration;

/// An open camera or tracker.
pub trait Device {
    /// The type of a delivery.
    type Item;

    /// Waits up to `timeout` for the next item; `None` if there was none.
    ///
    /// # Errors
    /// The driver's error; [`DeviceError::recovery`] says how the supervisor reacts.
    fn next(&mut self, timeout: Duration) -> Result<Option<Self::Item>, DeviceError>;

    /// Returns the driver's report about the device.
    fn report(&self) -> DeviceReport;

    /// Returns the size of an item in bytes.
    fn bytes(item: &Self::Item) -> usize;
}

/// A driver's report about its device.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum DeviceReport {
    /// The device has not been open yet.
    #[default]
    None,
    /// A camera's.
    Camera(CameraReport),
    /// A tracker's.
    Tracker(TrackerReport),
}

impl Device for Box<dyn Camera> {
    type Item = Frame;

    fn next(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        self.next_frame(timeout)
    }

    fn report(&self) -> DeviceReport {
        DeviceReport::Camera((**self).report())
    }

    fn bytes(frame: &Frame) -> usize {
        frame.data.len()
    }
}

impl Device for Box<dyn Tracker> {
    type Item = TrackerBytes;

    fn next(&mut self, timeout: Duration) -> Result<Option<TrackerBytes>, DeviceError> {
        self.next_bytes(timeout)
    }

    fn report(&self) -> DeviceReport {
        DeviceReport::Tracker((**self).report())
    }

    fn bytes(item: &TrackerBytes) -> usize {
        item.bytes.len()
    }
}
