//! What each step is called, what it asks, and how it is made from that.

use super::steps::{Known, ParameterError, Parameters, StepKind};
use penumbra_calibration::intrinsics::{Board, IntrinsicsStep, Options, SaidLenses};
use penumbra_calibration::step::{Eye, Step};
use penumbra_camera::LensModel;
use penumbra_status::calibration::ParameterForm;

/// The lens of a camera.
pub(super) const INTRINSICS: StepKind = StepKind {
    name: "intrinsics",
    title: "Lens of a camera",
    about: "Hold a board before the camera, near and far, in every part of the picture, tilted \
            by 20° to 45° to all sides. Keep it still for a moment at each place.",
    parameters: &[
        ParameterForm {
            name: "camera",
            label: "Camera",
            hint: "Whose lens.",
            default: "scene",
            choices: &[("scene", "Scene"), ("environment", "Environment")],
        },
        ParameterForm {
            name: "board",
            label: "Board",
            hint: "As measured on the print: chess:9x6:0.025, aprilgrid:6x6:0.088:0.3 or \
                   charuco:8x5:0.03:0.022:4x4_50; lengths in metres.",
            default: "chess:9x6:0.025",
            choices: &[],
        },
        ParameterForm {
            name: "model",
            label: "Lens model",
            hint: "Usual: Brown for the scene camera, fisheye for the other.",
            default: "usual",
            choices: &[
                ("usual", "Usual"),
                ("brown", "Brown"),
                ("fisheye", "Fisheye"),
            ],
        },
    ],
    make: intrinsics,
};

fn intrinsics(parameters: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let board = Board::parse(parameters.text("board"))
        .map_err(|error| parameters.wrong("board", error.to_string()))?;
    let eye = match parameters.text("camera") {
        "environment" => Eye::Environment,
        _ => Eye::Scene,
    };
    let model = match (parameters.text("model"), eye) {
        ("fisheye", _) | ("usual", Eye::Environment) => LensModel::KannalaBrandt,
        _ => LensModel::Brown,
    };
    let options = Options {
        model,
        square_pixels: true,
    };
    let said = SaidLenses::of(&known.document);
    Ok(Box::new(IntrinsicsStep::new(eye, board, options, said)))
}
