//! What a person adjusts: the ball's circle and the ground.

use glam::DVec2;
use penumbra_lighting::Circle;
use penumbra_photo::PhotoOptions;
use serde::{Deserialize, Serialize};

/// Tenths of a pixel and of a degree count.
const DECIMALS: f64 = 10.0;
/// Range of the tilt, as of `--tilt`.
const TILTS: std::ops::RangeInclusive<f64> = -30.0..=90.0;

/// Ball and ground; pixels of the picture with the ball whose exposure is the most similar to that of the one
/// without it.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Adjustment {
    /// X and Y of the ball's centre, and its radius.
    circle: [f64; 3],
    ground: Ground,
}

/// What tells the ground.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Ground {
    /// How far the camera looks down, degrees.
    Tilt(f64),
    /// Corners of a rectangle, in order round it.
    Corners([[f64; 2]; 4]),
    /// The tag that the command line states.
    Tag,
}

/// Why a request is refused.
#[derive(Debug, thiserror::Error)]
pub enum AdjustmentError {
    /// It is not an adjustment.
    #[error("adjustment: {0}")]
    Json(#[from] serde_json::Error),
    /// A number is impossible.
    #[error("{what}: expected {expected}")]
    Value {
        /// The number's name.
        what: &'static str,
        /// What it must be.
        expected: &'static str,
    },
}

impl Adjustment {
    /// An adjustment of a circle and the ground.
    #[must_use]
    pub const fn new(circle: Circle, ground: Ground) -> Self {
        let Circle { centre, radius } = circle;
        Self {
            circle: [centre.x, centre.y, radius],
            ground,
        }
    }

    /// Reads a request, and rounds it.
    ///
    /// # Errors
    /// It is no JSON of an adjustment, or a number is impossible. Whether the circle is in the picture and the
    /// corners are a rectangle's is found later.
    pub fn from_json(bytes: &[u8]) -> Result<Self, AdjustmentError> {
        let read: Self = serde_json::from_slice(bytes)?;
        let refused = |what, expected| Err(AdjustmentError::Value { what, expected });
        if read.circle.iter().any(|x| x.abs() > MAX_PIXELS) || read.circle[2] <= 0.0 {
            return refused("circle", "X, Y and radius in pixels");
        }
        match read.ground {
            Ground::Tilt(degrees) if !TILTS.contains(&degrees) => {
                refused("tilt", "-30 to 90 degrees")
            }
            Ground::Corners(corners) if corners.iter().flatten().any(|x| x.abs() > MAX_PIXELS) => {
                refused("corners", "pixels")
            }
            _ => Ok(read.rounded()),
        }
    }

    /// The same in tenths of pixels and degrees, as [`Self::options`] prints it.
    #[must_use]
    pub fn rounded(self) -> Self {
        let round = |x: f64| (DECIMALS * x).round() / DECIMALS;
        Self {
            circle: self.circle.map(round),
            ground: match self.ground {
                Ground::Tilt(degrees) => Ground::Tilt(round(degrees)),
                Ground::Corners(corners) => Ground::Corners(corners.map(|c| c.map(round))),
                Ground::Tag => Ground::Tag,
            },
        }
    }

    /// The ball's circle.
    #[must_use]
    pub fn circle(&self) -> Circle {
        let [x, y, radius] = self.circle;
        Circle {
            centre: DVec2::new(x, y),
            radius,
        }
    }

    /// Returns the options that state the same on the command line, but for a tag.
    #[must_use]
    pub fn options(&self) -> String {
        let list = |numbers: &[f64]| {
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            numbers.join(",")
        };
        let ball = format!("--ball {}", list(&self.circle));
        match self.ground {
            Ground::Tilt(degrees) => format!("{ball} --tilt {degrees}"),
            Ground::Corners(corners) => format!("{ball} --ground {}", list(corners.as_flattened())),
            Ground::Tag => ball,
        }
    }

    /// Returns `options` with this circle and this ground.
    pub(crate) fn applied_to(&self, options: &PhotoOptions) -> PhotoOptions {
        let (tag, tilt_degrees, rectangle) = match self.ground {
            Ground::Tilt(degrees) => (None, Some(degrees), None),
            Ground::Corners(corners) => (None, None, Some(corners.map(DVec2::from))),
            Ground::Tag => (options.tag, None, None),
        };
        PhotoOptions {
            circle: Some(self.circle()),
            tag,
            tilt_degrees,
            rectangle,
            ..options.clone()
        }
    }

    /// Whether the ground is that of the tag.
    pub(crate) fn is_by_tag(&self) -> bool {
        self.ground == Ground::Tag
    }
}

/// Maximum of a coordinate, pixels.
const MAX_PIXELS: f64 = 1e6;

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn options_are_those_of_the_command_line() {
        let json = br#"{"circle": [220.04, 179.0, 25.66], "ground": {"tilt": 28}}"#;
        let read = Adjustment::from_json(json).unwrap();
        assert_eq!(read.options(), "--ball 220,179,25.7 --tilt 28");
        let json = br#"{"circle": [1, 2, 3], "ground": {"corners": [[1, 2], [3, -4.25], [5, 6], [7, 8]]}}"#;
        let read = Adjustment::from_json(json).unwrap();
        assert_eq!(read.options(), "--ball 1,2,3 --ground 1,2,3,-4.3,5,6,7,8");
        let json = br#"{"circle": [1, 2, 3], "ground": "tag"}"#;
        let read = Adjustment::from_json(json).unwrap();
        assert_eq!(read.options(), "--ball 1,2,3");
        assert!(read.is_by_tag());
    }

    #[test]
    fn impossible_requests_are_refused_in_one_line() {
        for (json, expected) in [
            ("", "EOF"),
            ("[]", "invalid"),
            (r#"{"circle": [1, 2, 3]}"#, "ground"),
            (r#"{"circle": [1, 2], "ground": "tag"}"#, "length 2"),
            (
                r#"{"circle": [1, 2, 3], "ground": "tag", "x": 1}"#,
                "unknown field",
            ),
            (r#"{"circle": [1, 2, 0], "ground": "tag"}"#, "circle"),
            (r#"{"circle": [1e300, 2, 3], "ground": "tag"}"#, "circle"),
            (
                r#"{"circle": [1, 2, 3], "ground": {"tilt": 95}}"#,
                "-30 to 90",
            ),
            (
                r#"{"circle": [1, 2, 3], "ground": {"corners": [[1, 2], [3, 4], [5, 6]]}}"#,
                "length 3",
            ),
            (
                r#"{"circle": [1, 2, 3], "ground": {"corners": [[1, 2], [3, 4], [5, 6], [7, 1e9]]}}"#,
                "corners",
            ),
        ] {
            let message = Adjustment::from_json(json.as_bytes())
                .unwrap_err()
                .to_string();
            assert!(message.contains(expected), "{json}: {message}");
            assert_eq!(message.lines().count(), 1, "{message}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = Adjustment::from_json(&bytes);
        }
    }
}
