//! What brings a step of calibration its pictures and poses, and carries it out.
//!
//! `pictures` from a folder, `session` everything that a session
//! holds, [`live`] what devices deliver now. [`Calibrator`] does that beside the frames of a
//! running rig: it makes a step by name ([`steps`]), says how it goes ([`Showcase`]) and puts
//! what was found among the rig's files ([`files`]). `verify` sets up the check of a rig.

mod calibrator;
pub mod devices;
mod fall_off;
pub mod files;
mod kinds;
mod kinds_of_motion;
pub mod live;
mod overlap;
mod pictures;
mod preview;
mod radiometric;
mod rehearse;
mod session;
mod showcase;
mod showing;
pub mod steps;
mod verify;

pub use calibrator::{Calibrator, StepMaker};
pub use overlap::{SeenByBoth, seen_by_both};
pub use pictures::{Looked, pictures_of_folder};
pub use radiometric::radiometric_options;
pub use rehearse::{RehearsalError, rehearse};
pub use session::show_session;
pub use showcase::{Showcase, Written};
pub use verify::verify_step;
