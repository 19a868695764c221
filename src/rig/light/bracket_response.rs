//! Holds the tone curve that is stated for the environment camera against what its exposures say.
//!
//! Two exposures of one instant show the same light; under a wrong curve they disagree about it, and lamps
//! become too strong or too weak, and their shadows with them. Where the exposures contradict the stated
//! curve, the simplest curve under which they agree takes its place.

use penumbra_calibration::radiometric::curve::{self, SeriesGatherer};
use penumbra_camera::Response;
use penumbra_lighting::Bracket;
use penumbra_picture::Picture;
use std::f64::consts::LN_2;

/// Views of the environment after which the exposures are compared: at once, and again from more pictures.
const COMPARED_AFTER: [u32; 3] = [1, 4, 16];
/// Relative standard deviation of the ratio of stated exposures: cameras round exposure times, and
/// lamps flicker between exposures.
const EXPOSURE_SIGMA: f64 = 0.03;
/// Disagreement of the exposures, relative, from which they contradict a curve.
const CONTRADICTION: f64 = 0.1;
/// A curve takes another one's place if it leaves at most this share of the disagreement.
const BETTER: f64 = 0.6;
/// Range of the local exponent d ln(light) / d ln(code) of plausible cameras, ...
const EXPONENTS: (f64, f64) = (0.5, 6.0);
/// ... over intervals of this many codes, ...
const INTERVAL: usize = 16;
/// ... from this code.
const DARKEST: usize = 16;

/// The exposures of the environment camera, gathered until its curve is known.
#[derive(Debug)]
pub struct BracketResponse {
    stated: Response,
    gathered: SeriesGatherer,
    views: u32,
    disagreement: Option<f64>,
    found: Option<Response>,
}

/// What the exposures say about the stated curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureAgreement {
    /// By how much they disagree about the same light under it: root mean square, relative.
    pub disagreement: f64,
    /// Whether they contradict it, and if so, whether a curve was found that takes its place.
    pub verdict: Verdict,
}

impl ExposureAgreement {
    /// What the user is told: nothing, if the exposures agree.
    pub const fn warning(self) -> Option<&'static str> {
        match self.verdict {
            Verdict::Agree => None,
            Verdict::Replaced => Some(REPLACED),
            Verdict::Unexplained => Some(UNEXPLAINED),
        }
    }
}

const REPLACED: &str = "the environment camera's exposures contradict its tone curve, and light is \
    computed with the curve that they tell; measure it with `penumbra calibrate radiometric`, or correct \
    `response` or the stated exposures";
const UNEXPLAINED: &str = "the environment camera's exposures contradict each other whatever its tone \
    curve, and light is inaccurate; switch off automatic exposure, gain and contrast, or correct the \
    stated exposures";
/// All that [`ExposureAgreement::warning`] may say.
pub const WARNINGS: [&str; 2] = [REPLACED, UNEXPLAINED];

/// Whether exposures contradict a tone curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// They agree.
    Agree,
    /// They contradict it, and a curve that they tell is used in its place.
    Replaced,
    /// They contradict it, and no plausible curve explains them: the exposures are wrong.
    Unexplained,
}

impl BracketResponse {
    /// Nothing is known yet. `stated`: the curve of the calibration or the configuration.
    pub fn new(stated: Response) -> Self {
        Self {
            stated,
            gathered: SeriesGatherer::default(),
            views: 0,
            disagreement: None,
            found: None,
        }
    }

    /// What is known about the stated curve; `None` before two exposures have shown enough.
    pub fn agreement(&self) -> Option<ExposureAgreement> {
        let disagreement = self.disagreement?;
        let verdict = match &self.found {
            Some(_) => Verdict::Replaced,
            None if disagreement > CONTRADICTION => Verdict::Unexplained,
            None => Verdict::Agree,
        };
        Some(ExposureAgreement {
            disagreement,
            verdict,
        })
    }

