//! Errors of a configuration.

use penumbra_scene::SceneError;
use penumbra_strict_toml::TomlError;
use thiserror::Error;

/// An error of a configuration.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file cannot be read or is invalid.
    #[error(transparent)]
    Toml(#[from] TomlError),
    /// The scene file that it names is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
}
