//! Printed fiducials (AprilTags, ArUco markers): where they are in a picture, and where that puts the camera.
//!
//! The way of a picture: `threshold` makes it black and white, tile by tile; `contour` walks
//! round what is black; `quad` keeps outlines of four straight sides; `edge` finds these
//! sides again in linear light, to a twentieth of a pixel; `decode` reads the number.
//! [`Detector`] does all this with buffers that it keeps. `ippe` and `pose` make corners into
//! a pose with its covariance; [`Registrar`] does so from picture to picture, with the tags of a
//! [`TagMap`].
//!
//! Corners are pixels, (0, 0) the centre of the top-left one. A tag's own frame has its origin in
//! the middle, +X to the right and +Y down as it is read, +Z into the paper; corners go clockwise
//! as it is read, from the top left.

mod codes;
mod contour;
mod decode;
mod detector;
mod edge;
mod family;
mod homography;
mod ippe;
mod map;
mod pose;
mod quad;
mod registrar;
mod threshold;

pub use detector::{Detector, TagSeen, confirm, grey_of};
pub use family::{Family, UnknownFamily};
pub use ippe::{both_poses, nearest_pose};
pub use map::{Tag, TagMap, TwiceInMap};
pub use pose::{Match, PoseEstimate, refine};
pub use registrar::{Expectation, Registered, Registrar, Registration};

#[cfg(any(test, feature = "synthetic"))]
pub mod synthetic;
