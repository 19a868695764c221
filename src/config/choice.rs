//! The values of settings that are enumerations; doc comments give their spelling in TOML.

use penumbra_camera::Response;
use serde::de::{self, Deserialize, Deserializer, Visitor};
use std::fmt;
use std::str::FromStr;

/// Measurement of the tracker latency while the rig runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FollowLatency {
    /// `"off"`: not measured.
    Off,
    /// `"report"`: status reports it beside the calibrated latency and warns where they differ.
    #[default]
    Report,
    /// `"apply"`: it slowly replaces the calibrated latency once its uncertainty is small.
    Apply,
}

/// Treatment of sources that even the darkest exposure clips.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Clipped {
    /// `"estimate"`: their energy is estimated and flagged.
    #[default]
    Estimate,
    /// `"keep"`: clipped values are used unchanged, and flagged.
    Keep,
}

/// Radiance of the directions that the environment camera does not see.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Unseen {
    /// `"scene-camera"`: from the scene camera where it sees them, else the mean of the seen part.
    #[default]
    SceneCamera,
    /// `"mean"`: the mean radiance of the seen part.
    Mean,
    /// `"black"`: nothing.
    Black,
}

/// Where lamps are.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum LightPlaces {
    /// `"estimate"`: at the distance that the real shadows in the scene camera's picture tell; else
    /// infinitely far. They show lamps that the environment camera does not see, too.
    #[default]
    Estimate,
    /// `"far"`: infinitely far, unless a place is stated.
    Far,
}

/// How long pictures of a recording wait for matching readings.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum ReplayPairing {
    /// `"auto"`: `live` if a running rig recorded its output, else `complete`.
    #[default]
    Auto,
    /// `"live"`: as in the live rig, which reproduces the pictures that it showed.
    Live,
    /// `"complete"`: until all readings have arrived, for the smoothest poses.
    Complete,
}

/// How virtual objects are lit and cast shadows.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Technique {
    /// `"image-based-shadowing"`: image-based lighting, and one shadow map for each light of
    /// a light dome, rendered with every picture (Supan 2006).
    #[default]
    ImageBasedShadowing,
    /// `"shadowing-planes"`: image-based lighting, and shadows from basis images on shadowing
    /// planes, baked in advance (Kakuta 2004, 2007).
    ShadowingPlanes,
    /// `"image-based-lighting"`: image-based lighting without shadows.
    ImageBasedLighting,
}

/// Quality of the composed picture.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// `"live"`: the picture that a running rig shows on this adapter.
    #[default]
    Live,
    /// `"best"`: every picture takes the time that it needs.
    Best,
}

/// Antialiasing of virtual objects.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Antialias {
    /// `"msaa4"`: four samples a pixel.
    #[default]
    Msaa4,
    /// `"off"`: one sample a pixel.
    Off,
}

/// Speed of a replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplaySpeed {
    /// Factor of the recorded speed.
    Factor(f64),
    /// `"max"`: as fast as possible, without skipping frames.
    Max,
}

impl Default for ReplaySpeed {
    fn default() -> Self {
        Self::Factor(1.0)
    }
}

/// Number of shadow maps that are updated in each frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refresh {
    /// Maximum number; maps that changed come first.
    Count(u32),
    /// `"all"`: every map.
    #[default]
    All,
}

impl Refresh {
    /// Returns the number for `lights` dome lights.
    #[must_use]
    pub fn count(self, lights: u32) -> u32 {
        match self {
            Self::Count(n) => n.min(lights),
            Self::All => lights,
        }
    }
}

/// A camera's tone curve: `"srgb"`, `"linear"` or an exponent such as `2.2`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum ToneCurve {
    /// IEC 61966-2-1.
    #[default]
    Srgb,
    /// Linear codes.
    Linear,
    /// linear = code^gamma.
    Gamma(f32),
}

impl ToneCurve {
    /// Returns the curve as a table.
    #[must_use]
    pub fn response(self) -> Response {
        match self {
            Self::Srgb => Response::srgb(),
            Self::Linear => Response::linear(),
            Self::Gamma(gamma) => Response::gamma(gamma),
        }
    }
}

/// The window's monitor: its number from 0, or part of its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Monitor {
    /// Number, from 0.
    Index(u32),
    /// Part of its name.
    Name(String),
}

/// A number or a word, for settings that take either.
#[derive(Clone, Debug, PartialEq)]
enum NumberOrWord {
    Number(f64),
    Word(String),
}

