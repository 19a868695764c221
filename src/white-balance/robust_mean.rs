//! Robust weighted mean of log ratios of which some are outliers.

use penumbra_numerics::tukey_weight;

/// One measured ln(scene / environment) of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct LogRatio {
    pub value: f64,
    /// Expected variance of `value`.
    pub variance: f64,
    /// Samples of one cluster (neighbours on one surface) have correlated errors.
    pub cluster: u32,
}

/// A robust weighted mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct RobustMean {
    pub mean: f64,
    /// Standard error, by the number of clusters, not of samples.
    pub sd: f64,
    /// Robust standard deviation (1.4826 MAD) of the samples about the mean.
    pub spread: f64,
    /// Samples that were not rejected as outliers.
    pub inliers: usize,
    /// Clusters of the inliers.
    pub clusters: usize,
}

/// Tukey's constant for 95 % efficiency on normal errors.
const TUKEY: f64 = 4.685;

/// Iteratively reweighted mean with Tukey's biweight about the weighted median (Huber
/// 1981; Holland & Welsch 1977); `None` without samples of finite value and variance.
pub(super) fn robust_mean(samples: &[LogRatio]) -> Option<RobustMean> {
    let samples: Vec<LogRatio> = samples
        .iter()
        .copied()
        .filter(|s| s.value.is_finite() && s.variance.is_finite() && s.variance > 0.0)
        .collect();
    let mut mean = weighted_median(samples.iter().map(|s| (s.value, 1.0 / s.variance)))?;
    // Residuals in units of their expected standard deviation; where they are larger than
    // expected, the limit for outliers grows with them.
    let scale = |mean: f64| {
        let residuals = samples.iter().map(|s| normalised(s, mean).abs());
        let median = weighted_median(residuals.map(|r| (r, 1.0))).unwrap_or(0.0);
        (1.4826 * median).max(1.0)
    };
    for _ in 0..30 {
        let scale = scale(mean);
        let (sum, weight) = samples.iter().fold((0.0, 0.0), |(sum, weight), s| {
            let w = tukey_weight(normalised(s, mean) / scale / TUKEY) / s.variance;
            (sum + w * s.value, weight + w)
        });
        if weight <= 0.0 {
            break;
        }
        let next = sum / weight;
        let moved = (next - mean).abs();
        mean = next;
        if moved < 1e-9 {
            break;
        }
    }
    Some(summarise(&samples, mean, scale(mean)))
}

fn normalised(sample: &LogRatio, mean: f64) -> f64 {
    (sample.value - mean) / sample.variance.sqrt()
}

fn summarise(samples: &[LogRatio], mean: f64, scale: f64) -> RobustMean {
    let mut by_cluster = std::collections::BTreeMap::<u32, f64>::new();
    let (mut weights, mut inverse_variances, mut inliers) = (0.0, 0.0, 0);
    for s in samples {
        let w = tukey_weight(normalised(s, mean) / scale / TUKEY) / s.variance;
        if w > 0.0 {
            *by_cluster.entry(s.cluster).or_default() += w * (s.value - mean);
            weights += w;
            inverse_variances += 1.0 / s.variance;
            inliers += 1;
        }
    }
    let deviations = samples.iter().map(|s| ((s.value - mean).abs(), 1.0));
    let clusters = by_cluster.len();
    RobustMean {
        mean,
        sd: standard_error(by_cluster.values(), weights, inverse_variances, clusters),
        spread: 1.4826 * weighted_median(deviations).unwrap_or(0.0),
        inliers,
        clusters,
    }
}

/// Cluster-robust ("sandwich") standard error: from the scatter of the clusters, but not smaller
/// than the expected variances give.
fn standard_error<'a>(
    sums: impl Iterator<Item = &'a f64>,
    weights: f64,
    inverse_variances: f64,
    clusters: usize,
) -> f64 {
    if clusters < 2 || weights <= 0.0 {
        return f64::INFINITY;
    }
    let small_sample = clusters as f64 / (clusters as f64 - 1.0);
    let sandwich = small_sample * sums.map(|sum| sum * sum).sum::<f64>() / (weights * weights);
    sandwich.max(1.0 / inverse_variances).sqrt()
}

/// The value below which half of the weight lies.
fn weighted_median(samples: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let mut sorted: Vec<(f64, f64)> = samples.collect();
    sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * sorted.iter().map(|s| s.1).sum::<f64>();
    let mut below = 0.0;
    sorted
        .iter()
        .find(|s| {
            below += s.1;
            below >= half
        })
        .map(|s| s.0)
}

#[cfg(test)]
mod tests {

    use super::*;
    use proptest::prelude::*;

    fn sample(value: f64, cluster: u32) -> LogRatio {
        LogRatio {
            value,
            variance: 1e-4,
            cluster,
        }
    }

    #[test]
    fn no_finite_sample_has_no_mean() {
        assert_eq!(robust_mean(&[]), None);
        assert_eq!(robust_mean(&[sample(f64::NAN, 0)]), None);
    }

    #[test]
    fn a_third_of_outliers_does_not_move_the_mean() {
        let good = (0..60).map(|i| sample(0.3 + 0.01 * f64::from(i % 7 - 3) / 3.0, i as u32 / 6));
        let bad = (0..30).map(|i| sample(1.5 + 0.1 * f64::from(i), 20 + i as u32));
        let mean = robust_mean(&good.chain(bad).collect::<Vec<_>>()).unwrap();
        assert!((mean.mean - 0.3).abs() < 0.004, "{mean:?}");
        assert_eq!(mean.inliers, 60);
        assert_eq!(mean.clusters, 10);
        assert!(mean.sd < 0.01);
    }

    #[test]
    fn samples_of_one_cluster_count_once() {
        let errors = [-0.03, 0.02, 0.04, -0.01, -0.02];
        let of = |copies: usize| {
            let samples: Vec<LogRatio> = (0..5)
                .flat_map(|c| vec![sample(errors[c], c as u32); copies])
                .collect();
            robust_mean(&samples).unwrap()
        };
        assert!((of(1).mean - of(100).mean).abs() < 1e-9);
        assert!((of(1).sd / of(100).sd - 1.0).abs() < 0.01);
        assert!(
            robust_mean(&vec![sample(0.1, 3); 50])
                .unwrap()
                .sd
                .is_infinite()
        );
    }

    proptest! {
        #[test]
        fn mean_shifts_with_the_data(
            values in prop::collection::vec(-0.5f64..0.5, 3..40),
            shift in -2.0f64..2.0,
        ) {
            let at = |shift: f64| {
                let samples: Vec<LogRatio> = values
                    .iter()
                    .enumerate()
                    .map(|(i, v)| sample(v + shift, i as u32 % 5))
                    .collect();
                robust_mean(&samples).unwrap().mean
            };
            prop_assert!((at(shift) - at(0.0) - shift).abs() < 1e-6);
        }
    }
}
