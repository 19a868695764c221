//! What can be wrong with a TOML file, by file, line and key.

use thiserror::Error;

/// A TOML file cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TomlError {
    /// The operating system refused to read it.
    #[error("{file}: cannot be read ({reason}); check the path and the permissions")]
    Unreadable {
        /// Path.
        file: String,
        /// What the system said.
        reason: String,
    },
    /// It is no TOML.
    #[error("{file}:{line}: not TOML: {reason}")]
    Syntax {
        /// Path.
        file: String,
        /// From 1.
        line: usize,
        /// The parser's words.
        reason: String,
    },
    /// A key that means nothing here.
    #[error("{file}:{line}: unknown key `{key}`; {hint}")]
    UnknownKey {
        /// Path.
        file: String,
        /// From 1.
        line: usize,
        /// Dotted path of the key.
        key: String,
        /// What was probably meant.
        hint: String,
    },
    /// A value of the wrong type or outside its range.
    #[error("{file}:{line}: `{key}`: {reason}")]
    Value {
        /// Path.
        file: String,
        /// From 1.
        line: usize,
        /// Dotted path of the key.
        key: String,
        /// What is expected there.
        reason: String,
    },
}
