//! What the status says of the scene camera's pose.

use serde::Serialize;

/// What tells where the scene camera is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct RegistrationStatus {
    /// The newest picture's: see [`RegistrationSource`].
    pub source: RegistrationSource,
    /// Markers that its pose was found by, or corrected by.
    pub markers: u32,
    /// Root mean square distance of their corners from where the pose puts them, pixels.
    pub reprojection_px: Option<f64>,
    /// It was found by one marker whose corners allow two poses, and may be the wrong one.
    pub ambiguous: bool,
    /// Seconds since markers last corrected the tracker.
    pub corrected_ago_s: Option<f64>,
    /// By how much they correct it: at the camera, millimetres.
    pub correction_mm: Option<f64>,
    /// And its direction, degrees.
    pub correction_deg: Option<f64>,
    /// Poses by markers that could not be, by what was known, since the start.
    pub rejected: u64,
    /// How far what is drawn still has to slide to where it is known to belong, pixels.
    pub settling_px: Option<f64>,
    /// Standard deviation of the camera's place, over all axes, millimetres.
    pub sigma_mm: Option<f64>,
    /// Of its direction, degrees.
    pub sigma_deg: Option<f64>,
    /// Of the picture of a point amid the virtual objects, along an axis, pixels.
    pub sigma_px: Option<f64>,
    /// Where it will be when its picture is seen, where pictures are shown for that instant.
    pub display: Option<DisplayStatus>,
}

/// Where the camera will be when its picture is seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct DisplayStatus {
    /// From the middle of the exposure until then, milliseconds.
    pub ahead_ms: f64,
    /// How far that moves the picture of a point amid the virtual objects, pixels.
    pub moved_px: f64,
    /// Standard deviation of the place that is expected, over all axes, millimetres; `None`
    /// until enough predictions have come true to tell.
    pub sigma_mm: Option<f64>,
    /// Of its direction, degrees.
    pub sigma_deg: Option<f64>,
    /// Of the picture of a point amid the virtual objects, along an axis, pixels.
    pub sigma_px: Option<f64>,
}

/// What a pose was found by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum RegistrationSource {
    /// The tracker.
    Tracker,
    /// Markers in the scene camera's picture.
    Markers,
    /// The tracker, corrected by markers in this picture or earlier ones.
    Hybrid,
    /// Nothing: no pose is known.
    #[default]
    None,
}

impl RegistrationSource {
    /// As it stands in the status and in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tracker => "tracker",
            Self::Markers => "markers",
            Self::Hybrid => "hybrid",
            Self::None => "none",
        }
    }
}

impl RegistrationStatus {
    /// By the tracker, if it told anything.
    #[must_use]
    pub fn by_tracker(told: bool) -> Self {
        Self {
            source: if told {
                RegistrationSource::Tracker
            } else {
                RegistrationSource::None
            },
            ..Self::default()
        }
    }

    /// By so many markers, with this root mean square distance of their corners (pixels), and
    /// whether it is a guess; or by none.
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

    /// With the pose's standard deviations: metres, radians, pixels.
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
