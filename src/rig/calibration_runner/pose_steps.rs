//! Definitions of the steps that estimate poses and latencies: map, tracker, latency and
//! environment.

use super::definition::{ParameterError, Parameters, RigContext, StepDefinition, station};
use crate::markers::tag_map;
use penumbra_calibration::environment_camera_calibration::{
    EnvironmentCameraKind, EnvironmentOptions, EnvironmentStep, KnownRig,
};
use penumbra_calibration::hand_eye_calibration::{
    Landmarks, LatencyChoice, LatencyOptions, LatencyStep, MountingOptions, MountingStep,
};
use penumbra_calibration::intrinsics::Board;
use penumbra_calibration::step::Step;
use penumbra_calibration::tag_map::{MapOptions, MapStep};
use penumbra_fiducials::Family;
use penumbra_rig_model::lens_files::ENVIRONMENT_LENS;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_status::calibration::ParameterForm;
use std::collections::BTreeMap;

/// Maximum offset that the latency step searches, seconds.
const MAX_OFFSET_SECONDS: f64 = 0.25;

const BOARD: ParameterForm = ParameterForm {
    name: "board",
    label: "Board",
    hint: "A static chessboard instead of the rig's markers: chess:9x6:0.025. Empty for markers.",
    default: "",
    choices: &[],
};

/// The definition of the map step: relative poses of tags.
pub(super) const MAP: StepDefinition = StepDefinition {
    name: "map",
    title: "Map of markers",
    about: "Let the scene camera see the markers from all sides, several at a time, until each was \
            seen together with others.",
    parameters: &[
        ParameterForm {
            name: "size",
            label: "Size",
            hint: "Edge of the tags' black border in metres; empty if rig.json states it.",
            default: "",
            choices: &[],
        },
        ParameterForm {
            name: "origin",
            label: "Origin",
            hint: "Number of the tag that defines a new world frame; empty to keep the rig's.",
            default: "",
            choices: &[],
        },
        ParameterForm {
            name: "family",
            label: "Family",
            hint: "Tag family.",
            default: "tag36h11",
            choices: &[],
        },
    ],
    make: map,
};

fn map(parameters: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let family = parameters.text("family").parse::<Family>();
    let family = family.map_err(|error| parameters.invalid("family", error.to_string()))?;
    let size = number(parameters, "size", 0.002, 5.0)?;
    let origin = match parameters.text("origin") {
        "" => None,
        text => Some(text.parse().map_err(|_| {
            parameters.invalid(
                "origin",
                "expected a tag's number, or an empty field".to_owned(),
            )
        })?),
    };
    let options = MapOptions {
        families: vec![family],
        size,
        origin,
        sizes: BTreeMap::new(),
    };
    let document = &rig.document;
    let step = MapStep::new(&document.calibration, &document.markers, options);
    Ok(Box::new(step))
}

/// The definition of the tracker step: the mounting of the scene camera on the tracker's sensor.
pub(super) const TRACKER: StepDefinition = StepDefinition {
    name: "tracker",
    title: "Camera on the tracker",
    about: "Turn the rig about all its axes for half a minute, by 30° and more, with markers or a \
            board in view.",
    parameters: &[
        BOARD,
        ParameterForm {
            name: "distortion",
            label: "Field distortion",
            hint: "Estimate how metal distorts an electromagnetic tracker's field: move through \
                   its entire volume for two minutes.",
            default: "no",
            choices: &[("no", "No"), ("yes", "Yes")],
        },
    ],
    make: tracker,
};

fn tracker(parameters: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let landmarks = landmarks(parameters, rig)?.ok_or_else(|| ParameterError::RigNotReady {
        reason: "the rig has no markers; run the map step first, or name a board".to_owned(),
    })?;
    let options = MountingOptions {
        station: station(&rig.config),
        latency: LatencyChoice::Estimate,
        distortion: parameters.text("distortion") == "yes",
        world_is_board: matches!(landmarks, Landmarks::Board(_)),
    };
    let step = MountingStep::new(&rig.document.calibration, landmarks, options);
    Ok(Box::new(step))
}

