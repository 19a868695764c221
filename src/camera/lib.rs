//! Camera models: pinhole and fisheye projection, tone curves, vignetting, rolling shutter, noise,
//! sharpness, depth of field and motion blur, and views of the environment through a fisheye lens or in a mirrored sphere.
//!
//! Camera frame: OpenCV's optical frame (+X right, +Y down, +Z forward). Pixel (0, 0) is the
//! centre of the top-left pixel. Lengths are metres, angles radians.

mod environment_view;
mod fisheye;
mod lens;
pub mod look;
mod mirror;
mod pinhole;
mod placed_view;
mod response;
mod rolling_shutter;
pub mod vignetting;

pub use environment_view::{EnvironmentView, FisheyeLens, MirrorSphere};
pub use lens::{Lens, LensModel, MAX_PARAMETERS, Projection};
pub use look::{CameraNoise, DepthOfField, ExposureMotion, NoiseTexture, PointSpread};
pub use mirror::{MirroredView, SphereInCamera};
pub use pinhole::PinholeCamera;
pub use placed_view::{Parallax, PlacedView, ViewRay};
pub use response::{Response, ResponseError, linear_from_srgb, srgb_from_linear};
pub use rolling_shutter::RollingShutter;
pub use vignetting::Vignetting;
