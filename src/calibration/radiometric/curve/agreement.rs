//! How well exposures of the same light agree if a camera has a given tone curve, and the simplest
//! curve that makes them agree.

use super::gather::{Sample, SeriesGatherer};
use penumbra_camera::Response;
use penumbra_numerics::median;
use std::collections::BTreeMap;

/// Smallest code that is compared: below it, compression and rounding are a tenth of the light.
const DARKEST: f64 = 10.0;
/// Codes of the longer exposure whose samples are compared together.
const BIN: f64 = 16.0;
/// Minimum number of samples in a bin.
const MIN_IN_BIN: usize = 8;
/// Minimum number of bins.
const MIN_BINS: usize = 3;
/// Greatest factor, as a logarithm, by which the ratio of two stated exposures may be wrong: cameras
/// round exposure times, and lamps flicker.
const EXPOSURE_ERROR: f64 = 0.05;
/// Disagreement up to which a simpler curve is preferred to any other, ...
const GOOD: f64 = 0.04;
/// ... and by how much a more complex curve has to be better above it.
const BETTER: f64 = 0.7;
/// Exponents of the pure gammas that are tried.
const GAMMAS: (f64, f64) = (0.7, 3.5);
/// Steps of the search, each of which leaves two thirds of that range.
const STEPS: u32 = 24;

/// By how much exposures disagree about the light of a point if the camera has the curve `response`:
/// root mean square over the brightnesses that two exposures share, relative. A common factor of up to
/// 5 % for each pair of exposures does not count, since exposures are never exact. `None` if too little
/// is well exposed twice.
#[must_use]
pub fn disagreement(gathered: &SeriesGatherer, response: &Response) -> Option<f64> {
    let bins = Bins::new(gathered);
    (bins.count() >= MIN_BINS).then(|| bins.disagreement(response.linear_from_code()))
}

/// The simplest of sRGB, a pure gamma and the curves of `others` under which the exposures agree, and
/// by how much they then [disagree](disagreement). `None` if too little is well exposed twice.
#[must_use]
pub fn simplest(gathered: &SeriesGatherer, others: &[Response]) -> Option<(Response, f64)> {
    let bins = Bins::new(gathered);
    if bins.count() < MIN_BINS {
        return None;
    }
    let of = |response: Response| {
        let apart = bins.disagreement(response.linear_from_code());
        (response, apart)
    };
    let more_complex = [bins.gamma()].into_iter().chain(others.iter().cloned());
    let best = more_complex
        .map(of)
        .fold(of(Response::srgb()), |best, next| {
            let is_better = best.1 > GOOD && next.1 < BETTER * best.1;
            if is_better { next } else { best }
        });
    Some(best)
}

/// Samples of the same pair of exposures and of similar brightness.
struct Bins<'a>(
    BTreeMap<(usize, usize, usize), Vec<&'a Sample>>,
    &'a SeriesGatherer,
);

impl<'a> Bins<'a> {
    fn new(gathered: &'a SeriesGatherer) -> Self {
        let mut bins: BTreeMap<_, Vec<&Sample>> = BTreeMap::new();
        let is_bright = |s: &&Sample| s.shorter.0 >= DARKEST;
        for sample in gathered.samples().iter().filter(is_bright) {
            let (longer, shorter) = sample.pair;
            let bin = (sample.longer.0 / BIN) as usize;
            bins.entry((longer, shorter, bin)).or_default().push(sample);
        }
        bins.retain(|_, samples| samples.len() >= MIN_IN_BIN);
        Self(bins, gathered)
    }

    fn count(&self) -> usize {
        self.0.len()
    }

    /// The medians over a bin reject what moved between two exposures.
    fn disagreement(&self, linear: &[f32; 256]) -> f64 {
        self.apart(linear, EXPOSURE_ERROR)
    }

    /// The same where a common factor with a logarithm of up to `allowed` does not count.
    fn apart(&self, linear: &[f32; 256], allowed: f64) -> f64 {
        let exposures = &self.1.exposures;
        let apart = |s: &&Sample| {
            let light = (at(linear, s.longer.0) / at(linear, s.shorter.0)).ln();
            light - (exposures[s.pair.0] - exposures[s.pair.1])
        };
        let mut pairs: BTreeMap<(usize, usize), Vec<f64>> = BTreeMap::new();
        for (&(longer, shorter, _), samples) in &self.0 {
            let middle = median(samples.iter().map(apart)).unwrap_or(0.0);
            pairs.entry((longer, shorter)).or_default().push(middle);
        }
        let (mut sum, mut n) = (0.0, 0.0);
        for bins in pairs.values() {
            let mean = bins.iter().sum::<f64>() / bins.len() as f64;
            let factor = mean.clamp(-allowed, allowed);
            sum += bins.iter().map(|b| (b - factor).powi(2)).sum::<f64>();
            n += bins.len() as f64;
        }
        f64::sqrt(sum / f64::max(n, 1.0))
    }

    /// The pure gamma under which the exposures agree best as they are stated, by ternary search: the
    /// disagreement falls to one minimum, because every logarithm of light is proportional to the exponent.
    fn gamma(&self) -> Response {
        let (mut low, mut high) = GAMMAS;
        let apart = |gamma: f64| self.apart(Response::gamma(gamma as f32).linear_from_code(), 0.0);
        for _ in 0..STEPS {
            let third = (high - low) / 3.0;
            let (a, b) = (low + third, high - third);
            if apart(a) < apart(b) {
                high = b;
            } else {
                low = a;
            }
        }
        Response::gamma(0.5 * (low + high) as f32)
    }
}

/// The light of a mean code.
fn at(linear: &[f32; 256], code: f64) -> f64 {
    let below = (code.max(0.0) as usize).min(254);
    let (a, b) = (f64::from(linear[below]), f64::from(linear[below + 1]));
    a + (b - a) * (code - below as f64)
}
