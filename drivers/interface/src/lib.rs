//! What every camera and tracker driver of Penumbra speaks.
//!
//! A driver turns bytes into [`Frame`]s or [`PoseSample`]s on one clock
//! ([`MonotonicTime`]) and reports trouble as a [`DeviceError`], whose
//! [`recovery`](DeviceError::recovery) tells the supervisor what to do. Nothing here
//! does I/O, and nothing here knows of the GPU.

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
    Camera, CameraCounters, CameraReport, ControlReport, ControlStanding, ControlsInForce,
    StampSource, StreamMode, middle_of_exposure,
};
pub use device_factory::DeviceFactory;
pub use device_kind::DeviceKind;
pub use error::{DeviceError, Recovery};
pub use frame::{BayerPattern, Exposure, Frame, PixelFormat};
pub use info::{CameraControl, CameraFormat, CameraInfo, CameraSize, SizeSteps, UsbIdentity};
pub use pose::{PoseSample, RigidTransform};
pub use settings::{BracketSettings, CameraSettings, OnChange};
pub use time::{Clock, MonotonicTime, SystemClock};
pub use tracker::{Tracker, TrackerBytes, TrackerReport};
