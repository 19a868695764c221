//! The definition of a calibration step: its name, its parameters, and how it is created from
//! them.

use crate::error::RigError;
use crate::source::RigFiles;
use penumbra_calibration::step::Step;
use penumbra_config::Config;
use penumbra_config::TrackerSource;
use penumbra_rig_model::RigDocument;
use penumbra_status::calibration::ParameterForm;
use std::collections::BTreeMap;
use thiserror::Error;

/// Definition of a calibration step.
#[derive(Clone, Copy)]
pub struct StepDefinition {
    /// The name that [`Step::name`] returns.
    pub name: &'static str,
    /// Name for display.
    pub title: &'static str,
    /// Instructions to the user, in a sentence or two.
    pub about: &'static str,
    /// The parameters, as fields of a form.
    pub parameters: &'static [ParameterForm],
    /// Creates the step.
    pub make: MakeStep,
}

/// Creates a step from its parameters and the rig's present calibration.
pub type MakeStep = fn(&Parameters, &RigContext) -> Result<Box<dyn Step>, ParameterError>;

/// The rig's calibration and settings before a step.
#[derive(Clone, Debug)]
pub struct RigContext {
    /// The rig's calibration, read from `files`.
    pub document: RigDocument,
    /// The rig's files.
    pub files: RigFiles,
    /// The settings.
    pub config: Config,
}

impl RigContext {
    /// Reads the rig's files as they are now.
    ///
    /// # Errors
    /// A file cannot be read or parsed.
    pub fn read(config: &Config) -> Result<Self, RigError> {
        let files = RigFiles::load(config)?;
        Ok(Self {
            document: files.document(config)?,
            files,
            config: config.clone(),
        })
    }
}

/// Returns the tracker's station that is mounted on the scene camera.
pub(super) fn station(config: &Config) -> u8 {
    match &config.tracker {
        Some(TrackerSource::System(tracker)) => tracker.station,
        _ => 1,
    }
}

/// Error of a step that does not exist, an invalid parameter, or a rig that a step cannot use.
/// Each message is one line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ParameterError {
    /// Unknown step.
    #[error("there is no step `{name}`; choose one of {known}")]
    UnknownStep {
        /// Requested name.
        name: String,
        /// Names of all steps.
        known: String,
    },
    /// Unknown parameter.
    #[error("`{step}` has no parameter `{name}`; it has {known}")]
    UnknownParameter {
        /// Name of the step.
        step: &'static str,
        /// Requested name.
        name: String,
        /// Names of all parameters of the step.
        known: String,
    },
    /// Invalid value of a parameter.
    #[error("{name} = {value:?}: {reason}")]
    InvalidValue {
        /// Name of the parameter.
        name: &'static str,
        /// The value.
        value: String,
        /// What is wrong, and which values are valid.
        reason: String,
    },
    /// The rig lacks something that the step needs.
    #[error("{reason}")]
    RigNotReady {
        /// What is missing, and what to do.
        reason: String,
    },
}

/// Parameters of a step, checked against its definition: all are known and none is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters(BTreeMap<&'static str, String>);

impl Parameters {
    /// Checks the `requested` parameters of a step; the others take their defaults.
    pub(super) fn from_request(
        definition: &StepDefinition,
        requested: &BTreeMap<String, String>,
    ) -> Result<Self, ParameterError> {
        for name in requested.keys() {
            if !definition.parameters.iter().any(|p| p.name == name) {
                return Err(ParameterError::UnknownParameter {
                    step: definition.name,
                    name: name.clone(),
                    known: joined(definition.parameters.iter().map(|p| p.name)),
                });
            }
        }
        let mut all = BTreeMap::new();
        for form in definition.parameters {
            let value = requested.get(form.name).map_or(form.default, |v| v.trim());
            if !form.choices.is_empty() && !form.choices.iter().any(|c| c.0 == value) {
                let choices = joined(form.choices.iter().map(|c| c.0));
                let reason = format!("choose one of {choices}");
                return Err(invalid(form.name, value, reason));
            }
            all.insert(form.name, value.to_owned());
        }
        Ok(Self(all))
    }

    /// Returns the value of a parameter; empty if the step has no such parameter.
    #[must_use]
    pub fn text(&self, name: &str) -> &str {
        self.0.get(name).map_or("", String::as_str)
    }

    /// Returns the error that the value of parameter `name` is invalid for `reason`.
    #[must_use]
    pub fn invalid(&self, name: &'static str, reason: String) -> ParameterError {
        invalid(name, self.text(name), reason)
    }

    /// Returns all parameters by name.
    #[must_use]
    pub fn to_map(&self) -> BTreeMap<String, String> {
        let pairs = self.0.iter();
        pairs.map(|(k, v)| ((*k).to_owned(), v.clone())).collect()
    }
}

fn invalid(name: &'static str, value: &str, reason: String) -> ParameterError {
    ParameterError::InvalidValue {
        name,
        value: value.to_owned(),
        reason,
    }
}

/// Joins names with commas.
pub(super) fn joined<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}
