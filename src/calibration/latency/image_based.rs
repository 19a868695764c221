//! The offset from the pictures' own motion, by the better of two methods.

use super::flow::from_flow;
use super::model::{CameraMotion, ClockOffset, LatencyError};
use super::mounted::{MountedCamera, from_patches};
use super::track::TrackerTrack;

/// Two results are inconsistent if they differ by more than this number of standard deviations.
const GATE: f64 = 4.0;

/// Method by which an offset was found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffsetMethod {
    /// Poses from tags or a board: [`super::from_rotations`].
    Poses,
    /// Image motion as one similarity: [`from_flow`].
    Flow,
    /// Image motion patch by patch with a known mounting: [`from_patches`].
    Patches,
}

impl OffsetMethod {
    /// Returns the name used in files and in the status.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Poses => "poses",
            Self::Flow | Self::Patches => "image motion",
        }
    }

    /// Returns the assumed systematic error (1σ) that the estimated σ does not contain, from motion
    /// blur and shutters, seconds.
    pub(super) const fn systematic(self) -> f64 {
        match self {
            Self::Poses => 5e-4,
            Self::Flow => 2e-3,
            Self::Patches => 1e-3,
        }
    }
}

/// Finds the offset from the pictures' own motion: with the camera's mounting, if it is known and
/// its result is consistent with, and more certain than, the one without.
///
/// # Errors
/// As [`super::from_rotations`].
pub fn from_image_motion(
    track: &TrackerTrack,
    motions: &[CameraMotion],
    mounted: Option<&MountedCamera>,
    range: f64,
) -> Result<(ClockOffset, OffsetMethod), LatencyError> {
    let flow = from_flow(track, motions, range).map(|found| (found, OffsetMethod::Flow));
    let patches = mounted.and_then(|m| from_patches(track, motions, m, range).ok());
    let patches = patches.map(|found| (found, OffsetMethod::Patches));
    let sigma =
        |(found, method): &(ClockOffset, OffsetMethod)| found.sigma.hypot(method.systematic());
    match (flow, patches) {
        (Ok(flow), Some(patches)) => {
            let difference = (flow.0.seconds - patches.0.seconds).abs();
            let consistent = difference < GATE * sigma(&flow).hypot(sigma(&patches));
            let better = consistent && sigma(&patches) < sigma(&flow);
            Ok(if better { patches } else { flow })
        }
        (flow, patches) => flow.or_else(|why| patches.ok_or(why)),
    }
}