/// The definition of the latency step: tracker and camera latency.
pub(super) const LATENCY: StepDefinition = StepDefinition {
    name: "latency",
    title: "Latency",
    about: "Turn the rig briskly and unevenly to and fro for twenty seconds in a static scene; \
            markers in view reduce the uncertainty.",
    parameters: &[BOARD],
    make: latency,
};

fn latency(parameters: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let options = LatencyOptions {
        station: station(&rig.config),
        range: MAX_OFFSET_SECONDS,
    };
    let landmarks = landmarks(parameters, rig)?;
    let step = LatencyStep::new(&rig.document.calibration, landmarks, options);
    Ok(Box::new(step))
}

/// The definition of the environment step: pose and lens of the environment camera.
pub(super) const ENVIRONMENT: StepDefinition = StepDefinition {
    name: "environment",
    title: "Environment camera",
    about: "Let both cameras see the same markers or bright lights, and move the scene camera \
            around.",
    parameters: &[
        ParameterForm {
            name: "kind",
            label: "Kind",
            hint: "Kind of environment camera.",
            default: "rig",
            choices: &[
                ("rig", "As in rig.json"),
                ("fisheye", "Fisheye"),
                ("sphere", "Mirrored sphere"),
            ],
        },
        ParameterForm {
            name: "fov",
            label: "Field of view",
            hint: "Field of view of the fisheye, degrees; empty for that in rig.json, else 180.",
            default: "",
            choices: &[],
        },
    ],
    make: environment,
};

fn environment(parameters: &Parameters, rig: &RigContext) -> Result<Box<dyn Step>, ParameterError> {
    let fov = number(parameters, "fov", 10.0, 360.0)?;
    let asked = EnvironmentOptions {
        kind: match parameters.text("kind") {
            "fisheye" => Some(EnvironmentCameraKind::Fisheye),
            "sphere" => Some(EnvironmentCameraKind::Sphere),
            _ => None,
        },
        fov: fov.map(f64::to_radians),
        ..EnvironmentOptions::default()
    };
    let not_ready = |reason: String| ParameterError::RigNotReady { reason };
    let record = rig.files.get(ENVIRONMENT_LENS);
    let record = record.map(|bytes| LensRecord::parse(ENVIRONMENT_LENS, bytes));
    let lens = record.map(|record| record.and_then(|record| record.lens(ENVIRONMENT_LENS)));
    let known = KnownRig {
        rig: rig.document.clone(),
        lens: lens
            .transpose()
            .map_err(|error| not_ready(error.to_string()))?,
    };
    let step = EnvironmentStep::new(known, asked).map_err(|error| not_ready(error.to_string()))?;
    Ok(Box::new(step))
}

/// Returns the board of the parameters, else the rig's markers; `None` if it has none.
fn landmarks(
    parameters: &Parameters,
    rig: &RigContext,
) -> Result<Option<Landmarks>, ParameterError> {
    let text = parameters.text("board");
    if !text.is_empty() {
        let board = Board::parse(text);
        let board = board.map_err(|error| parameters.invalid("board", error.to_string()))?;
        return match board {
            Board::Chess { .. } => Ok(Some(Landmarks::Board(board))),
            _ => Err(parameters.invalid("board", "name a chessboard: chess:9x6:0.025".to_owned())),
        };
    }
    if rig.document.markers.is_empty() {
        return Ok(None);
    }
    let map = tag_map(&rig.document.markers).map_err(|error| ParameterError::RigNotReady {
        reason: error.to_string(),
    })?;
    Ok(Some(Landmarks::Tags(map)))
}

/// Returns a parameter as a number from `min` to `max`; `None` if it is empty.
fn number(
    parameters: &Parameters,
    name: &'static str,
    min: f64,
    max: f64,
) -> Result<Option<f64>, ParameterError> {
    let text = parameters.text(name);
    if text.is_empty() {
        return Ok(None);
    }
    let value = text.parse::<f64>().ok();
    let value = value.filter(|v| (min..=max).contains(v));
    value.map(Some).ok_or_else(|| {
        parameters.invalid(
            name,
            format!("expected a number from {min} to {max}, or an empty field"),
        )
    })
}
