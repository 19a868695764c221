//! From a camera's 8-bit codes to linear radiance and back.

/// A camera's tone curve, the same for each channel: codes 0..=255 to linear 0..=1.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    linear_from_code: [f32; 256],
}

impl Response {
    /// IEC 61966-2-1, what most webcams approximate.
    #[must_use]
    pub fn srgb() -> Self {
        Self::from_curve(linear_from_srgb)
    }

    /// The codes are linear already.
    #[must_use]
    pub fn linear() -> Self {
        Self::from_curve(|code| code)
    }

    /// A pure power: `linear = code^gamma`.
    #[must_use]
    pub fn gamma(gamma: f32) -> Self {
        Self::from_curve(|code| code.powf(gamma))
    }

    fn from_curve(linear_from_encoded: impl Fn(f32) -> f32) -> Self {
        Self {
            linear_from_code: std::array::from_fn(|i| linear_from_encoded(i as f32 / 255.0)),
        }
    }

    /// Linear value of every code, ascending.
    #[must_use]
    pub const fn linear_from_code(&self) -> &[f32; 256] {
        &self.linear_from_code
    }
}

/// sRGB decoding (IEC 61966-2-1), 0..=1 to 0..=1.
#[must_use]
pub fn linear_from_srgb(encoded: f32) -> f32 {
    if encoded <= 0.040_45 {
        encoded / 12.92
    } else {
        ((encoded + 0.055) / 1.055).powf(2.4)
    }
}

/// sRGB encoding (IEC 61966-2-1), clamped to 0..=1.
#[must_use]
pub fn srgb_from_linear(linear: f32) -> f32 {
    let x = linear.clamp(0.0, 1.0);
    if x <= 0.003_130_8 {
        x * 12.92
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    }
}
