//! `penumbra calibrate intrinsics`.

use crate::cli::files::{JsonFile, claim, write};
use anyhow::bail;
use clap::{Args, ValueEnum};
use indicatif::{ProgressBar, ProgressStyle};
use penumbra::calibration::intrinsics::report::html;
use penumbra::calibration::intrinsics::{
    Board, Gatherer, Grade, Grey, Judged, LensModel, Offer, Options, Outcome,
};
use penumbra::calibration::record::{DeviceRecord, LensRecord};
use penumbra::config::Config;
use penumbra::rig::calibrate::{Looked, pictures_of_folder, pictures_of_session};
use penumbra::rig::wall_date::iso_now;
use penumbra::session::{Camera, Session};
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct IntrinsicsArgs {
    /// A recording in which the board is held before the camera
    #[arg(
        long,
        value_name = "SESSION.mcap",
        required_unless_present = "pictures"
    )]
    session: Option<PathBuf>,
    /// Instead, a folder of pictures (JPEG, PNG) of one camera
    #[arg(long, value_name = "DIR", conflicts_with = "session")]
    pictures: Option<PathBuf>,
    /// Inner corners and square in metres, as measured on the print
    #[arg(long, value_name = "chess:9x6:0.025", value_parser = Board::parse)]
    board: Board,
    /// Which camera
    #[arg(long, value_enum, default_value_t = Which::Scene)]
    camera: Which,
    /// How the lens bends light; without it brown for the scene camera, fisheye for the other
    #[arg(long, value_enum)]
    model: Option<Model>,
    /// Let fx and fy differ
    #[arg(long)]
    free_aspect: bool,
    /// The camera's name, to be noted
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Its serial number, to be noted
    #[arg(long, value_name = "TEXT", requires = "device")]
    serial: Option<String>,
    /// The calibration; beside it the report, as .html. The rig reads
    /// calibration/scene_camera.json and calibration/environment_camera.json beside rig.json
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write over files that are there
    #[arg(long)]
    force: bool,
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
    /// With a denominator: k4, k5, k6; for exchange only, the compositor does not draw it
    BrownRational,
    /// Kannala-Brandt: k1 to k4
    Fisheye,
}

impl IntrinsicsArgs {
    fn options(&self) -> Options {
        let usual = match self.camera {
            Which::Scene => Model::Brown,
            Which::Environment => Model::Fisheye,
        };
        Options {
            model: match self.model.unwrap_or(usual) {
                Model::Brown => LensModel::Brown,
                Model::BrownRational => LensModel::BrownRational,
                Model::Fisheye => LensModel::KannalaBrandt,
            },
            square_pixels: !self.free_aspect,
        }
    }

    fn camera_name(&self) -> &'static str {
        match self.camera {
            Which::Scene => "scene",
            Which::Environment => "environment",
        }
    }

    fn source(&self) -> String {
        let path = self.session.as_ref().or(self.pictures.as_ref());
        path.map_or_else(String::new, |p| p.display().to_string())
    }
}

pub fn run(args: &IntrinsicsArgs) -> anyhow::Result<ExitCode> {
    if !matches!(args.board, Board::Chess { .. }) {
        bail!(
            "--board {}: only chessboards are found in pictures yet",
            args.board
        );
    }
    let report = args.out.with_extension("html");
    if report == args.out {
        bail!(
            "{}: the report goes to the .html beside it; name a .json file",
            args.out.display()
        );
    }
    let file = JsonFile::claim(&args.out, args.force)?;
    claim(&report, args.force)?;
    let gatherer = gather(args)?;
    let outcome = gatherer.finish(&args.options());
    let date = iso_now();
    let lines = [
        format!("{date}, from {}", args.source()),
        format!("board {}", args.board),
    ];
    let title = format!("Lens of the {} camera", args.camera_name());
    let page = html(&outcome, gatherer.views(), &title, &lines);
    write(&report, page.as_bytes(), args.force)?;
    tell(&outcome);
    crate::cli::say(format_args!("report: {}", report.display()));
    if outcome.verdict.grade == Grade::Refused {
        // What is not there cannot be used by mistake.
        bail!(
            "refused: no calibration was written; {}",
            first_reason(&outcome)
        );
    }
    let record = LensRecord::of(&outcome, args.camera_name(), &args.board.to_string(), date);
    if let Some(record) = record {
        file.write(&LensRecord {
            device: args.device.as_ref().map(|name| DeviceRecord {
                name: name.clone(),
                serial: args.serial.clone(),
            }),
            source: args.source(),
            ..record
        })?;
        crate::cli::say(format_args!("calibration: {}", args.out.display()));
    }
    Ok(ExitCode::SUCCESS)
}

