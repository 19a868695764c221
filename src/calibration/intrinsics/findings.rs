//! Problems of a lens calibration.

use super::estimate::NoEstimate;
use penumbra_fiducials::Family;
use thiserror::Error;

/// A problem of a calibration. Each message names the problem and the remedy.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Finding {
    /// No lens was found.
    #[error(transparent)]
    NoLens(#[from] NoEstimate),
    /// No picture shows the board.
    #[error("none of {pictures} pictures shows the board; check --board, light and focus")]
    BoardNotSeen {
        /// Number of pictures examined.
        pictures: usize,
    },
    /// The board has another number of corners than the given one.
    #[error(
        "the board in the pictures has {columns}×{rows} inner corners, unlike the given board; give its size with --board"
    )]
    OtherBoard {
        /// Detected corners in a row.
        columns: u32,
        /// Detected rows.
        rows: u32,
    },
    /// The tags are of another family.
    #[error(
        "the tags in the pictures are of the family {detected}, not {given}; give the board's dictionary with --board"
    )]
    OtherFamily {
        /// Family of the tags in the pictures.
        detected: Family,
        /// Family of the given board.
        given: Family,
    },
    /// The tags' positions are those of another board.
    #[error(
        "the board in the pictures is not the given one{}; give its columns and rows with --board", columns_text(*columns)
    )]
    OtherLayout {
        /// Number of columns of that board, if determined.
        columns: Option<u32>,
    },
    /// Tags of the board's family whose numbers are not on the board.
    #[error(
        "{pictures} pictures show tags that are not on the given board; does it have more rows, or is another board visible?"
    )]
    ForeignTags {
        /// Number of such pictures.
        pictures: usize,
    },
    /// The lens is that of the rig's other camera.
    #[error(
        "picture size or focal length is that of the {seen} camera in rig.json, not of the {given} camera; are the cameras swapped?"
    )]
    OtherCamera {
        /// The calibrated camera.
        given: &'static str,
        /// The camera with such a lens.
        seen: &'static str,
    },
    /// The pictures have another size than the rig's.
    #[error(
        "rig.json specifies pictures of {width}×{height} for this camera, so the rig cannot use this lens; calibrate in that mode"
    )]
    OtherMode {
        /// The rig's width, pixels.
        width: u32,
        /// The rig's height, pixels.
        height: u32,
    },
    /// The lens model is not the rig's.
    #[error("rig.json specifies another lens model; calibrate with --model {model}")]
    OtherModel {
        /// Value of `--model`.
        model: &'static str,
    },
    /// No corners were seen at a fisheye's rim.
    #[error(
        "corners reach {seen:.0}° from the axis and light {lit:.0}°, the lens is determined to {known:.0}°; hold the board closer, at the rim of the picture"
    )]
    RimNotCovered {
        /// Largest angle of corners, degrees.
        seen: f64,
        /// Largest angle of light, degrees.
        lit: f64,
        /// Angle to which the lens is determined, degrees.
        known: f64,
    },
    /// The pictures are of several cameras or modes.
    #[error("the pictures have several sizes; use pictures of one camera in one mode")]
    SizesDiffer,
    /// Some pictures have another size than the first.
    #[error(
        "{other} of {pictures} pictures are not {width}×{height} like the first and were left out; use pictures of one camera in one mode"
    )]
    SizesMixed {
        /// Number of pictures that were left out.
        other: usize,
        /// Number of all pictures.
        pictures: usize,
        /// Width of the pictures used, pixels.
        width: u32,
        /// Height of the pictures used, pixels.
        height: u32,
    },
    /// The views that contradict the lens fit another one.
    #[error(
        "{others} of {views} views fit another lens (focal length {focal:.0} px) than the rest ({used:.0} px); use pictures of one camera at one zoom and focus"
    )]
    TwoCameras {
        /// Number of views of the other lens.
        others: usize,
        /// Number of all views.
        views: usize,
        /// Focal length of the other lens, pixels.
        focal: f64,
        /// Focal length of the lens that fits most views, pixels.
        used: f64,
    },
    /// Too few views for a reliable result.
    #[error("only {used} views were used; take 15 or more")]
    FewViews {
        /// Number of views used.
        used: usize,
    },
    /// Many views are outliers.
    #[error(
        "{rejected} of {views} views are inconsistent with the others; avoid motion blur, a bent board and pictures of two cameras"
    )]
    RejectedViews {
        /// Number of rejected views.
        rejected: usize,
        /// Number of all views.
        views: usize,
    },
    /// The board was hardly tilted.
    #[error("the board was tilted by at most {degrees:.0}°; tilt it by 20° to 45° to all sides")]
    SmallTilt {
        /// Largest tilt, degrees.
        degrees: f64,
    },
    /// Parts of the picture have no corners.
    #[error("corners cover only {percent:.0} % of the picture; show the board in every part of it")]
    PoorCoverage {
        /// Share of the picture's cells with corners.
        percent: f64,
    },
    /// The reprojection error is large.
    #[error(
        "the reprojection error is {pixels:.2} px; with a flat board at rest and sharp pictures it is 0.1 to 0.4 px"
    )]
    LargeResiduals {
        /// RMS reprojection error.
        pixels: f64,
    },
    /// The focal length is uncertain.
    #[error(
        "the focal length is uncertain by {percent:.2} % (1σ); tilt the board more, and fill the picture with it"
    )]
    FocalUncertain {
        /// Standard deviation, percent.
        percent: f64,
    },
    /// The lens is uncertain in some part of the picture.
    #[error(
        "in some part of the picture the lens is uncertain by {pixels:.1} px (1σ); show the board there"
    )]
    ProjectionUncertain {
        /// Largest standard deviation.
        pixels: f64,
    },
    /// The lens is physically implausible.
    #[error(
        "the lens found is implausible ({reason}); check the board's size, and take more views"
    )]
    Implausible {
        /// Why it is implausible.
        reason: &'static str,
    },
}

/// Returns the part of the message that names the columns detected.
fn columns_text(columns: Option<u32>) -> String {
    columns.map_or_else(String::new, |n| format!(" but has {n} columns"))
}
