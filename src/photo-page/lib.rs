//! The page on which a person adjusts the ball and the ground of photographs, for `penumbra photo --browser`.
//!
//! [`PhotoPage`] is shared by the program, which waits for [`Request`]s and carries them out, and by the server,
//! whose [`routes`](PhotoPage::routes) belong behind the guard of [`penumbra_status::PageServer`]. Modules in the
//! order of the data flow: `adjustment` (a request), `view` (what it gives), `work` (what the program shall do),
//! `routes`.

mod adjustment;
mod routes;
mod view;
mod work;

pub use adjustment::{Adjustment, AdjustmentError, Ground};
pub use work::{Composite, Request};

use bytes::Bytes;
use glam::DVec2;
use penumbra_lighting::Circle;
use penumbra_photo::{ASSUMED_TILT_DEGREES, PhotoError, PhotoOptions, Photographs};
use penumbra_status::stream::{EncodeError, JpegEncoder};
use serde::Serialize;
use std::sync::Arc;
use work::Work;

/// Maximum side of the picture that is sent to the browser, pixels.
const MAX_SIDE: u32 = 1600;
/// Its JPEG quality.
const QUALITY: u8 = 88;
/// Radius of the circle where no ball was found, as a share of the picture's shorter side.
const PLACEHOLDER: f64 = 0.12;

/// The page's state.
pub struct PhotoPage {
    photographs: Photographs,
    options: PhotoOptions,
    start: Start,
    jpeg: Bytes,
    work: Work,
}

/// What the page shows first.
#[derive(Clone, Debug, Serialize)]
struct Start {
    /// Name of the photograph.
    name: String,
    /// Name of the file that will be written.
    out: String,
    /// Width and height of the photograph, pixels.
    size: [u32; 2],
    /// The sent picture covers so much of it, from its upper left corner.
    shown: [u32; 2],
    adjustment: Adjustment,
    /// Whether a tag was stated.
    has_tag: bool,
    /// Why no ball was found.
    trouble: Option<String>,
}

/// Why the page cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum PhotoPageError {
    /// The stated circle is impossible.
    #[error(transparent)]
    Photo(#[from] PhotoError),
    /// The picture cannot be encoded.
    #[error("the photograph cannot be sent to the browser: {0}")]
    Encode(#[from] EncodeError),
}

impl PhotoPage {
    /// Searches the ball, and prepares the page. `options` are those of the command line, `out` is the name of the
    /// file that will be written.
    ///
    /// # Errors
    /// A stated circle is outside the picture, or that cannot be encoded.
    pub fn new(
        photographs: Photographs,
        options: PhotoOptions,
        out: String,
    ) -> Result<Arc<Self>, PhotoPageError> {
        let (circle, trouble) = first_circle(&photographs, options.circle)?;
        let ground = match (&options.tag, options.rectangle, options.tilt_degrees) {
            (Some(_), ..) => Ground::Tag,
            (None, Some(corners), _) => Ground::Corners(corners.map(Into::into)),
            (None, None, tilt) => Ground::Tilt(tilt.unwrap_or(ASSUMED_TILT_DEGREES)),
        };
        let mut reduced = photographs.first().clone();
        let (width, height) = (reduced.picture.width, reduced.picture.height);
        let factor = reduced.reduce(MAX_SIDE);
        let picture = &reduced.picture;
        let name = reduced.path.file_name().unwrap_or_default();
        let start = Start {
            name: name.to_string_lossy().into_owned(),
            out,
            size: [width, height],
            shown: [picture.width * factor, picture.height * factor],
            adjustment: Adjustment::new(circle, ground).rounded(),
            has_tag: options.tag.is_some(),
            trouble,
        };
        Ok(Arc::new(Self {
            jpeg: JpegEncoder::new(QUALITY)?.encode(picture)?,
            photographs,
            options,
            start,
            work: Work::default(),
        }))
    }

    /// Returns the photographs.
    #[must_use]
    pub const fn photographs(&self) -> &Photographs {
        &self.photographs
    }

    /// Returns the options of the command line with an adjustment in place of what they state.
    #[must_use]
    pub fn options(&self, adjustment: &Adjustment) -> PhotoOptions {
        adjustment.applied_to(&self.options)
    }

    /// Returns the options that state an adjustment on the command line.
    #[must_use]
    pub fn command_line_options(&self, adjustment: &Adjustment) -> String {
        let tag = self.options.tag.filter(|_| adjustment.is_by_tag());
        let tag = tag.map(|tag| format!(" --tag {}:{}m", tag.family, tag.size));
        adjustment.options() + &tag.unwrap_or_default()
    }
}

/// Returns the ball's circle, stated or found, or one to be moved, and why there is no better one.
fn first_circle(
    photographs: &Photographs,
    stated: Option<Circle>,
) -> Result<(Circle, Option<String>), PhotoError> {
    let (reason, circle) = match photographs.ball(stated) {
        Ok((circle, _)) => return Ok((circle, None)),
        Err(PhotoError::NoBall { .. }) => ("No ball was found.", None),
        Err(PhotoError::MattBall { circle, .. }) => (
            "What is round there is shaded like something matt: is it a mirrored ball?",
            Some(circle),
        ),
        Err(PhotoError::BallAtBorder { circle, .. }) => {
            ("The ball reaches the border of the picture.", Some(circle))
        }
        Err(other) => return Err(other),
    };
    let photograph = photographs.first();
    let side = photograph.picture.width.min(photograph.picture.height);
    let centre = photograph.middle();
    let circle = circle.unwrap_or(Circle {
        centre: DVec2::new(centre.x, centre.y),
        radius: PLACEHOLDER * f64::from(side),
    });
    Ok((circle, Some(reason.to_owned())))
}
