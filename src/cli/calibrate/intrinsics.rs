//! `penumbra calibrate intrinsics`.

use super::from::{ToArgs, show_progress};
use crate::cli::files::{claim, write};
use anyhow::bail;
use clap::{Args, ValueEnum};
use penumbra_calibration::intrinsics::{Board, IntrinsicsStep, Options, SaidLenses};
use penumbra_calibration::step::{Eye, Step};
use penumbra_camera::LensModel;
use penumbra_rig::calibration_runner::{Looked, pictures_of_folder};
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
    #[arg(long, value_name = "BOARD", value_parser = Board::parse)]
    board: Board,
    /// Camera to calibrate
    #[arg(long, value_enum, default_value_t = Which::Scene)]
    camera: Which,
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
    to: ToArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Which {
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
    const fn eye(&self) -> Eye {
        match self.camera {
            Which::Scene => Eye::Scene,
            Which::Environment => Eye::Environment,
        }
    }

    fn step(&self, said: SaidLenses) -> IntrinsicsStep {
        let default = match said.of_eye(self.eye()) {
            Some(lens) if lens.fisheye => Model::Fisheye,
            Some(_) => Model::Brown,
            None if self.camera == Which::Environment => Model::Fisheye,
            None => Model::Brown,
        };
        let options = Options {
            model: match self.model.unwrap_or(default) {
                Model::Brown => LensModel::Brown,
                Model::BrownRational => LensModel::BrownRational,
                Model::Fisheye => LensModel::KannalaBrandt,
            },
            square_pixels: !self.free_aspect,
        };
        IntrinsicsStep::new(self.eye(), self.board, options, said)
    }

    fn run_on_session(&self, path: &Path) -> anyhow::Result<ExitCode> {
        let session = Session::open(path)?;
        if self.camera == Which::Environment && !session.has_environment() {
            bail!(
                "{}: has no pictures of an environment camera",
                path.display()
            );
        }
        // The rig.json, if there is one, is compared with the result.
        let rig = RigDocument::of_session(&|name: &str| session.attachment(name)).ok();
        let said = rig
            .as_ref()
            .map_or_else(SaidLenses::default, SaidLenses::of);
        self.with_corners(&mut self.step(said), |step| {
            self.to.carry_out(Some(path), None, step)
        })
    }

    /// Runs the step and writes the corners, even if the lens is refused: they show why.
    fn with_corners(
        &self,
        step: &mut IntrinsicsStep,
        carry_out: impl FnOnce(&mut IntrinsicsStep) -> anyhow::Result<ExitCode>,
    ) -> anyhow::Result<ExitCode> {
        if let Some(path) = &self.corners {
            claim(path, self.to.force)?;
        }
        let done = carry_out(step);
        if let Some(path) = &self.corners {
            write(path, step.corners().as_bytes(), self.to.force)?;
        }
        done
    }

    fn run_on_folder(&self, folder: &Path) -> anyhow::Result<ExitCode> {
        let mut step = self.step(SaidLenses::default());
        let source = folder.display().to_string();
        self.with_corners(&mut step, |step| {
            self.to.carry_out_by(&source, step, |step, bar| {
                Ok(pictures_of_folder(folder, |looked: Looked| {
                    step.look_at(&looked.name, looked.picture);
                    show_progress(bar, looked.share, &step.progress());
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
            let said = SaidLenses::of(&args.to.rig()?);
            args.to.carry_out(None, None, &mut args.step(said))
        }
    }
}