fn gather(args: &IntrinsicsArgs) -> anyhow::Result<Gatherer> {
    let mut gatherer = Gatherer::new(args.board);
    let bar = progress_bar();
    let look = |looked: Looked| {
        let grey = Grey::from_picture(looked.picture);
        let offer = gatherer.offer(&looked.name, &grey);
        bar.set_position((1000.0 * looked.share) as u64);
        bar.set_message(match offer {
            Offer::Taken { points } => {
                format!("{} views, {points} corners", gatherer.views().len())
            }
            Offer::Alike => format!("{} views; move on: seen already", gatherer.views().len()),
            Offer::NotSeen => format!("{} views; no board", gatherer.views().len()),
            Offer::OtherBoard => format!("{} views; a larger board", gatherer.views().len()),
            Offer::OtherSize => format!("{} views; another size", gatherer.views().len()),
        });
    };
    let damaged = if let Some(path) = &args.session {
        let session = Session::open(path)?;
        let camera = match args.camera {
            Which::Scene => Camera::Scene,
            Which::Environment => Camera::Environment,
        };
        if camera == Camera::Environment && !session.has_environment() {
            bail!(
                "{}: has no pictures of an environment camera",
                path.display()
            );
        }
        pictures_of_session(&session, camera, &Config::default(), look)?
    } else {
        let folder = args.pictures.clone().unwrap_or_default();
        pictures_of_folder(&folder, look)?
    };
    bar.finish_and_clear();
    if damaged > 0 {
        crate::cli::warn(format_args!("{damaged} damaged pictures were passed over"));
    }
    Ok(gatherer)
}

fn tell(outcome: &Outcome) {
    crate::cli::say(format_args!(
        "{}: {} pictures, {} views",
        outcome.verdict.grade.name(),
        outcome.pictures,
        outcome.views
    ));
    if let Some(judged) = &outcome.result {
        tell_lens(judged);
    }
    for (grade, finding) in &outcome.verdict.findings {
        crate::cli::say(format_args!("  {}: {finding}", grade.name()));
    }
    for hint in &outcome.verdict.hints {
        crate::cli::say(format_args!("  next: {hint}"));
    }
}

fn tell_lens(judged: &Judged) {
    let (estimate, sigma) = (&judged.estimate, &judged.estimate.sigma);
    let lens = &estimate.lens;
    crate::cli::say(format_args!(
        "  reprojection {:.3} px RMS; f {:.2} ± {:.2}, {:.2} ± {:.2} px; centre {:.2} ± {:.2}, {:.2} ± {:.2} px",
        estimate.rms,
        lens.focal.x,
        sigma[0],
        lens.focal.y,
        sigma[1],
        lens.centre.x,
        sigma[2],
        lens.centre.y,
        sigma[3]
    ));
    let names = lens.model.coefficients();
    let coefficients: Vec<String> = names
        .iter()
        .zip(lens.coefficients)
        .zip(&sigma[4..])
        .map(|((name, value), sigma)| format!("{name} {value:.5} ± {sigma:.5}"))
        .collect();
    crate::cli::say(format_args!("  {}", coefficients.join(", ")));
    crate::cli::say(format_args!(
        "  corners in {:.0} % of the picture; a direction's picture is known to {:.2} px in the middle of all, {:.2} px at worst (1σ)",
        100.0 * judged.coverage.share,
        judged.uncertainty.median,
        judged.uncertainty.worst
    ));
}

fn first_reason(outcome: &Outcome) -> String {
    let first = outcome.verdict.findings.first();
    first.map_or_else(String::new, |f| f.1.to_string())
}

/// Hidden by indicatif where standard error is no terminal.
fn progress_bar() -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent} % {msg}") {
        bar.set_style(style);
    }
    bar
}
