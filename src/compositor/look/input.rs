//! The look of a frame.

use penumbra_camera::{CameraNoise, DepthOfField, ExposureMotion, PointSpread};

/// The camera's properties that virtual objects are given; what is `None` is left out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// Number of the picture: equal numbers give equal grain.
    pub picture: u64,
    /// Noise of the camera.
    pub noise: Option<CameraNoise>,
    /// Spread of a point by lens, demosaicing and sharpening.
    pub spread: Option<PointSpread>,
    /// Depth of field.
    pub depth_of_field: Option<DepthOfField>,
    /// Motion of the camera during the exposure; moving objects are blurred by their own motion
    /// in the same time.
    pub motion: Option<ExposureMotion>,
}

impl Look {
    /// Whether nothing changes.
    #[must_use]
    pub const fn is_none(&self) -> bool {
        self.noise.is_none()
            && self.spread.is_none()
            && self.depth_of_field.is_none()
            && self.motion.is_none()
    }
}
