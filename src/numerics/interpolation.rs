//! Interpolation between two values.

use std::ops::{Div, Mul, Sub};

/// Smoothstep: the cubic Hermite polynomial from 0 at `low` to 1 at `high` with zero slope at both
/// (as in GLSL and WGSL); clamped outside. For `f32` and `f64`.
#[must_use]
pub fn smoothstep<T>(low: T, high: T, x: T) -> T
where
    T: Copy + From<f32> + PartialOrd + Sub<Output = T> + Mul<Output = T> + Div<Output = T>,
{
    let [zero, one, two, three] = [0.0, 1.0, 2.0, 3.0].map(T::from);
    let t = (x - low) / (high - low);
    let t = if t < zero {
        zero
    } else if t > one {
        one
    } else {
        t
    };
    t * t * (three - two * t)
}
