//! Interpolation between two values.

/// Smoothstep: the cubic Hermite polynomial from 0 at `low` to 1 at `high` with zero slope at both
/// (as in GLSL and WGSL); clamped outside.
#[must_use]
pub fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
