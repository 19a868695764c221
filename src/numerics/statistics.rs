//! Location and spread of a handful of numbers.

/// The middle value; `None` of nothing. Values that are no numbers sort last.
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

/// The middle of the magnitudes; 0 of nothing.
#[must_use]
pub fn median_absolute(values: impl IntoIterator<Item = f64>) -> f64 {
    median(values.into_iter().map(f64::abs)).unwrap_or(0.0)
}

/// √(mean of squares); 0 of nothing.
#[must_use]
pub fn root_mean_square(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0_f64);
    for value in values {
        sum += value * value;
        count += 1.0;
    }
    (sum / count.max(1.0)).sqrt()
}

/// Tukey's biweight (1 − x²)²: 1 at 0, 0 from ±1 on.
#[must_use]
pub fn tukey_weight(x: f64) -> f64 {
    let rest = (1.0 - x * x).max(0.0);
    rest * rest
}
