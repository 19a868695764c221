//! `penumbra calibrate radiometric`.

use super::args::{OutputArgs, show_progress};
use super::folder::{picture, pictures};
use crate::cli::progress::Progress as Line;
use anyhow::{Context as _, anyhow, bail};
use clap::{Args, ValueEnum};
use penumbra_calibration::radiometric::reference::Edition;
use penumbra_calibration::radiometric::step::{Radiometric, RadiometricOptions};
use penumbra_calibration::step::{CameraRole, PictureInput, Progress, Step as _, StepInput};
use penumbra_config::Config;
use penumbra_interface::MonotonicTime;
use penumbra_picture::{Picture, read_bounded};
use penumbra_rig::calibration_runner::{estimate_from_overlap, feed_session, radiometric_options};
use penumbra_rig_model::RigDocument;
use penumbra_session::Session;
use std::path::PathBuf;
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct RadiometricArgs {
    /// A recording: its pictures and the attached pictures of a chart; without it and without
    /// pictures the live rig
    #[arg(long, value_name = "SESSION.mcap")]
    session: Option<PathBuf>,
    /// The rig, if there is no session; without it both cameras are assumed to be sRGB
    #[arg(long, value_name = "rig.json", conflicts_with = "session")]
    rig: Option<PathBuf>,
    /// A picture of the chart by the scene camera (JPEG, PNG); may be given several times
    #[arg(long, value_name = "FILE")]
    scene_picture: Vec<PathBuf>,
    /// A picture of the chart by the environment camera
    #[arg(long, value_name = "FILE")]
    environment_picture: Vec<PathBuf>,
    /// Rectangle of a grey card in the scene camera's pictures
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    grey_scene: Option<[u32; 4]>,
    /// Rectangle of the grey card in the environment camera's pictures
    #[arg(long, value_name = "X,Y,W,H", value_parser = rectangle)]
    grey_environment: Option<[u32; 4]>,
    /// Folder of pictures of the static scene camera, one per --exposures, sorted by name
    #[arg(long, value_name = "DIR", requires = "exposures")]
    scene_series: Option<PathBuf>,
    /// The same for the environment camera
    #[arg(long, value_name = "DIR", requires = "exposures")]
    environment_series: Option<PathBuf>,
    /// Exposure times (times gain) of a series: 1/30,1/60,1/125 or 0.033,0.017
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = exposure)]
    exposures: Vec<f64>,
    /// Standard deviation of the exposure times, per cent
    #[arg(long, value_name = "PERCENT", default_value_t = 1.0)]
    exposure_tolerance: f64,
    /// A folder of pictures of an evenly lit wall by the scene camera
    #[arg(long, value_name = "DIR")]
    scene_flat: Option<PathBuf>,
    /// The same for the environment camera
    #[arg(long, value_name = "DIR")]
    environment_flat: Option<PathBuf>,
    /// Date of manufacture of the ColorChecker: its colours changed in November 2014
    #[arg(long, value_enum, default_value_t = ChartDate::After)]
    chart: ChartDate,
    #[command(flatten)]
    output: OutputArgs,
}

/// Date of manufacture of a ColorChecker.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ChartDate {
    /// 2005 to October 2014
    #[value(name = "2005")]
    Before,
    /// From November 2014 on
    #[value(name = "2014")]
    After,
}

fn rectangle(text: &str) -> Result<[u32; 4], String> {
    let numbers: Vec<u32> = text
        .split(',')
        .filter_map(|n| n.trim().parse().ok())
        .collect();
    <[u32; 4]>::try_from(numbers)
        .ok()
        .filter(|r| r[2] > 0 && r[3] > 0)
        .ok_or_else(|| "expected left, top, width, height in pixels, e.g. 310,200,60,60".to_owned())
}

fn exposure(text: &str) -> Result<f64, String> {
    let value = match text.trim().split_once('/') {
        Some((a, b)) => a
            .parse::<f64>()
            .ok()
            .zip(b.parse::<f64>().ok())
            .map(|(a, b)| a / b),
        None => text.trim().parse().ok(),
    };
    value
        .filter(|v| v.is_finite() && *v > 0.0)
        .ok_or_else(|| "expected seconds, e.g. 1/60 or 0.0167".to_owned())
}

pub fn run(args: &RadiometricArgs) -> anyhow::Result<ExitCode> {
    let session = args.session.as_deref().map(Session::open).transpose()?;
    let rig = rig(args, session.as_ref())?;
    let config = args.output.config()?;
    let mut step = Radiometric::new(options(args, rig.as_ref(), &config));
    if session.is_none() && !args.has_pictures() {
        return args.output.run_step(None, None, &mut step);
    }
    args.output
        .run_step_with(&args.source(), &mut step, |step, line| {
            let damaged = match &session {
                Some(session) => observe_session(session, &config, rig.as_ref(), step, line)?,
                None => 0,
            };
            for (camera, files) in [
                (CameraRole::Scene, &args.scene_picture),
                (CameraRole::Environment, &args.environment_picture),
            ] {
                for (i, file) in files.iter().enumerate() {
                    observe_picture(step, camera, &picture(file)?, i);
                }
            }
            observe_folders(args, step)?;
            Ok(damaged)
        })
}

