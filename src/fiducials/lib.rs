//! Printed fiducials (AprilTags, ArUco markers): detection in pictures and camera pose estimation.
//!
//! Steps of the detection: `threshold` binarises the picture; `contour` follows the outlines of
//! black areas; `quad` keeps outlines with four straight sides; `edge` refines the sides in linear
//! light to a twentieth of a pixel; `decode` reads the number. [`Detector`] runs them and reuses
//! its buffers. `ippe` and `pose` estimate a pose with its covariance from corners; [`Registrar`]
//! does so from picture to picture, with the tags of a [`TagMap`].
//!
//! Corners are in pixels; (0, 0) is the centre of the top-left pixel. A tag's frame has its origin
//! in the tag's centre, +X to the right and +Y down as the tag is read, +Z into the paper. Corners
//! are in clockwise order as the tag is read, from the top left.

mod codes;
mod contour;
mod decode;
mod detector;
mod dictionary;
mod edge;
mod family;
mod homography;
mod ippe;
mod map;
mod pose;
mod quad;
mod registrar;
mod threshold;

pub use detector::{Detector, TagObservation, read_predicted};
pub use dictionary::{DICTIONARY_ENDINGS, Dictionary, DictionaryError, MAX_DICTIONARY_BYTES};
pub use family::{Family, UnknownFamily};
pub use ippe::{candidate_poses, nearest_pose};
pub use map::{DuplicateTag, Tag, TagMap};
pub use pose::{Match, PoseEstimate, refine};
pub use registrar::{PosePrior, RegisteredPose, Registrar, RegistrationMethod};

#[cfg(any(test, feature = "synthetic"))]
pub mod synthetic;
