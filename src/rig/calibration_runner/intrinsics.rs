//! Definition of the intrinsics step: the lens of a camera.

use super::definition::{ParameterError, Parameters, RigContext, StepDefinition};
use penumbra_calibration::intrinsics::{Board, IntrinsicsStep, KnownLenses, Options};
use penumbra_calibration::step::{CameraRole, Step};
use penumbra_camera::LensModel;
use penumbra_status::calibration::ParameterForm;

/// The definition of the step.
pub(super) const STEP: StepDefinition = StepDefinition {
    name: "intrinsics",
    title: "Lens of a camera",
    about: "Hold a board in front of the camera, near and far, in every part of the picture, \
            tilted by 20° to 45° to all sides. Keep it still for a moment in each position.",
    parameters: &[
        ParameterForm {
            name: "camera",
            label: "Camera",
            hint: "Camera to calibrate.",
            default: "scene",
            choices: &[("scene", "Scene"), ("environment", "Environment")],
        },
        ParameterForm {
            name: "board",
            label: "Board",
            hint: "The board as measured on the print: chess:9x6:0.025, aprilgrid:6x6:0.088:0.3 or \
                   charuco:8x5:0.03:0.022:4x4_50; lengths in metres.",
            default: "chess:9x6:0.025",
            choices: &[],
        },
        ParameterForm {
            name: "model",
            label: "Lens model",
            hint: "Default: Brown for the scene camera, fisheye for the environment camera.",
            default: "default",
            choices: &[
                ("default", "Default"),
                ("brown", "Brown"),
                ("fisheye", "Fisheye"),
            ],
        },
    ],
    make,
};

fn make(parameters: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let board = Board::parse(parameters.text("board"))
        .map_err(|error| parameters.invalid("board", error.to_string()))?;
    let camera = match parameters.text("camera") {
        "environment" => CameraRole::Environment,
        _ => CameraRole::Scene,
    };
    let model = match (parameters.text("model"), camera) {
        ("fisheye", _) | ("default", CameraRole::Environment) => LensModel::KannalaBrandt,
        _ => LensModel::Brown,
    };
    let options = Options {
        model,
        square_pixels: true,
    };
    let present_lenses = KnownLenses::from_rig(&rig.document);
    let step = IntrinsicsStep::new(camera, board, options, present_lenses);
    let step = step.with_rig(&rig.document);
    Ok(Box::new(step))
}
