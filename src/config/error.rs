//! What can be wrong with a configuration.

use penumbra_scene::SceneError;
use penumbra_strict_toml::TomlError;
use thiserror::Error;

/// A configuration cannot be used.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// Its own text is wrong.
    #[error(transparent)]
    Toml(#[from] TomlError),
    /// The scene file that it names is wrong.
    #[error(transparent)]
    Scene(#[from] SceneError),
}
