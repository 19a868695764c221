//! The steps for which the rig is moved: map, tracker, latency; and the environment camera's.

use super::steps::{Known, ParameterError, Parameters, StepKind, station};
use crate::markers::tag_map;
use penumbra_calibration::environment_camera_calibration::{
    Asked, EnvironmentStep, Kind, KnownRig,
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

/// Nothing less is looked for, seconds.
const RANGE: f64 = 0.25;

const BOARD: ParameterForm = ParameterForm {
    name: "board",
    label: "Board",
    hint: "A chessboard that stands still, in place of the rig's markers: chess:9x6:0.025. Empty for markers.",
    default: "",
    choices: &[],
};

/// A map of tags.
pub(super) const MAP: StepKind = StepKind {
    name: "map",
    title: "Map of markers",
    about: "Let the scene camera see the markers from all sides, several at a time, until each was \
            seen with others.",
    parameters: &[
        ParameterForm {
            name: "size",
            label: "Size",
            hint: "Edge of the tags' black border in metres; empty where the rig knows them.",
            default: "",
            choices: &[],
        },
        ParameterForm {
            name: "origin",
            label: "Origin",
            hint: "Number of the tag at which a new world begins; empty to keep the rig's world.",
            default: "",
            choices: &[],
        },
        ParameterForm {
            name: "family",
            label: "Family",
            hint: "Of the tags.",
            default: "tag36h11",
            choices: &[],
        },
    ],
    make: map,
};

fn map(parameters: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let family = parameters.text("family").parse::<Family>();
    let family = family.map_err(|error| parameters.wrong("family", error.to_string()))?;
    let size = number(parameters, "size", 0.002, 5.0)?;
    let origin = match parameters.text("origin") {
        "" => None,
        text => Some(text.parse().map_err(|_| {
            parameters.wrong("origin", "expected a tag's number, or nothing".to_owned())
        })?),
    };
    let options = MapOptions {
        families: vec![family],
        size,
        origin,
        sizes: BTreeMap::new(),
    };
    let rig = &known.document;
    Ok(Box::new(MapStep::new(
        &rig.calibration,
        &rig.markers,
        options,
    )))
}

/// How the camera sits on the tracker.
pub(super) const TRACKER: StepKind = StepKind {
    name: "tracker",
    title: "Camera on the tracker",
    about: "Turn the rig about all its axes for half a minute, by 30° and more, markers or a board in \
            view.",
    parameters: &[
        BOARD,
        ParameterForm {
            name: "distortion",
            label: "Bent space",
            hint: "Learn how metal bends an electromagnetic tracker's space: move through all of it, \
                   for two minutes.",
            default: "no",
            choices: &[("no", "No"), ("yes", "Yes")],
        },
    ],
    make: tracker,
};

fn tracker(parameters: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let landmarks = landmarks(parameters, known)?.ok_or_else(|| ParameterError::Rig {
        reason: "the rig knows no markers; make a map of markers first, or name a board".to_owned(),
    })?;
    let options = MountingOptions {
        station: station(&known.config),
        latency: LatencyChoice::Estimate,
        distortion: parameters.text("distortion") == "yes",
        world_is_board: matches!(landmarks, Landmarks::Board(_)),
    };
    let rig = &known.document.calibration;
    Ok(Box::new(MountingStep::new(rig, landmarks, options)))
}

/// How late devices are.
pub(super) const LATENCY: StepKind = StepKind {
    name: "latency",
    title: "Latency",
    about: "Turn the rig briskly and unevenly to and fro for twenty seconds, the scene at rest; \
            markers in view make it surer.",
    parameters: &[BOARD],
    make: latency,
};

fn latency(parameters: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let options = LatencyOptions {
        station: station(&known.config),
        range: RANGE,
    };
    let landmarks = landmarks(parameters, known)?;
    let rig = &known.document.calibration;
    Ok(Box::new(LatencyStep::new(rig, landmarks, options)))
}

/// Where the environment camera stands.
pub(super) const ENVIRONMENT: StepKind = StepKind {
    name: "environment",
    title: "Environment camera",
    about: "Let both cameras see the same markers or bright lights, and carry the scene camera about.",
    parameters: &[
        ParameterForm {
            name: "kind",
            label: "Seen by",
            hint: "What the environment camera looks through, or at.",
            default: "rig",
            choices: &[
                ("rig", "As the rig says"),
                ("fisheye", "Fisheye"),
                ("sphere", "Mirrored sphere"),
            ],
        },
        ParameterForm {
            name: "fov",
            label: "Field of view",
            hint: "Of the fisheye, degrees; empty for what the rig says, else 180.",
            default: "",
            choices: &[],
        },
    ],
    make: environment,
};

fn environment(parameters: &Parameters, known: &Known) -> Result<Box<dyn Step>, ParameterError> {
    let fov = number(parameters, "fov", 10.0, 360.0)?;
    let asked = Asked {
        kind: match parameters.text("kind") {
            "fisheye" => Some(Kind::Fisheye),
            "sphere" => Some(Kind::Sphere),
            _ => None,
        },
        fov: fov.map(f64::to_radians),
        ..Asked::default()
    };
    let unready = |reason: String| ParameterError::Rig { reason };
    let record = known.files.get(ENVIRONMENT_LENS);
    let record = record.map(|bytes| LensRecord::parse(ENVIRONMENT_LENS, bytes));
    let lens = record.map(|record| record.and_then(|record| record.lens(ENVIRONMENT_LENS)));
    let rig = KnownRig {
        rig: known.document.clone(),
        lens: lens
            .transpose()
            .map_err(|error| unready(error.to_string()))?,
    };
    let step = EnvironmentStep::new(rig, asked).map_err(|error| unready(error.to_string()))?;
    Ok(Box::new(step))
}

/// A board that was named, else the rig's markers, if it has any.
fn landmarks(parameters: &Parameters, known: &Known) -> Result<Option<Landmarks>, ParameterError> {
    let text = parameters.text("board");
    if !text.is_empty() {
        let board = Board::parse(text);
        let board = board.map_err(|error| parameters.wrong("board", error.to_string()))?;
        return match board {
            Board::Chess { .. } => Ok(Some(Landmarks::Board(board))),
            _ => Err(parameters.wrong("board", "name a chessboard: chess:9x6:0.025".to_owned())),
        };
    }
    if known.document.markers.is_empty() {
        return Ok(None);
    }
    let map = tag_map(&known.document.markers).map_err(|error| ParameterError::Rig {
        reason: error.to_string(),
    })?;
    Ok(Some(Landmarks::Tags(map)))
}

/// A number of the form, or nothing.
fn number(
    parameters: &Parameters,
    name: &'static str,
    least: f64,
    most: f64,
) -> Result<Option<f64>, ParameterError> {
    let text = parameters.text(name);
    if text.is_empty() {
        return Ok(None);
    }
    let value = text.parse::<f64>().ok();
    let value = value.filter(|v| (least..=most).contains(v));
    value.map(Some).ok_or_else(|| {
        parameters.wrong(
            name,
            format!("expected a number from {least} to {most}, or nothing"),
        )
    })
}
