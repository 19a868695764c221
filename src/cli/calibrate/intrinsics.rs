//! `penumbra calibrate intrinsics`.

use super::args::{OutputArgs, show_progress};
use crate::cli::files::{claim, write};
use anyhow::bail;
use clap::{Args, ValueEnum};
use penumbra_calibration::intrinsics::{Board, IntrinsicsStep, KnownLenses, Options};
use penumbra_calibration::step::{CameraRole, Step};
use penumbra_camera::LensModel;
use penumbra_rig::calibration_runner::{FolderPicture, for_each_picture};
use penumbra_rig_model::RigDocument;
use penumbra_session::Session;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

// The rig reads calibration/scene_camera.json and calibration/environment_camera.json beside
// rig.json.
#[derive(Debug, Args)]
pub struct IntrinsicsArgs {
    /// A recording of the board; without it and --pictures the live rig's camera
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// A folder of pictures (JPEG, PNG) of one camera instead
    #[arg(long, value_name = "DIR", conflicts_with = "session")]
    pictures: Option<PathBuf>,
    /// The board as measured on the print: chess:9x6:0.025 (inner corners, square in metres),
    /// aprilgrid:6x6:0.088:0.3 (tags, tag in metres, gap as a share of it) or
    /// charuco:8x5:0.03:0.022:4x4_50 (squares, square and marker in metres, dictionary)
    #[arg(long, value_name = "BOARD", value_parser = super::dictionary::board)]
    board: Board,
    /// Camera to calibrate
    #[arg(long, value_enum, default_value_t = Camera::Scene)]
    camera: Camera,
    /// Lens model; without it as in rig.json, else brown for the scene camera and fisheye for the
    /// environment camera
    #[arg(long, value_enum)]
    model: Option<Model>,
    /// Let fx and fy differ
    #[arg(long)]
    free_aspect: bool,
    /// Also write all detected corners: view, position on the board in metres, pixel
    #[arg(long, value_name = "FILE.csv")]
    corners: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Camera {
    Scene,
    Environment,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Model {
    /// Brown-Conrady: k1, k2, p1, p2, k3
    Brown,
    /// With a denominator: k4, k5, k6; for conversion only, the compositor does not support it
    BrownRational,
    /// Kannala-Brandt: k1 to k4
    Fisheye,
}

impl IntrinsicsArgs {
    const fn role(&self) -> CameraRole {
        match self.camera {
            Camera::Scene => CameraRole::Scene,
            Camera::Environment => CameraRole::Environment,
        }
    }

    /// Creates the step; `present_lenses` are the lenses in rig.json.
    fn step(&self, present_lenses: KnownLenses) -> IntrinsicsStep {
        let default_model = match present_lenses.lens(self.role()) {
            Some(lens) if lens.fisheye => Model::Fisheye,
            Some(_) => Model::Brown,
            None if self.camera == Camera::Environment => Model::Fisheye,
            None => Model::Brown,
        };
        let options = Options {
            model: match self.model.unwrap_or(default_model) {
                Model::Brown => LensModel::Brown,
                Model::BrownRational => LensModel::BrownRational,
                Model::Fisheye => LensModel::KannalaBrandt,
            },
            square_pixels: !self.free_aspect,
        };
        IntrinsicsStep::new(self.role(), self.board, options, present_lenses)
    }

    fn run_on_session(&self, path: &Path) -> anyhow::Result<ExitCode> {
        let session = Session::open(path)?;
        if self.camera == Camera::Environment && !session.has_environment() {
            bail!(
                "{}: has no pictures of an environment camera",
                path.display()
            );
        }
        // Without a rig.json there is no lens to compare with.
        let rig = RigDocument::from_session(&|name: &str| session.attachment(name)).ok();
        let present_lenses = rig
            .as_ref()
            .map_or_else(KnownLenses::default, KnownLenses::from_rig);
        let step = self.step(present_lenses);
        let mut step = match &rig {
            Some(rig) => step.with_rig(rig),
            None => step,
        };
        self.with_corners(&mut step, |step| {
            self.output.run_step(Some(path), None, step)
        })
    }

    /// Runs the step and writes the corners, also if the lens is refused: they show why.
    fn with_corners(
        &self,
        step: &mut IntrinsicsStep,
        run: impl FnOnce(&mut IntrinsicsStep) -> anyhow::Result<ExitCode>,
    ) -> anyhow::Result<ExitCode> {
        if let Some(path) = &self.corners {
            claim(path, self.output.force)?;
        }
        let outcome = run(step);
        if let Some(path) = &self.corners {
            write(path, step.corners().as_bytes(), self.output.force)?;
        }
        outcome
    }

    fn run_on_folder(&self, folder: &Path) -> anyhow::Result<ExitCode> {
        let mut step = self.step(KnownLenses::default());
        let source = folder.display().to_string();
        self.with_corners(&mut step, |step| {
            self.output.run_step_with(&source, step, |step, line| {
                Ok(for_each_picture(folder, |file: FolderPicture| {
                    step.add_picture(&file.name, file.picture);
                    show_progress(line, file.share, &step.progress());
                })?)
            })
        })
    }
}

pub fn run(args: &IntrinsicsArgs) -> anyhow::Result<ExitCode> {
    match (&args.session, &args.pictures) {
        (Some(session), _) => args.run_on_session(session),
        (None, Some(folder)) => args.run_on_folder(folder),
        (None, None) => {
            let present_lenses = KnownLenses::from_rig(&args.output.rig()?);
            let mut step = args.step(present_lenses);
            args.output.run_step(None, None, &mut step)
        }
    }
}
