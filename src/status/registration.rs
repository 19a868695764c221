//! Status of the scene camera's pose.

use serde::Serialize;

/// Source and accuracy of the scene camera's pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RegistrationStatus {
    /// Source of the newest pose, see [`RegistrationSource`].
    pub source: RegistrationSource,
    /// Number of markers used for the pose or its correction.
    pub markers: u32,
    /// RMS reprojection error of their corners, pixels.
    pub reprojection_px: Option<f64>,
    /// Whether the pose is one of two possible poses of a single marker that cannot be distinguished.
    pub ambiguous: bool,
    /// Time since markers last corrected the tracker, seconds.
    pub corrected_ago_s: Option<f64>,
    /// Correction of the camera's position, millimetres.
    pub correction_mm: Option<f64>,
    /// Correction of its orientation, degrees.
    pub correction_deg: Option<f64>,
    /// Poses from markers rejected as implausible since the start.
    pub rejected: u64,
    /// Remaining part of a correction that is still being blended in, pixels.
    pub settling_px: Option<f64>,
    /// Standard deviation of the camera's position, over all axes, millimetres.
    pub sigma_mm: Option<f64>,
    /// Standard deviation of the orientation, degrees.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of the image of a point amid the virtual objects, along an axis, pixels.
    pub sigma_px: Option<f64>,
    /// Number of points of real surfaces that steady the tracker's pose; 0 where it is the tracker's alone.
    pub landmarks: u32,
    /// Median distance of their images from where the pose shows them, pixels.
    pub landmarks_px: Option<f64>,
    /// Share of the rim of a mirrored ball that was found in the picture, 0..=1; `None` if the ball
    /// was not searched for, or its place is not in the picture.
    pub sphere_support: Option<f64>,
    /// Distance of that ball from its stated place, millimetres.
    pub sphere_off_mm: Option<f64>,
    /// Prediction to the instant at which the picture is seen; `None` without it.
    pub display: Option<DisplayStatus>,
}

/// Prediction of the camera's pose to the instant at which its picture is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DisplayStatus {
    /// Prediction time from the middle of the exposure, milliseconds.
    pub ahead_ms: f64,
    /// Displacement of the image of a point amid the virtual objects, pixels.
    pub moved_px: f64,
    /// Standard deviation of the predicted position, over all axes, millimetres; `None` until enough
    /// predictions could be verified.
    pub sigma_mm: Option<f64>,
    /// Standard deviation of the orientation, degrees.
    pub sigma_deg: Option<f64>,
    /// Standard deviation of the image of a point amid the virtual objects, along an axis, pixels.
    pub sigma_px: Option<f64>,
}

/// Source of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RegistrationSource {
    /// The tracker.
    Tracker,
    /// Markers in the scene camera's picture.
    Markers,
    /// The tracker, corrected by markers in this picture or earlier ones.
    Hybrid,
    /// The configuration: the camera stands still.
    Fixed,
    /// None: the pose is unknown.
    #[default]
    None,
}

impl RegistrationSource {
    /// Returns the name in status and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tracker => "tracker",
            Self::Markers => "markers",
            Self::Hybrid => "hybrid",
            Self::Fixed => "fixed",
            Self::None => "none",
        }
    }
}

impl RegistrationStatus {
    /// Creates the status of a pose from the tracker, if there is one.
    #[must_use]
    pub fn by_tracker(has_pose: bool) -> Self {
        Self {
            source: if has_pose {
                RegistrationSource::Tracker
            } else {
                RegistrationSource::None
            },
            ..Self::default()
        }
    }

    /// Creates the status of a pose that the configuration states.
    #[must_use]
    pub fn fixed() -> Self {
        Self {
            source: RegistrationSource::Fixed,
            ..Self::default()
        }
    }

    /// Creates the status of a pose from markers: their number, the RMS reprojection error (pixels) and
    /// whether the pose is ambiguous.
    #[must_use]
    pub fn by_markers(found: Option<(usize, f64, bool)>) -> Self {
        found.map_or_else(Self::default, |(markers, rms, ambiguous)| Self {
            source: RegistrationSource::Markers,
            markers: markers as u32,
            reprojection_px: Some(rms),
            ambiguous,
            ..Self::default()
        })
    }

    /// Adds the standard deviations of the pose: metres, radians, pixels.
    #[must_use]
    pub fn with_sigma(self, [metres, radians, pixels]: [f64; 3]) -> Self {
        Self {
            sigma_mm: Some(metres * 1e3),
            sigma_deg: Some(radians.to_degrees()),
            sigma_px: Some(pixels),
            ..self
        }
    }
}
