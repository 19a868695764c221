//! The alternatives that settings choose from, spelled in TOML as in their doc comments.

use penumbra_camera::Response;
use serde::de::{self, Deserialize, Deserializer, Visitor};
use std::fmt;
use std::str::FromStr;

/// What is done about a tracker's latency that is measured while the rig runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FollowLatency {
    /// `"off"`: it is not measured.
    Off,
    /// `"report"`: status reports it beside the calibrated latency and warns where they differ.
    #[default]
    Report,
    /// `"apply"`: it slowly replaces the calibrated latency once its uncertainty is small.
    Apply,
}

/// What is done about sources that even the darkest exposure clips.
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
    /// `"keep"`: clipped values are taken as they are, and flagged.
    Keep,
}

/// What fills the directions the environment camera cannot see.
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
    /// `"scene-camera"`: what the scene camera sees there, else the seen part's mean.
    #[default]
    SceneCamera,
    /// `"mean"`: the mean radiance of the seen part.
    Mean,
    /// `"black"`: nothing.
    Black,
}

/// How long pictures of a recording wait for what belongs to them.
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
    /// `"auto"`: `live` where a running rig recorded what it composed, else `complete`.
    #[default]
    Auto,
    /// `"live"`: as in a live rig, so that the pictures are those that it showed.
    Live,
    /// `"complete"`: pictures wait for all their data, for the smoothest poses.
    Complete,
}

/// How real surfaces answer virtual lamps.
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
pub enum LampResponse {
    /// `"intrinsic"`: the picture over the light that arrives is what the surface reflects.
    #[default]
    Intrinsic,
    /// `"paper"`: N·L and the picture's own relief, blended (DiVerdi and Höllerer 2004).
    Paper,
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
    /// a light dome, drawn with every picture (Supan 2006).
    #[default]
    ImageBasedShadowing,
    /// `"shadowing-planes"`: image-based lighting, and shadows from basis images on shadowing
    /// planes, baked beforehand (Kakuta 2004, 2007).
    ShadowingPlanes,
    /// `"image-based-lighting"`: image-based lighting without shadows.
    ImageBasedLighting,
}

/// Resolution of the shadow buffer.
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
pub enum ShadowResolution {
    /// `"auto"`: full on a GPU; on a software adapter a quarter, and full in a replay at
    /// full speed.
    #[default]
    Auto,
    /// `"full"`: the picture's.
    Full,
    /// `"half"`: half of it, upsampled along edges.
    Half,
    /// `"quarter"`: a quarter of it, likewise.
    Quarter,
}

/// How the environment camera's white point is found.
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
pub enum WhiteBalanceMethod {
    /// `"auto"`: chart, else overlap, else reflectance; they check one another.
    #[default]
    Auto,
    /// `"chart"`: from pictures of one chart.
    Chart,
    /// `"overlap"`: from what both cameras see.
    Overlap,
    /// `"reflectance"`: from a surface of known reflectance.
    Reflectance,
    /// `"fixed"`: the gains given.
    Fixed,
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
    /// `"off"`: one.
    Off,
}

/// How fast a recording plays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ReplaySpeed {
    /// A factor of the recorded pace; 1 is as it was.
    Factor(f64),
    /// `"max"`: as fast as frames can be made; none is left out.
    Max,
}

impl Default for ReplaySpeed {
    fn default() -> Self {
        Self::Factor(1.0)
    }
}

/// How many shadow maps are drawn anew each frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Refresh {
    /// At most so many, those that changed first.
    Count(u32),
    /// `"all"`.
    #[default]
    All,
}

impl Refresh {
    /// The number for `lights` dome lights.
    #[must_use]
    pub fn of(self, lights: u32) -> u32 {
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
    /// Codes are linear.
    Linear,
    /// linear = code^gamma.
    Gamma(f32),
}

impl ToneCurve {
    /// The curve as a table.
    #[must_use]
    pub fn response(self) -> Response {
        match self {
            Self::Srgb => Response::srgb(),
            Self::Linear => Response::linear(),
            Self::Gamma(gamma) => Response::gamma(gamma),
        }
    }
}

/// Which monitor a window goes to: its number from 0, or part of its name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Monitor {
    /// Counted from 0.
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

/// Deserialises by way of [`NumberOrWord`]; `expected` is what the user is told.
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

/// A word from the command line, as if it stood in the file.
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
