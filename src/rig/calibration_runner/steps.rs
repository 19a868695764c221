//! The steps that a live rig can be asked for, by name and parameters.

use super::files::CHECKS;
use super::{kinds, kinds_of_motion, radiometric, verify};
use crate::error::RigError;
use crate::source::RigFiles;
use crate::wall_date::utc_now;
use penumbra_calibration::step::{Step, Wants};
use penumbra_config::Config;
use penumbra_config::TrackerSource;
use penumbra_rig_model::RigDocument;
use penumbra_status::calibration::{ParameterForm, StepForm};
use std::collections::BTreeMap;
use thiserror::Error;

/// All that there are, in the order in which a rig is calibrated.
const STEPS: &[StepKind] = &[
    kinds::INTRINSICS,
    kinds_of_motion::MAP,
    kinds_of_motion::TRACKER,
    kinds_of_motion::LATENCY,
    kinds_of_motion::ENVIRONMENT,
    radiometric::KIND,
    verify::KIND,
];

/// A step, described.
#[derive(Clone, Copy)]
pub struct StepKind {
    /// As [`Step::name`] has it.
    pub name: &'static str,
    /// For people.
    pub title: &'static str,
    /// What to do, in a sentence or two.
    pub about: &'static str,
    /// What has to be said.
    pub parameters: &'static [ParameterForm],
    /// Makes it, for a rig of which so much is known.
    pub make: MakeStep,
}

/// Makes a step for a rig of which so much is known.
pub type MakeStep = fn(&Parameters, &Known) -> Result<Box<dyn Step>, ParameterError>;

/// What is known of a rig before a step.
#[derive(Clone, Debug)]
pub struct Known {
    /// What the files say, calibrations included.
    pub document: RigDocument,
    /// The files themselves.
    pub files: RigFiles,
    /// The settings.
    pub config: Config,
}

impl Known {
    /// By the rig's files as they are now.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn read(config: &Config) -> Result<Self, RigError> {
        let files = RigFiles::load(config)?;
        Ok(Self {
            document: files.document(config)?,
            files,
            config: config.clone(),
        })
    }
}

/// The tracker's station that carries the scene camera.
pub(super) fn station(config: &Config) -> u8 {
    match &config.tracker {
        Some(TrackerSource::System(tracker)) => tracker.station,
        _ => 1,
    }
}

/// A step or a parameter that cannot be had. Each text is one line.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum ParameterError {
    /// No such step.
    #[error("there is no step `{name}`; there are {known}")]
    NoStep {
        /// As it was sent.
        name: String,
        /// What there is.
        known: String,
    },
    /// No such parameter.
    #[error("`{step}` has no parameter `{name}`; it has {known}")]
    NoParameter {
        /// Which step.
        step: &'static str,
        /// As it was sent.
        name: String,
        /// What there is.
        known: String,
    },
    /// A value that cannot be.
    #[error("{name} = {value:?}: {reason}")]
    Wrong {
        /// Which.
        name: &'static str,
        /// As it was sent.
        value: String,
        /// Why, and what could be.
        reason: String,
    },
    /// The rig has not what the step needs.
    #[error("{reason}")]
    Rig {
        /// What it has not, and what to do.
        reason: String,
    },
}

/// Parameters of a step, checked against its description: none is unknown, none is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameters(BTreeMap<&'static str, String>);

impl Parameters {
    /// What was sent, and the usual for the rest.
    fn of(kind: &StepKind, sent: &BTreeMap<String, String>) -> Result<Self, ParameterError> {
        for name in sent.keys() {
            if !kind.parameters.iter().any(|p| p.name == name) {
                return Err(ParameterError::NoParameter {
                    step: kind.name,
                    name: name.clone(),
                    known: listed(kind.parameters.iter().map(|p| p.name)),
                });
            }
        }
        let mut all = BTreeMap::new();
        for form in kind.parameters {
            let value = sent.get(form.name).map_or(form.default, |v| v.trim());
            if !form.choices.is_empty() && !form.choices.iter().any(|c| c.0 == value) {
                let choices = listed(form.choices.iter().map(|c| c.0));
                return Err(wrong(form.name, value, format!("choose one of {choices}")));
            }
            all.insert(form.name, value.to_owned());
        }
        Ok(Self(all))
    }

    /// A parameter's value; empty if the step's description does not name it.
    #[must_use]
    pub fn text(&self, name: &str) -> &str {
        self.0.get(name).map_or("", String::as_str)
    }

    /// That a parameter's value cannot be.
    #[must_use]
    pub fn wrong(&self, name: &'static str, reason: String) -> ParameterError {
        wrong(name, self.text(name), reason)
    }

    /// All of them, by name.
    #[must_use]
    pub fn to_map(&self) -> BTreeMap<String, String> {
        let pairs = self.0.iter();
        pairs.map(|(k, v)| ((*k).to_owned(), v.clone())).collect()
    }
}

