//! Interpolation between two values.

/// Hermite's cubic: 0 up to `low`, 1 from `high` on, with zero slope at both (as in GLSL and WGSL).
#[must_use]
pub fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
