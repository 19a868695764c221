//! How clipped highlights are shown in another exposure.

/// What clipped areas become in a shorter exposure.
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
    /// `"estimated"`: how far above white they are is told by what surrounds them.
    #[default]
    Estimated,
    /// `"paper"`: every pixel's factor rises with the mean intensity of the region around it.
    Paper,
}