struct EitherVisitor(&'static str);

impl Visitor<'_> for EitherVisitor {
    type Value = NumberOrWord;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.0)
    }

    fn visit_str<E: de::Error>(self, v: &str) -> Result<NumberOrWord, E> {
        Ok(NumberOrWord::Word(v.to_owned()))
    }

    fn visit_i64<E: de::Error>(self, v: i64) -> Result<NumberOrWord, E> {
        Ok(NumberOrWord::Number(v as f64))
    }

    fn visit_u64<E: de::Error>(self, v: u64) -> Result<NumberOrWord, E> {
        Ok(NumberOrWord::Number(v as f64))
    }

    fn visit_f64<E: de::Error>(self, v: f64) -> Result<NumberOrWord, E> {
        Ok(NumberOrWord::Number(v))
    }
}

/// Deserialises via [`NumberOrWord`]; `expected` is the text for the message.
fn either<'de, D: Deserializer<'de>, T>(
    deserializer: D,
    expected: &'static str,
    read: impl Fn(NumberOrWord) -> Option<T>,
) -> Result<T, D::Error> {
    let value = deserializer.deserialize_any(EitherVisitor(expected))?;
    let shown = match &value {
        NumberOrWord::Number(n) => n.to_string(),
        NumberOrWord::Word(w) => format!("\"{w}\""),
    };
    read(value).ok_or_else(|| de::Error::custom(format!("{shown}, expected {expected}")))
}

/// Parses a word of the command line like a value of the file.
fn typed(text: &str) -> NumberOrWord {
    text.parse().map_or_else(
        |_| NumberOrWord::Word(text.to_owned()),
        NumberOrWord::Number,
    )
}

impl Refresh {
    const EXPECTED: &str = "a whole number from 1 to 384, or \"all\"";

    fn read(value: NumberOrWord) -> Option<Self> {
        match value {
            NumberOrWord::Number(n) if n.fract() == 0.0 && (1.0..=384.0).contains(&n) => {
                Some(Self::Count(n as u32))
            }
            NumberOrWord::Word(w) if w == "all" => Some(Self::All),
            _ => None,
        }
    }
}

impl FromStr for Refresh {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::read(typed(text)).ok_or_else(|| format!("expected {}", Self::EXPECTED))
    }
}

impl<'de> Deserialize<'de> for Refresh {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        either(d, Self::EXPECTED, Self::read)
    }
}

impl ReplaySpeed {
    const EXPECTED: &str = "a factor between 0.01 and 100, or \"max\"";

    fn read(value: NumberOrWord) -> Option<Self> {
        match value {
            NumberOrWord::Number(n) if (0.01..=100.0).contains(&n) => Some(Self::Factor(n)),
            NumberOrWord::Word(w) if w == "max" => Some(Self::Max),
            _ => None,
        }
    }
}

impl FromStr for ReplaySpeed {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::read(typed(text)).ok_or_else(|| format!("expected {}", Self::EXPECTED))
    }
}

impl<'de> Deserialize<'de> for ReplaySpeed {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        either(d, Self::EXPECTED, Self::read)
    }
}

impl<'de> Deserialize<'de> for ToneCurve {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        let expected = "\"srgb\", \"linear\", or an exponent between 0.1 and 10";
        either(d, expected, |v| match v {
            NumberOrWord::Number(n) if (0.1..=10.0).contains(&n) => Some(Self::Gamma(n as f32)),
            NumberOrWord::Word(w) if w == "srgb" => Some(Self::Srgb),
            NumberOrWord::Word(w) if w == "linear" => Some(Self::Linear),
            _ => None,
        })
    }
}

impl Monitor {
    const EXPECTED: &str = "a monitor's number from 0, or part of its name";

    fn read(value: NumberOrWord) -> Option<Self> {
        match value {
            NumberOrWord::Number(n) if n.fract() == 0.0 && (0.0..64.0).contains(&n) => {
                Some(Self::Index(n as u32))
            }
            NumberOrWord::Word(w) => Some(Self::Name(w)),
            NumberOrWord::Number(_) => None,
        }
    }
}

impl FromStr for Monitor {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Self::read(typed(text)).ok_or_else(|| format!("expected {}", Self::EXPECTED))
    }
}

impl<'de> Deserialize<'de> for Monitor {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        either(d, Self::EXPECTED, Self::read)
    }
}
