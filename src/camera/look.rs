//! The look of a camera's pictures: its noise, its sharpness, its depth of field and the motion
//! during its exposure. Virtual objects are given the same look.

use glam::DVec3;
use penumbra_interface::RigidTransform;
use penumbra_numerics::rotation_vector;

/// Number of neighbours in each direction whose correlation with a pixel's noise is described.
pub const NOISE_LAGS: usize = 7;

/// Noise of a pixel and its texture. The variance is read + shot × value; linear, full scale 1 (the
/// photon transfer curve, Janesick 2007).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraNoise {
    /// Variance of the read noise by channel.
    pub read: [f64; 3],
    /// Variance of the shot noise per linear value, by channel.
    pub shot: [f64; 3],
    /// Correlation between pixels and channels.
    pub texture: NoiseTexture,
}

/// Correlation of noise between neighbouring pixels and between channels, as it is left by
/// demosaicing, denoising, sharpening and the codec. Red, green and blue have unit variance; they
/// are transformed to luma Y (BT.601) and the differences B − Y and R − Y, which codecs filter
/// differently.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseTexture {
    /// Correlation with the first, second, ... pixel to the right: of Y, B − Y and R − Y.
    pub across: [[f64; NOISE_LAGS]; 3],
    /// The same, downwards.
    pub down: [[f64; NOISE_LAGS]; 3],
    /// Covariance of Y, B − Y and R − Y.
    pub covariance: [[f64; 3]; 3],
}

/// Rows that transform red, green and blue to Y, B − Y and R − Y.
pub const OPPONENT_FROM_RGB: [[f64; 3]; 3] = [
    [0.299, 0.587, 0.114],
    [-0.299, -0.587, 0.886],
    [0.701, -0.587, -0.114],
];

impl NoiseTexture {
    /// Independent noise of every pixel and channel.
    pub const WHITE: Self = Self {
        across: [[0.0; NOISE_LAGS]; 3],
        down: [[0.0; NOISE_LAGS]; 3],
        covariance: white_covariance(),
    };
}

/// The covariance T Tᵀ, T = [`OPPONENT_FROM_RGB`].
const fn white_covariance() -> [[f64; 3]; 3] {
    let t = OPPONENT_FROM_RGB;
    let mut out = [[0.0; 3]; 3];
    let mut i = 0;
    while i < 9 {
        let (row, column) = (i / 3, i % 3);
        out[row][column] =
            t[row][0] * t[column][0] + t[row][1] * t[column][1] + t[row][2] * t[column][2];
        i += 1;
    }
    out
}

/// Sharpness of a camera: the point spread between the light that falls onto its pixels (box filter)
/// and its picture, by the lens, demosaicing and sharpening. Separable and symmetric.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointSpread {
    /// Weights of a pixel, of each neighbour to the left and right, and of each next neighbour:
    /// `w[0] + 2 w[1] + 2 w[2] = 1`. Negative weights sharpen.
    pub across: [f64; 3],
    /// The same, upwards and downwards.
    pub down: [f64; 3],
}

impl PointSpread {
    /// No spread beyond the area of a pixel.
    pub const NONE: Self = Self {
        across: [1.0, 0.0, 0.0],
        down: [1.0, 0.0, 0.0],
    };

    /// Modulation transfer at `frequency` (cycles a pixel) of `weights` and of a pixel's area.
    #[must_use]
    pub fn mtf(weights: &[f64; 3], frequency: f64) -> f64 {
        let w = std::f64::consts::TAU * frequency;
        let spread = weights[0] + 2.0 * weights[1] * w.cos() + 2.0 * weights[2] * (2.0 * w).cos();
        let x = 0.5 * w;
        let area = if x == 0.0 { 1.0 } else { x.sin() / x };
        spread * area
    }

    /// Frequency (cycles a pixel) at which the modulation transfer falls to one half, at most 1.
    #[must_use]
    pub fn mtf50(weights: &[f64; 3]) -> f64 {
        let steps = (1..=1000).map(|i| f64::from(i) * 1e-3);
        let mut below = steps.filter(|f| Self::mtf(weights, *f) < 0.5);
        below.next().unwrap_or(1.0)
    }

    /// Whether every weight is within −1 to 2 and each set of weights adds up to 1.
    #[must_use]
    pub fn is_possible(&self) -> bool {
        [self.across, self.down].iter().all(|w| {
            let sum = w[0] + 2.0 * (w[1] + w[2]);
            (sum - 1.0).abs() < 1e-3 && w.iter().all(|v| (-1.0..=2.0).contains(v))
        })
    }
}