impl RadiometricArgs {
    /// Returns whether the command names pictures.
    fn has_pictures(&self) -> bool {
        let folders = [
            &self.scene_series,
            &self.environment_series,
            &self.scene_flat,
            &self.environment_flat,
        ];
        !self.scene_picture.is_empty()
            || !self.environment_picture.is_empty()
            || folders.iter().any(|folder| folder.is_some())
    }

    /// Returns the source that is noted in the calibration.
    fn source(&self) -> String {
        let source = self.session.as_ref().or(self.scene_picture.first());
        source.map_or_else(|| "pictures".to_owned(), |p| p.display().to_string())
    }
}

/// Reads the known calibration; `None` if there is none.
fn rig(args: &RadiometricArgs, session: Option<&Session>) -> anyhow::Result<Option<RigDocument>> {
    if let Some(session) = session {
        return Ok(RigDocument::from_session(&|name: &str| session.attachment(name)).ok());
    }
    let Some(path) = &args.rig else {
        // Pictures from files are not assumed to come from the configured rig.
        let live = !args.has_pictures();
        return live.then(|| args.output.rig()).transpose();
    };
    let bytes = read_bounded(path, 16 << 20)
        .with_context(|| format!("{}: cannot be read", path.display()))?;
    let rig = RigDocument::parse(&bytes).map_err(|error| anyhow!("{}: {error}", path.display()))?;
    Ok(Some(rig))
}

fn options(
    args: &RadiometricArgs,
    rig: Option<&RigDocument>,
    config: &Config,
) -> RadiometricOptions {
    RadiometricOptions {
        edition: match args.chart {
            ChartDate::Before => Edition::Gmb2005,
            ChartDate::After => Edition::Xrite2014,
        },
        greys: [args.grey_scene, args.grey_environment],
        exposure_sigma: 0.01 * args.exposure_tolerance.clamp(0.01, 100.0),
        ..radiometric_options(rig.map(|rig| &rig.calibration), config)
    }
}

/// Observes the pictures of a session and its attached pictures of a chart. Returns the number of
/// damaged pictures.
fn observe_session(
    session: &Session,
    config: &Config,
    rig: Option<&RigDocument>,
    step: &mut Radiometric,
    line: &Line,
) -> anyhow::Result<usize> {
    if let Some(chart) = rig.and_then(|rig| rig.calibration.chart.as_ref()) {
        for (camera, name) in [
            (CameraRole::Scene, &chart.scene_picture),
            (CameraRole::Environment, &chart.environment_picture),
        ] {
            if let Some(bytes) = session.attachment(name) {
                let picture =
                    Picture::from_file_bytes(bytes).map_err(|error| anyhow!("{name}: {error}"))?;
                observe_picture(step, camera, &picture, 0);
            }
        }
    }
    let report = |share: f64, progress: &Progress| show_progress(line, share, progress);
    let damaged = feed_session(session, config, None, step, report);
    if let Some(estimates) = rig.and_then(|rig| estimate_from_overlap(session, config, rig)) {
        if let Some((gains, pairs)) = estimates.gains {
            step.add_scene_gains(gains, format!("{pairs} pairs of pictures"));
        }
        if let Some(fit) = estimates.vignetting {
            step.add_vignetting(CameraRole::Scene, fit);
        }
    }
    Ok(damaged)
}

/// Observes a single picture. Its time is far from those of all others, so that the step does not
/// estimate noise from a pair of pictures.
fn observe_picture(step: &mut Radiometric, camera: CameraRole, picture: &Picture, number: usize) {
    step.observe(&StepInput::Picture(PictureInput {
        camera,
        picture,
        captured_at: MonotonicTime::from_nanos(0),
        bracket_ev: 0.0,
        exposure: None,
        seconds: -1e6 + 100.0 * number as f64,
    }));
}

/// Observes the exposure series and the pictures of evenly lit walls.
fn observe_folders(args: &RadiometricArgs, step: &mut Radiometric) -> anyhow::Result<()> {
    for (camera, folder) in [
        (CameraRole::Scene, &args.scene_series),
        (CameraRole::Environment, &args.environment_series),
    ] {
        let Some(folder) = folder else { continue };
        let pictures = pictures(folder)?;
        if pictures.len() != args.exposures.len() {
            bail!(
                "{}: contains {} pictures, but --exposures lists {} times; give one for each \
                 picture, sorted by name",
                folder.display(),
                pictures.len(),
                args.exposures.len()
            );
        }
        let logs = args.exposures.iter().map(|e| e.ln());
        let series: Vec<(&Picture, f64)> = pictures.iter().zip(logs).collect();
        step.add_series(camera, &series);
    }
    for (camera, folder) in [
        (CameraRole::Scene, &args.scene_flat),
        (CameraRole::Environment, &args.environment_flat),
    ] {
        for picture in folder
            .as_deref()
            .map(pictures)
            .transpose()?
            .iter()
            .flatten()
        {
            step.add_flat(camera, picture);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_exposures_and_rectangles() {
        assert_eq!(exposure("1/50"), Ok(0.02));
        assert_eq!(exposure(" 0.5"), Ok(0.5));
        for wrong in ["1/0", "-1", "fast", ""] {
            assert!(exposure(wrong).is_err(), "{wrong}");
        }
        assert_eq!(rectangle("1, 2,30,40"), Ok([1, 2, 30, 40]));
        for wrong in ["1,2,3", "1,2,0,4", "a,b,c,d", "1,2,3,4,5"] {
            assert!(rectangle(wrong).is_err(), "{wrong}");
        }
    }
}
