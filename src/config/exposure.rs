//! `[exposure]`: exposure of the output (DiVerdi and Höllerer 2004, section 4.3).

use super::range::{Result, set, within};
pub use penumbra_scene::Highlights;
use serde::Deserialize;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// How the exposure is chosen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExposureMode {
    /// `"off"`: the camera's exposure; its picture is unchanged.
    #[default]
    Off,
    /// `"manual"`: a number of stops relative to the camera's exposure.
    Manual,
    /// `"auto"`: from the light that virtual lamps add.
    Auto,
}

/// Range of the manual exposure, stops; longer exposures amplify noise.
pub const EXPOSURE_STOPS: RangeInclusive<f32> = -8.0..=3.0;
/// Range of the minimum of the automatic exposure, stops.
pub const MIN_EV_STOPS: RangeInclusive<f32> = -8.0..=0.0;
/// Range of the maximum of the automatic exposure, stops.
pub const MAX_EV_STOPS: RangeInclusive<f32> = 0.0..=3.0;
/// Range of the mean linear brightness below which a picture counts as dark.
pub const EXPOSURE_KEYS: RangeInclusive<f32> = 0.0..=1.0;
/// Range of the time constant of the automatic exposure, seconds.
pub const ADAPTATION_SECONDS: RangeInclusive<f32> = 0.0..=60.0;

/// `[exposure]`
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExposureConfig {
    /// How the exposure is chosen.
    pub mode: ExposureMode,
    /// Stops relative to the camera's exposure, for [`ExposureMode::Manual`].
    pub ev: f32,
    /// How clipped areas appear in a shorter exposure.
    pub highlights: Highlights,
    /// Minimum of the automatic exposure, stops.
    pub min_ev: f32,
    /// Maximum of the automatic exposure, stops.
    pub max_ev: f32,
    /// Pictures with a lower mean linear brightness count as dark.
    pub key: f32,
    /// Time constant of the automatic exposure, seconds.
    pub adaptation_seconds: f32,
}

impl Default for ExposureConfig {
    fn default() -> Self {
        Self {
            mode: ExposureMode::Off,
            ev: 0.0,
            highlights: Highlights::Estimated,
            min_ev: -3.0,
            max_ev: 1.0,
            key: 0.05,
            adaptation_seconds: 0.5,
        }
    }
}

/// The value of `--exposure`: `off`, `auto`, or stops.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureChoice {
    /// The camera's picture unchanged.
    Off,
    /// From the light that virtual lamps add.
    Auto,
    /// Stops relative to the camera's exposure.
    Stops(f32),
}

impl FromStr for ExposureChoice {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let stops = |v: &f32| EXPOSURE_STOPS.contains(v);
        match (text, text.parse().ok().filter(stops)) {
            ("off", _) => Ok(Self::Off),
            ("auto", _) => Ok(Self::Auto),
            (_, Some(stops)) => Ok(Self::Stops(stops)),
            (_, None) => {
                let (low, high) = EXPOSURE_STOPS.into_inner();
                Err(format!(
                    "expected \"off\", \"auto\", or stops from {low} to {high}"
                ))
            }
        }
    }
}

impl ExposureConfig {
    /// Applies the command line's choice, which overrides the file.
    pub const fn choose(&mut self, choice: ExposureChoice) {
        match choice {
            ExposureChoice::Off => self.mode = ExposureMode::Off,
            ExposureChoice::Auto => self.mode = ExposureMode::Auto,
            ExposureChoice::Stops(stops) => {
                self.mode = ExposureMode::Manual;
                self.ev = stops;
            }
        }
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct ExposureFile {
    pub mode: Option<ExposureMode>,
    pub ev: Option<f64>,
    pub highlights: Option<Highlights>,
    pub min_ev: Option<f64>,
    pub max_ev: Option<f64>,
    pub key: Option<f64>,
    pub adaptation_s: Option<f64>,
}

pub(super) fn exposure(file: &ExposureFile, out: &mut ExposureConfig) -> Result<()> {
    set(&mut out.mode, file.mode);
    set(&mut out.ev, number("ev", file.ev, EXPOSURE_STOPS)?);
    set(&mut out.highlights, file.highlights);
    let darkest = number("min_ev", file.min_ev, MIN_EV_STOPS)?;
    set(&mut out.min_ev, darkest);
    let brightest = number("max_ev", file.max_ev, MAX_EV_STOPS)?;
    set(&mut out.max_ev, brightest);
    set(&mut out.key, number("key", file.key, EXPOSURE_KEYS)?);
    let seconds = number("adaptation_s", file.adaptation_s, ADAPTATION_SECONDS)?;
    set(&mut out.adaptation_seconds, seconds);
    Ok(())
}

fn number(key: &str, value: Option<f64>, range: RangeInclusive<f32>) -> Result<Option<f32>> {
    let range = f64::from(*range.start())..=f64::from(*range.end());
    let value = within(&format!("exposure.{key}"), value, range)?;
    Ok(value.map(|v| v as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_exposure_as_a_word_or_stops() {
        let read = |text: &str| text.parse::<ExposureChoice>();
        assert_eq!(read("off"), Ok(ExposureChoice::Off));
        assert_eq!(read("auto"), Ok(ExposureChoice::Auto));
        assert_eq!(read("-1.5"), Ok(ExposureChoice::Stops(-1.5)));
        for wrong in ["", "dark", "nan", "-9", "4", "inf", "--1"] {
            let error = read(wrong).unwrap_err();
            assert!(error.contains("stops from -8 to 3"), "{wrong}: {error}");
        }
        let mut config = ExposureConfig::default();
        config.choose(ExposureChoice::Stops(-2.0));
        assert_eq!((config.mode, config.ev), (ExposureMode::Manual, -2.0));
        config.choose(ExposureChoice::Auto);
        assert_eq!(config.mode, ExposureMode::Auto);
    }
}