/// Depth of field of a thin lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthOfField {
    /// Diameter of the aperture as seen from the scene (entrance pupil), metres.
    pub aperture: f64,
    /// Distance that is in focus, metres.
    pub focus: f64,
}

impl DepthOfField {
    /// Diameter, pixels, of the circle of confusion of a point at the distance `depth` (metres),
    /// for a focal length of `focal` pixels (Potmesil & Chakravarty 1981, for distances far beyond
    /// the focal length).
    #[must_use]
    pub fn circle(&self, focal: f64, depth: f64) -> f64 {
        focal * self.aperture * (1.0 / depth - 1.0 / self.focus).abs()
    }
}

/// Motion of a camera during the exposure of a row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExposureMotion {
    /// Exposure time, seconds.
    pub seconds: f64,
    /// Rotation vector over the exposure, camera axes, radians.
    pub rotation: DVec3,
    /// Translation over the exposure, camera axes, metres.
    pub translation: DVec3,
}

impl ExposureMotion {
    /// Returns the motion during an exposure of `exposure_seconds` of a camera whose pose
    /// (`world_from_camera`) changes from `before` to `after` within `seconds`. A camera at rest if
    /// the times are invalid.
    #[must_use]
    pub fn between(
        before: &RigidTransform,
        after: &RigidTransform,
        seconds: f64,
        exposure_seconds: f64,
    ) -> Self {
        let share = exposure_seconds / seconds;
        if !(share.is_finite() && seconds > 0.0) {
            return Self::at_rest(exposure_seconds);
        }
        let to_camera = before.rotation.inverse();
        Self {
            seconds: exposure_seconds,
            rotation: rotation_vector(to_camera * after.rotation) * share,
            translation: to_camera * (after.translation - before.translation) * share,
        }
    }

    /// A camera that does not move.
    #[must_use]
    pub fn at_rest(seconds: f64) -> Self {
        Self {
            seconds,
            ..Self::default()
        }
    }

    /// Displacement during the exposure, in camera coordinates, of a static point of the scene.
    #[must_use]
    pub fn displacement(&self, point_in_camera: DVec3) -> DVec3 {
        -(self.translation + self.rotation.cross(point_in_camera))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn transfer_of_a_pixel_is_that_of_its_area() {
        let ideal = PointSpread::NONE.across;
        assert_eq!(PointSpread::mtf(&ideal, 0.0), 1.0);
        let quarter = PointSpread::mtf(&ideal, 0.25);
        assert!((quarter - 0.9003).abs() < 1e-4, "{quarter}");
        // A binomial spread of (1, 2, 1) / 4 has cos² of half the phase.
        let binomial = [0.5, 0.25, 0.0];
        assert!((PointSpread::mtf(&binomial, 0.25) - 0.5 * quarter).abs() < 1e-12);
        assert!((PointSpread::mtf50(&binomial) - 0.24).abs() < 0.005);
    }

    #[test]
    fn circle_of_confusion_vanishes_at_the_focus_and_grows_with_the_aperture() {
        let lens = DepthOfField {
            aperture: 0.01,
            focus: 0.5,
        };
        assert_eq!(lens.circle(700.0, 0.5), 0.0);
        assert!((lens.circle(700.0, 1.0) - 7.0).abs() < 1e-12);
        assert!((lens.circle(700.0, 1e12) - 14.0).abs() < 1e-9);
    }

    #[test]
    fn displacement_is_the_difference_of_the_point_in_both_poses() {
        let pose = |t: f64| {
            RigidTransform::new(
                DQuat::from_scaled_axis(DVec3::new(0.02, 0.1, -0.05) * t),
                DVec3::new(0.05, -0.02, 0.1) * t,
            )
        };
        let motion = ExposureMotion::between(&pose(-0.01), &pose(0.01), 0.02, 0.004);
        let point = DVec3::new(0.2, -0.1, 0.9);
        let seen = |t: f64| {
            pose(t)
                .inverse()
                .transform_point(pose(0.0).transform_point(point))
        };
        let expected = seen(0.002) - seen(-0.002);
        assert!((motion.displacement(point) - expected).length() < 1e-6);
        let rest = ExposureMotion::between(&pose(0.0), &pose(0.0), 0.0, 0.01);
        assert_eq!(rest, ExposureMotion::at_rest(0.01));
    }
}
