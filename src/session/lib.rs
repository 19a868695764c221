//! Sessions: recordings of a rig as MCAP files, which Foxglove, Rerun and the `mcap` packages can
//! open too.
//!
//! A [`SessionWriter`] records frames, tracker bytes and attachments (calibration, virtual objects);
//! a [`Session`] returns them in the order of arrival. [`import`](import::import) converts a folder to
//! a session, [`describe`] summarises one.
//!
//! Modules in the order of the data flow. Writing: `topics` (names of the streams), `messages`,
//! `tracker_message` and `journal` (their contents), `writer`, `views` (what viewers need), `sink` (the file's errors). Reading:
//! `records` (MCAP's records), `container` (chunks and attachments of a file), `loss` (what a damaged
//! part held), `reader`, `events` (messages in the order of arrival), `info` (statistics).
//!
//! | topic | schema | contents |
//! |---|---|---|
//! | `/scene_camera/image`, `/environment_camera/image` | `foxglove.CompressedImage` | JPEG or PNG as received; log time = arrival, time stamp = middle of the exposure |
//! | `…/image_raw` | `foxglove.RawImage` | the same for YUYV, NV12, RGB8, grey |
//! | `…/image_ev-4` | | the exposure that is 4 stops darker than the base one |
//! | `…/exposure` | `penumbra.Exposure` (JSON) | shutter time, gain and the full frame counter, just before its image |
//! | `…/controls` | `penumbra.Controls` (JSON) | the camera's controls, active from the next image on |
//! | `…/calibration` | `foxglove.CameraCalibration` | for viewers; Penumbra reads the attachment `rig.json` |
//! | `/tracker/bytes` | `penumbra.TrackerBytes` | raw bytes as received; the channel metadata `protocol` names their protocol |
//! | `/tracker/pose` | `foxglove.FrameTransform` | poses of a tracker that is not a byte stream |
//! | `/composite/image` | `foxglove.CompressedImage` | composited pictures of a live rig, on request, for viewers; not read back |
//! | `/rig/journal` | `penumbra.Journal` (JSON) | how the live rig processed the streams; such a file is in the order of arrival |
//! | `/tf` | `foxglove.FrameTransform` | the decoded frame tree, for viewers; not read back |

mod container;
mod error;
mod events;
mod info;
mod journal;
mod loss;
mod messages;
mod reader;
mod records;
mod sink;
mod topics;
mod tracker_message;
mod views;
mod writer;

pub mod import;

pub use container::Attachment;
pub use error::SessionError;
pub use events::{Events, SessionEvent};
pub use info::{StreamInfo, describe};
pub use journal::LightRecord;
pub use loss::LostMessages;
pub use reader::Session;
pub use topics::Camera;
pub use views::{Distortion, RigViews, ViewedLens, ViewedRig, sensor_frame};
pub use writer::{SessionWriter, new_file};

#[cfg(test)]
mod tests;
