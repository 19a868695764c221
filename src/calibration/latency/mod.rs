//! The clock offset between tracker and camera, from the motion that both measure.
//!
//! The rotation of the camera between two pictures equals the rotation that the tracker measured
//! between the same two instants, which the tracker's clock stamps later by the offset.
//! [`from_rotations`] compares rotations where the pictures have poses (markers, a board). Where
//! they have none, their optical flow ([`ImageMotion`]) is compared: patch by patch with the
//! camera's motion if its mounting is known ([`from_patches`]), else the flow as one similarity with
//! all of the tracker's motion ([`from_flow`]); [`from_image_motion`] takes the better of the two.
//! [`offset_monitor`] tracks a drifting offset by estimating it again from the last seconds.
//!
//! In the order of data flow: `jumps` removes faulty readings, `track` interpolates the tracker's
//! pose, `image_motion` measures the flow; `rotations`, `flow` and `mounted` provide the residuals
//! at an offset, `selection` the pairs of pictures to compare, `scan` the minimum; `image_based`
//! chooses between the methods.

mod flow;
mod image_based;
mod image_motion;
mod jumps;
mod model;
mod mounted;
pub mod offset_monitor;
mod rotations;
mod scan;
mod selection;
mod track;

pub use flow::from_flow;
pub use image_based::{OffsetMethod, from_image_motion};
pub use image_motion::{Flow, ImageMotion, MAX_PATCHES, Patch};
pub(crate) use jumps::without_jumps;
pub use model::{CameraMotion, CameraRotation, ClockOffset, LatencyError};
pub use mounted::{MountedCamera, from_patches};
pub use rotations::from_rotations;
pub use track::TrackerTrack;

#[cfg(test)]
mod tests;
