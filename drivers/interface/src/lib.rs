//! The interface between Penumbra and its camera and tracker drivers.
//!
//! A driver delivers [`Frame`]s or [`TrackerBytes`], from which [`PoseSample`]s are decoded, with
//! times of one clock ([`MonotonicTime`]). It reports errors as [`DeviceError`], whose
//! [`recovery`](DeviceError::recovery) defines the supervisor's reaction. [`threads`] is the one
//! place that starts threads. Nothing here does I/O or depends on the GPU.

mod camera;
mod device_factory;
mod device_kind;
mod error;
mod frame;
mod info;
mod pose;
mod settings;
pub mod threads;
mod time;
mod tracker;

pub use camera::{
    Camera, CameraCounters, CameraReport, ControlReport, ControlStanding, StampSource, StreamMode,
    middle_of_exposure,
};
pub use device_factory::DeviceFactory;
pub use device_kind::DeviceKind;
pub use error::{DeviceError, Recovery};
pub use frame::{BayerPattern, ControlsInForce, Exposure, Frame, PixelFormat};
pub use info::{CameraControl, CameraFormat, CameraInfo, CameraSize, SizeSteps, UsbIdentity};
pub use pose::{PoseSample, RigidTransform};
pub use settings::{BracketSettings, CameraSettings, OnChange};
pub use time::{Clock, ManualClock, MonotonicTime, SystemClock};
pub use tracker::{Tracker, TrackerBytes, TrackerReport};
