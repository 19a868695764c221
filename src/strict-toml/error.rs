//! Errors in a TOML file, by file, line and key.

use thiserror::Error;

/// A TOML file cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
pub enum TomlError {
    /// The file cannot be read.
    #[error("{file}: cannot be read ({reason}); check the path and the permissions")]
    Unreadable {
        /// Path.
        file: String,
        /// The system's message.
        reason: String,
    },
    /// The text is not TOML.
    #[error("{file}:{line}: not TOML: {reason}")]
    Syntax {
        /// Path.
        file: String,
        /// Line, from 1.
        line: usize,
        /// The parser's message.
        reason: String,
    },
    /// An unknown key.
    #[error("{file}:{line}: unknown key `{key}`; {hint}")]
    UnknownKey {
        /// Path.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Dotted path of the key.
        key: String,
        /// The suggestion.
        hint: String,
    },
    /// A value of the wrong type or out of range.
    #[error("{file}:{line}: `{key}`: {reason}")]
    Value {
        /// Path.
        file: String,
        /// Line, from 1.
        line: usize,
        /// Dotted path of the key.
        key: String,
        /// What is expected.
        reason: String,
    },
}
