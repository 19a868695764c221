//! Intrinsics of a camera from pictures of a calibration board.
//!
//! In the order of data flow: `detect` and `tag_finder` find corners and tags, `tags` and `layout`
//! assign them to the points of a `board`, `view_collector` selects views, `initial_estimate`,
//! `bundle` and `outliers` estimate the lens (`estimate`), `coverage`, `rim`, `mixture`, `evidence`
//! and `consistency_checks` assess it (`findings`, `assessment`), `sharpness` measures the spread of a
//! point on the board's edges, `step` and `report` present it.

pub mod assessment;
pub mod board;
mod bundle;
pub mod coverage;
pub mod detect;
mod estimate;
mod evidence;
mod findings;
pub(crate) mod homography;
mod initial_estimate;
pub mod layout;
mod mixture;
mod outliers;
mod pose;
pub mod report;
pub mod rim;
pub mod sharpness;
pub mod step;
pub mod tag_finder;
pub mod tags;
pub mod view_collector;

pub use crate::intrinsics::consistency_checks::KnownLenses;
pub use assessment::Assessment;
pub use board::{Board, BoardError, Correspondence, View};
pub use coverage::{Coverage, Tilt, Uncertainty};
pub use detect::Grey;
pub use estimate::{Estimate, NoEstimate, Options, PointEstimate, ViewEstimate, estimate};
pub use findings::Finding;
pub use penumbra_camera::{Lens, LensModel};
pub use penumbra_rig_model::Grade;
pub use pose::board_pose;
pub use rim::{Light, Rim};
pub use step::IntrinsicsStep;
pub use view_collector::{AssessedLens, Outcome, PictureResult, ViewCollector};

pub mod consistency_checks;
#[cfg(test)]
pub(crate) mod synthetic;
