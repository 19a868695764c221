//! Options of the radiometric step.

use crate::radiometric::reference::Edition;
use glam::DVec2;
use penumbra_camera::Response;

/// Prior knowledge and options.
#[derive(Clone, Debug)]
pub struct RadiometricOptions {
    /// Tone curves of scene and environment camera, as far as known.
    pub responses: [Response; 2],
    /// Sizes of their pictures, where known.
    pub sizes: [Option<(u32, u32)>; 2],
    /// Principal points of their lenses, where known, pixels.
    pub centres: [Option<DVec2>; 2],
    /// Edition of the chart.
    pub edition: Edition,
    /// Grey card in their pictures: x, y, width, height, pixels.
    pub greys: [Option<[u32; 4]>; 2],
    /// Relative standard deviation of the exposures.
    pub exposure_sigma: f64,
    /// Whether a 3×3 matrix is fitted as well.
    pub matrix: bool,
}

impl Default for RadiometricOptions {
    fn default() -> Self {
        Self {
            responses: [Response::srgb(), Response::srgb()],
            sizes: [None; 2],
            centres: [None; 2],
            edition: Edition::default(),
            greys: [None; 2],
            exposure_sigma: 0.01,
            matrix: true,
        }
    }
}
