//! How the picture is composed, where there is a choice.

/// Value of clipped areas in a shorter exposure.
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
pub enum Highlights {
    /// `"estimated"`: their radiance above white is estimated from their surroundings.
    #[default]
    Estimated,
    /// `"paper"`: every pixel's factor rises with the mean intensity of the region around it.
    Paper,
}

/// How the shadow buffer darkens the camera's picture. E is the irradiance of the unshadowed
/// surface, R the part of it that virtual objects block.
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
pub enum ShadowMode {
    /// camera × (E − R) / E, in linear light: correct for a surface of any colour.
    #[default]
    Ratio,
    /// camera − R / π: equation 4 of Supan 2006, correct for white surfaces only.
    Subtract,
}

/// How real surfaces respond to virtual lights.
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
    /// `"intrinsic"`: reflectance is the picture divided by the incoming light, so the picture is
    /// multiplied by 1 + irradiance of the virtual lights / estimated irradiance.
    #[default]
    Intrinsic,
    /// `"paper"`: adds a blend of N·L and the relief in the picture (DiVerdi and Höllerer 2004,
    /// section 4.2).
    Paper,
}

/// What virtual objects are shaded with while shadowing planes are the technique.
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
pub enum PlaneShading {
    /// `"irradiance"`: the irradiance of the environment, compact sources at their directions.
    #[default]
    Irradiance,
    /// `"lights"`: the lights of all faces of the geodesic dome.
    Lights,
    /// `"six"`: six directional lights, each the sum of neighbouring faces (Kakuta 2004).
    Six,
}
