//! Rendering of clipped highlights in another exposure.

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
