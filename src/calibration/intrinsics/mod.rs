//! Intrinsics of a camera from pictures of a board.

pub mod board;
mod bundle;
pub mod coverage;
pub mod detect;
mod estimate;
pub mod gather;
mod homography;
pub mod lens;
mod outliers;
mod pose;
pub mod report;
mod start;
pub mod tags;
pub mod verdict;

pub use board::{Board, BoardError, Correspondence, View};
pub use coverage::{Coverage, Tilt, Uncertainty};
pub use detect::Grey;
pub use estimate::{Estimate, NoEstimate, Options, PointEstimate, ViewEstimate, estimate};
pub use gather::{Gatherer, Judged, Offer, Outcome};
pub use lens::{Lens, LensModel};
pub use pose::board_pose;
pub use verdict::{Finding, Grade, Verdict};

#[cfg(test)]
pub(crate) mod drawn;
