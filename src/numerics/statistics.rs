//! Robust location and scale of small samples.

/// Returns the median (the upper one of an even number of values); `None` without values. NaN sorts
/// last.
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    let (_, value, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    Some(*value)
}

/// Returns the median of the absolute values; 0 without values.
#[must_use]
pub fn median_absolute(values: impl IntoIterator<Item = f64>) -> f64 {
    median(values.into_iter().map(f64::abs)).unwrap_or(0.0)
}

/// Returns the square root of the mean of the squares; 0 without values.
#[must_use]
pub fn root_mean_square(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    (sum / count.max(1.0)).sqrt()
}

/// Weight of Tukey's biweight, (1 − x²)² for |x| < 1 and 0 beyond (Beaton & Tukey 1974). `x` is the
/// residual divided by the tuning constant times the scale.
#[must_use]
pub fn tukey_weight(x: f64) -> f64 {
    let rest = (1.0 - x * x).max(0.0);
    rest * rest
}