fn wrong(name: &'static str, value: &str, reason: String) -> ParameterError {
    ParameterError::Wrong {
        name,
        value: value.to_owned(),
        reason,
    }
}

fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<&str> = names.collect();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

/// A step that is ready to be shown things.
pub struct Made {
    /// It.
    pub step: Box<dyn Step>,
    /// Its name for people.
    pub title: &'static str,
    /// What it was made with.
    pub parameters: Parameters,
}

/// The step `name` with what was `sent`, for a rig of which so much is `known`.
///
/// # Errors
/// No such step or parameter, a value that cannot be, a rig that lacks something.
pub fn step_of(
    name: &str,
    sent: &BTreeMap<String, String>,
    known: &Known,
) -> Result<Made, ParameterError> {
    let Some(kind) = STEPS.iter().find(|kind| kind.name == name) else {
        return Err(ParameterError::NoStep {
            name: name.to_owned(),
            known: listed(STEPS.iter().map(|kind| kind.name)),
        });
    };
    let parameters = Parameters::of(kind, sent)?;
    Ok(Made {
        step: (kind.make)(&parameters, known)?,
        title: kind.title,
        parameters,
    })
}

/// All steps, as forms to be filled in.
#[must_use]
pub fn forms() -> Vec<StepForm> {
    let form = |kind: &StepKind| StepForm {
        name: kind.name,
        title: kind.title,
        about: kind.about,
        parameters: kind.parameters.to_vec(),
    };
    STEPS.iter().map(form).collect()
}

/// The name for people of the step `name`.
#[must_use]
pub fn title_of(name: &'static str) -> &'static str {
    let kind = STEPS.iter().find(|kind| kind.name == name);
    kind.map_or(name, |kind| kind.title)
}

/// Where a step's calibration belongs among the files of a rig, by `/`.
#[must_use]
pub fn file_of<S: Step + ?Sized>(step: &S) -> String {
    file_name(step.name(), &step.wants())
}

fn file_name(step: &str, wants: &Wants) -> String {
    let name = match step {
        "intrinsics" if wants.environment && !wants.scene => "environment_camera",
        "intrinsics" => "scene_camera",
        "map" => "markers",
        "verify" => {
            let [year, month, day, hour, minute, second] = utc_now();
            return format!(
                "{CHECKS}{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.json"
            );
        }
        other => other,
    };
    format!("calibration/{name}.json")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn made(step: &str, sent: &[(&str, &str)]) -> Result<Made, ParameterError> {
        let sent = sent.iter();
        let sent = sent.map(|(k, v)| ((*k).to_owned(), (*v).to_owned()));
        step_of(
            step,
            &sent.collect(),
            &Known::read(&Config::default()).unwrap(),
        )
    }

    #[test]
    fn steps_are_made_by_name_and_go_to_files_of_their_own() {
        let usual = made("intrinsics", &[]).unwrap();
        assert_eq!(usual.parameters.text("board"), "chess:9x6:0.025");
        assert_eq!(file_of(&*usual.step), "calibration/scene_camera.json");
        let sent = [("camera", "environment"), ("board", " chess:7x5:0.03 ")];
        let other = made("intrinsics", &sent).unwrap();
        assert_eq!(file_of(&*other.step), "calibration/environment_camera.json");
        assert!(other.step.wants().environment && !other.step.wants().scene);
        let wants = usual.step.wants();
        assert_eq!(file_name("map", &wants), "calibration/markers.json");
        assert!(file_name("verify", &wants).starts_with("calibration/checks/2"));
    }

    #[test]
    fn every_form_can_be_sent_as_it_stands() {
        let forms = forms();
        assert!(!forms.is_empty());
        for form in forms {
            assert_eq!(title_of(form.name), form.title);
            for parameter in &form.parameters {
                let choices = parameter.choices;
                let known = choices.is_empty() || choices.iter().any(|c| c.0 == parameter.default);
                assert!(known, "{}.{}", form.name, parameter.name);
            }
        }
    }

    #[test]
    fn what_cannot_be_is_refused_in_one_line_that_says_what_could() {
        for (step, sent, says) in [
            ("lens", &[][..], "there are intrinsics"),
            (
                "intrinsics",
                &[("bord", "x")],
                "it has camera, board, model",
            ),
            (
                "intrinsics",
                &[("camera", "left")],
                "one of scene, environment",
            ),
            (
                "intrinsics",
                &[("board", "9x6")],
                "write chess:COLUMNSxROWS",
            ),
            ("intrinsics", &[("board", "chess:9x6:25")], "25 mm is 0.025"),
            ("intrinsics", &[("model", "pinhole")], "one of usual"),
        ] {
            let error = made(step, sent).err().unwrap().to_string();
            assert!(error.contains(says) && !error.contains('\n'), "{error}");
        }
    }
}
