//! Runs calibration steps on pictures and poses from folders, sessions and live devices.
//!
//! Input: `picture_folder`, `session` and [`live`], which decode with `step_feeder`. Steps:
//! `definition` (what a step is made from), `intrinsics`, `pose_steps`, `radiometric` and `verify`
//! (one definition for each step), and [`steps`] (the table of them). `overlap` and `vignetting`
//! estimate gains and vignetting from a session without a chart. Output: [`files`] and
//! `monitor` with `preview`. [`Calibrator`] runs a step beside the frames of a running rig, on
//! the [`devices`] of that rig. `simulation_recording` writes sessions of simulated rigs.

mod calibrator;
mod definition;
pub mod devices;
pub mod files;
mod intrinsics;
pub mod live;
mod monitor;
mod overlap;
mod picture_folder;
mod pose_steps;
mod preview;
mod radiometric;
mod session;
mod simulation_recording;
mod step_feeder;
pub mod steps;
mod verify;
mod vignetting;

pub use calibrator::{Calibrator, StepMaker};
pub use definition::{MakeStep, ParameterError, Parameters, RigContext, StepDefinition};
pub use monitor::CalibrationMonitor;
pub use overlap::{OverlapEstimates, estimate_from_overlap};
pub use picture_folder::{FolderPicture, for_each_picture, picture_files};
pub use radiometric::radiometric_options;
pub use session::feed_session;
pub use simulation_recording::{SimulationRecordingError, record_simulation, record_webcam};
pub use verify::verify_step;