    /// Gathers the exposures of an instant. Returns whether the curve in force has changed.
    pub fn look(&mut self, brackets: &[Bracket<'_>]) -> bool {
        let last = COMPARED_AFTER[COMPARED_AFTER.len() - 1];
        if brackets.len() < 2 || self.views >= last {
            return false;
        }
        let series: Vec<(&Picture, f64)> = brackets
            .iter()
            .map(|bracket| (bracket.picture, bracket.ev * LN_2))
            .collect();
        self.gathered.add(&series);
        self.views += 1;
        let has_changed = COMPARED_AFTER.contains(&self.views) && self.compare();
        if self.views == last {
            self.gathered = SeriesGatherer::default();
        }
        has_changed
    }

    fn compare(&mut self) -> bool {
        let gathered = &self.gathered;
        self.disagreement = curve::disagreement(gathered, &self.stated);
        let Some(stated) = self.disagreement.filter(|apart| *apart > CONTRADICTION) else {
            return self.found.take().is_some();
        };
        let in_force = curve::disagreement(gathered, self.response()).unwrap_or(stated);
        // Pictures that no smooth curve explains may still be explained by a power.
        let free = curve::fit(gathered, EXPOSURE_SIGMA).map(|curve| curve.response);
        let free: Vec<Response> = free.into_iter().filter(is_plausible).collect();
        let better = curve::simplest(gathered, &free);
        if let Some((response, _)) = better.filter(|(_, apart)| *apart < BETTER * in_force) {
            self.found = Some(response);
            return true;
        }
        false
    }

    /// The curve in force.
    pub fn response(&self) -> &Response {
        self.found.as_ref().unwrap_or(&self.stated)
    }
}

/// Whether a camera may have such a curve: between distant exposures, a curve with flat parts can explain
/// the pictures as well as the true one.
fn is_plausible(response: &Response) -> bool {
    let linear = response.linear_from_code();
    let exponent = |code: usize| {
        let ratio = |of: &dyn Fn(usize) -> f64| (of(code + INTERVAL) / of(code)).ln();
        ratio(&|z| f64::from(linear[z])) / ratio(&|z| z as f64)
    };
    let range = EXPONENTS.0..=EXPONENTS.1;
    (DARKEST..=255 - INTERVAL).all(|code| range.contains(&exponent(code)))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Exposures of a smooth scene, of which a camera with `response` has seen everything.
    fn exposures(response: &Response, evs: [f64; 3], seed: u32) -> Vec<Picture> {
        let (width, height) = (160, 160);
        let shot = |ev: f64| {
            let rgba = (0..width * height).flat_map(|i| {
                let (x, y) = ((i % width) / 10, (i / width) / 10);
                let light = |c: u32| {
                    let k = (x * 31 + y * 17 + c * 7 + seed * 5) % 97;
                    0.004 * 1.085f32.powi(k as i32) * ev.exp2() as f32
                };
                let code = |c| response.code_from_linear(light(c));
                [code(0), code(1), code(2), 255]
            });
            Picture {
                width,
                height,
                rgba: rgba.collect(),
            }
        };
        evs.map(shot).to_vec()
    }

    /// Contrast in the middle, a soft shoulder.
    fn film() -> Response {
        let curve = |z: f32| z.powi(2) * (0.55 + 0.45 * z.powi(6));
        let table: Vec<f32> = (0..=255u8).map(|z| curve(f32::from(z) / 255.0)).collect();
        Response::from_table(&table).unwrap()
    }

    fn after(seen: &Response, stated: Response, evs: [f64; 3]) -> BracketResponse {
        let mut found = BracketResponse::new(stated);
        for seed in 0..10 {
            let pictures = exposures(seen, evs, seed);
            let brackets = pictures.iter().zip(evs);
            let brackets: Vec<Bracket<'_>> = brackets
                .map(|(picture, ev)| Bracket { picture, ev })
                .collect();
            found.look(&brackets);
        }
        found
    }

    #[test]
    fn a_curve_that_brackets_contradict_is_replaced_by_theirs() {
        // A curve is not searched further once the exposures agree to some percent.
        for (seen, tolerance) in [
            (Response::gamma(1.6), 0.06),
            (Response::gamma(2.6), 0.06),
            (Response::srgb(), 0.06),
            (film(), 0.12),
        ] {
            let found = after(&seen, Response::linear(), [0.0, -2.0, -4.0]);
            let agreement = found.agreement().unwrap();
            assert!(agreement.disagreement > 0.2 && agreement.verdict == Verdict::Replaced);
            let ratio = |z: usize| {
                let (a, b) = (found.response().linear_from_code(), seen.linear_from_code());
                (a[z] / a[128]) / (b[z] / b[128])
            };
            for z in [30, 60, 200, 240] {
                assert!((ratio(z) - 1.0).abs() < tolerance, "{z}: {}", ratio(z));
            }
        }
    }

    #[test]
    fn a_curve_that_brackets_confirm_stays() {
        for stated in [Response::srgb(), Response::gamma(2.0)] {
            for evs in [[0.0, -2.0, -4.0], [0.0, -4.0, -8.0], [0.0, -1.0, -1.0]] {
                let found = after(&stated, stated.clone(), evs);
                let agreement = found.agreement();
                let apart = agreement.map_or(0.0, |agreement| agreement.disagreement);
                assert!(apart < 0.04, "{evs:?}: {apart}");
                assert_eq!(found.response(), &stated);
            }
        }
    }

    #[test]
    fn exposures_that_no_curve_explains_are_reported_and_change_nothing() {
        // The camera has changed its second exposure by itself: the third is darker by half a stop only.
        let (stated, real) = ([0.0, -2.0, -4.0], [0.0, -3.5, -4.0]);
        let mut found = BracketResponse::new(Response::srgb());
        for seed in 0..4 {
            let pictures = exposures(&Response::srgb(), real, seed);
            let brackets: Vec<Bracket<'_>> = (pictures.iter().zip(stated))
                .map(|(picture, ev)| Bracket { picture, ev })
                .collect();
            assert!(!found.look(&brackets));
        }
        let agreement = found.agreement().unwrap();
        assert_eq!(agreement.verdict, Verdict::Unexplained);
        assert!(agreement.warning().is_some());
        assert_eq!(found.response(), &Response::srgb());
    }

    #[test]
    fn exposures_that_show_nothing_tell_nothing() {
        let black = Picture {
            width: 64,
            height: 64,
            rgba: vec![0; 4 * 64 * 64],
        };
        let one = [Bracket {
            picture: &black,
            ev: 0.0,
        }];
        let mut found = BracketResponse::new(Response::srgb());
        assert!(!found.look(&one));
        let both = [0.0, -4.0].map(|ev| Bracket {
            picture: &black,
            ev,
        });
        for _ in 0..12 {
            assert!(!found.look(&both));
        }
    }
}
