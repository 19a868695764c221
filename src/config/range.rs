//! Values of the configuration file: optional, and refused outside their range.

use penumbra_strict_toml::Fault;
use std::ops::RangeInclusive;

pub(super) type Result<T> = std::result::Result<T, Fault>;

/// Sets `target` if the file gives a value.
pub(super) fn set<T>(target: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *target = value;
    }
}

/// Returns `value` if it is in `range`.
pub(super) fn within(
    key: &str,
    value: Option<f64>,
    range: RangeInclusive<f64>,
) -> Result<Option<f64>> {
    match value {
        Some(v) if !range.contains(&v) => {
            let (low, high) = range.into_inner();
            Err(Fault::new(
                key,
                format!("expected a number from {low} to {high}, found {v}"),
            ))
        }
        value => Ok(value),
    }
}

/// Returns `value` if it is in `range`.
pub(super) fn whole(
    key: &str,
    value: Option<u32>,
    range: RangeInclusive<u32>,
) -> Result<Option<u32>> {
    match value {
        Some(v) if !range.contains(&v) => {
            let (low, high) = range.into_inner();
            Err(Fault::new(
                key,
                format!("expected a whole number from {low} to {high}, found {v}"),
            ))
        }
        value => Ok(value),
    }
}

/// Returns `value` if it is a power of two from `low` to `high`.
pub(super) fn power_of_two(
    key: &str,
    value: Option<u32>,
    low: u32,
    high: u32,
) -> Result<Option<u32>> {
    match value {
        Some(v) if !(v.is_power_of_two() && (low..=high).contains(&v)) => Err(Fault::new(
            key,
            format!("expected a power of two from {low} to {high}, found {v}"),
        )),
        value => Ok(value),
    }
}

/// Converts milliseconds in `range` to nanoseconds.
pub(super) fn millis(
    key: &str,
    value: Option<f64>,
    range: RangeInclusive<f64>,
) -> Result<Option<i64>> {
    Ok(within(key, value, range)?.map(|ms| (ms * 1e6).round() as i64))
}
