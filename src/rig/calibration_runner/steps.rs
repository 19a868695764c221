//! The table of all calibration steps, and their creation by name and parameters.

use super::definition::{ParameterError, Parameters, RigContext, StepDefinition, joined};
use super::files::CHECKS_FOLDER;
use super::{intrinsics, pose_steps, radiometric, verify};
use crate::wall_date::utc_now;
use penumbra_calibration::step::{Step, StepInputs};
use penumbra_status::calibration::StepForm;
use std::collections::BTreeMap;

/// All steps, in the order in which a rig is calibrated.
const STEPS: &[StepDefinition] = &[
    intrinsics::STEP,
    pose_steps::MAP,
    pose_steps::TRACKER,
    pose_steps::LATENCY,
    pose_steps::ENVIRONMENT,
    radiometric::STEP,
    verify::STEP,
];

/// A step that is ready for its input.
pub struct PreparedStep {
    /// The step.
    pub step: Box<dyn Step>,
    /// Name for display.
    pub title: &'static str,
    /// Parameters that the step was created with.
    pub parameters: Parameters,
}

/// Creates the step `name` with the `requested` parameters for a rig.
///
/// # Errors
/// There is no such step or parameter, a value is invalid, or the rig lacks something that the
/// step needs.
pub fn make_step(
    name: &str,
    requested: &BTreeMap<String, String>,
    rig: &RigContext,
) -> Result<PreparedStep, ParameterError> {
    let Some(definition) = STEPS.iter().find(|step| step.name == name) else {
        return Err(ParameterError::UnknownStep {
            name: name.to_owned(),
            known: joined(STEPS.iter().map(|step| step.name)),
        });
    };
    let parameters = Parameters::from_request(definition, requested)?;
    Ok(PreparedStep {
        step: (definition.make)(&parameters, rig)?,
        title: definition.title,
        parameters,
    })
}

/// Returns the forms of all steps.
#[must_use]
pub fn forms() -> Vec<StepForm> {
    let form = |step: &StepDefinition| StepForm {
        name: step.name,
        title: step.title,
        about: step.about,
        parameters: step.parameters.to_vec(),
    };
    STEPS.iter().map(form).collect()
}

/// Returns the name for display of the step `name`; `name` itself if there is no such step.
#[must_use]
pub fn step_title(name: &'static str) -> &'static str {
    let step = STEPS.iter().find(|step| step.name == name);
    step.map_or(name, |step| step.title)
}

/// Returns the path of a step's calibration file within the folder of the rig's files, separated
/// by `/`.
#[must_use]
pub fn calibration_file_name<S: Step + ?Sized>(step: &S) -> String {
    file_name(step.name(), &step.inputs())
}

fn file_name(step: &str, wants: &StepInputs) -> String {
    let name = match step {
        "intrinsics" if wants.environment && !wants.scene => "environment_camera",
        "intrinsics" => "scene_camera",
        "map" => "markers",
        "verify" => {
            let [year, month, day, hour, minute, second] = utc_now();
            return format!(
                "{CHECKS_FOLDER}{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}.json"
            );
        }
        other => other,
    };
    format!("calibration/{name}.json")
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_config::Config;

    fn prepared(step: &str, requested: &[(&str, &str)]) -> Result<PreparedStep, ParameterError> {
        let requested = requested.iter();
        let requested = requested.map(|(k, v)| ((*k).to_owned(), (*v).to_owned()));
        let rig = RigContext::read(&Config::default()).unwrap();
        make_step(step, &requested.collect(), &rig)
    }

    #[test]
    fn each_step_writes_a_file_of_its_own() {
        let default = prepared("intrinsics", &[]).unwrap();
        assert_eq!(default.parameters.text("board"), "chess:9x6:0.025");
        assert_eq!(
            calibration_file_name(&*default.step),
            "calibration/scene_camera.json"
        );
        let requested = [("camera", "environment"), ("board", " chess:7x5:0.03 ")];
        let other = prepared("intrinsics", &requested).unwrap();
        assert_eq!(
            calibration_file_name(&*other.step),
            "calibration/environment_camera.json"
        );
        assert!(other.step.inputs().environment && !other.step.inputs().scene);
        let wants = default.step.inputs();
        assert_eq!(file_name("map", &wants), "calibration/markers.json");
        assert!(file_name("verify", &wants).starts_with("calibration/checks/2"));
    }

    #[test]
    fn default_of_every_parameter_is_a_valid_choice() {
        let forms = forms();
        assert!(!forms.is_empty());
        for form in forms {
            assert_eq!(step_title(form.name), form.title);
            for parameter in &form.parameters {
                let choices = parameter.choices;
                let known = choices.is_empty() || choices.iter().any(|c| c.0 == parameter.default);
                assert!(known, "{}.{}", form.name, parameter.name);
            }
        }
    }

    #[test]
    fn rejects_invalid_requests_in_one_line_that_names_valid_ones() {
        for (step, requested, expected) in [
            ("lens", &[][..], "choose one of intrinsics"),
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
            ("intrinsics", &[("model", "pinhole")], "one of default"),
        ] {
            let error = prepared(step, requested).err().unwrap().to_string();
            assert!(error.contains(expected) && !error.contains('\n'), "{error}");
        }
    }
}
