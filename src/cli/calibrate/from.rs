//! Common to the steps of `penumbra calibrate`: the source of pictures and poses, progress, the
//! printed result, and the written files.

use super::live::{self, LiveArgs};
use crate::cli::files::{claim, write};
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use penumbra_calibration::step::{Finished, Made, Progress, Step};
use penumbra_config::Config;
use penumbra_rig::RigFiles;
use penumbra_rig::calibration_runner::files::{calibration_folder, prepare, write_calibration};
use penumbra_rig::calibration_runner::steps::{Known, file_of};
use penumbra_rig::calibration_runner::{Written, show_session};
use penumbra_rig::wall_date::iso_now;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;
use penumbra_session::Session;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct FromArgs {
    /// A recording; without it the live rig
    #[arg(long, value_name = "SESSION.mcap")]
    pub session: Option<PathBuf>,
    /// A rig.json, or a folder with rig.json and calibration/NAME.json; they replace those in the
    /// recording
    #[arg(long, value_name = "rig.json|DIR", requires = "session")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    pub to: ToArgs,
}

// Output options of a step. (Not a docstring: clap would use it as the help of the command.)
#[derive(Debug, Args)]
pub struct ToArgs {
    /// Settings
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    live: LiveArgs,
    /// Device name to note in the file; on a live rig the device's own by default
    #[arg(long, value_name = "NAME")]
    device: Option<String>,
    /// Serial number to note in the file
    #[arg(long, value_name = "TEXT", requires = "device")]
    serial: Option<String>,
    /// Calibration file; the report is written beside it as .html. On a live rig the default is the
    /// rig's folder ([calibration] from), where existing files are kept under their date
    #[arg(long, value_name = "FILE.json", required_unless_present = "config")]
    pub out: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
}

/// Destination of a calibration.
enum Destination {
    /// Files named on the command line.
    Named { out: PathBuf, report: PathBuf },
    /// The rig's files, where an existing file is kept under its date.
    Rig { folder: PathBuf, name: String },
}

impl FromArgs {
    /// Reads the configuration; the default without `--config`.
    pub fn config(&self) -> anyhow::Result<Config> {
        self.to.config()
    }

    /// Reads the known calibration of the rig, of the recording or the live one.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        if self.session.is_none() {
            return self.to.rig();
        }
        let files = self.files()?;
        Ok(RigDocument::of_session(&|name: &str| files.get(name))?)
    }

    /// Reads the rig's files: those of the recording, replaced by those of `--rig`; on a live rig
    /// those that the configuration names.
    pub fn files(&self) -> anyhow::Result<RigFiles> {
        Ok(match &self.session {
            Some(path) => match &self.rig {
                Some(newer) => RigFiles::at(path)?.with(newer_files(newer)?),
                None => RigFiles::at(path)?,
            },
            None => RigFiles::load(&self.config()?)?,
        })
    }

    /// Runs `step` on the recording or the live rig, prints its result and writes its files.
    pub fn carry_out(&self, step: &mut dyn Step) -> anyhow::Result<ExitCode> {
        let tracker = self.rig().ok().and_then(|rig| rig.calibration.tracker);
        let metres = tracker.map(|tracker| tracker.metres_per_unit);
        self.to.carry_out(self.session.as_deref(), metres, step)
    }
}

impl ToArgs {
    /// Reads the configuration; the default without `--config`.
    pub fn config(&self) -> anyhow::Result<Config> {
        Ok(match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        })
    }

    /// Reads the known calibration of the live rig.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        Ok(Known::read(&self.config()?)?.document)
    }

    /// Runs `step` on `session`, or on the live rig without one. `metres_per_unit` is the tracker's
    /// unit, if it is known.
    pub fn carry_out(
        &self,
        session: Option<&Path>,
        metres_per_unit: Option<f64>,
        step: &mut dyn Step,
    ) -> anyhow::Result<ExitCode> {
        let config = self.config()?;
        let Some(path) = session else {
            let destination = self.destination(step, true)?;
            let noted = (self.device.as_ref(), self.serial.as_ref());
            let found = live::carry_out(step, &config, &self.live, noted)?;
            return self.conclude(step.name(), &found, &destination);
        };
        self.carry_out_by(&path.display().to_string(), step, |step, bar| {
            let session = Session::open(path)?;
            let report = |share: f64, progress: &Progress| show_progress(bar, share, progress);
            Ok(show_session(
                &session,
                &config,
                metres_per_unit,
                step,
                report,
            )?)
        })
    }

    /// Runs `step` on the data that `show` gives it. `show` returns the number of damaged pictures.
    pub fn carry_out_by<S: Step + ?Sized>(
        &self,
        source: &str,
        step: &mut S,
        show: impl FnOnce(&mut S, &ProgressBar) -> anyhow::Result<usize>,
    ) -> anyhow::Result<ExitCode> {
        let destination = self.destination(step, false)?;
        let bar = progress_bar();
        let damaged = show(step, &bar)?;
        bar.finish_and_clear();
        if damaged > 0 {
            crate::cli::warn(format_args!("{damaged} damaged pictures were skipped"));
        }
        let found = step.finish(&Made {
            date: iso_now(),
            source: source.to_owned(),
            device: self.device.clone(),
            serial: self.serial.clone(),
        });
        self.conclude(step.name(), &found, &destination)
    }

    /// Chooses the destination and checks that it can be written, before the step runs.
    fn destination<S: Step + ?Sized>(&self, step: &S, live: bool) -> anyhow::Result<Destination> {
        let Some(out) = &self.out else {
            if !live {
                bail!("name the calibration to be written with --out FILE.json");
            }
            let config = self.config()?;
            let folder = calibration_folder(&config)
                .map_err(|error| anyhow!("{error}, or name a file with --out"))?;
            let name = file_of(step);
            prepare(folder, &name)?;
            let folder = folder.to_owned();
            return Ok(Destination::Rig { folder, name });
        };
        let report = out.with_extension("html");
        if report == *out {
            bail!(
                "{}: the report goes to the .html beside it; name a .json file",
                out.display()
            );
        }
        claim(out, self.force)?;
        claim(&report, self.force)?;
        let out = out.clone();
        Ok(Destination::Named { out, report })
    }

    /// Prints the result and writes its files. A refused calibration is an error.
    fn conclude(
        &self,
        step: &str,
        found: &Finished,
        destination: &Destination,
    ) -> anyhow::Result<ExitCode> {
        print_result(found);
        let written = self.write(step, found, destination)?;
        let what = match step {
            "verify" => "check",
            _ => "calibration",
        };
        for (what, path) in [
            ("report", &written.report),
            (what, &written.file),
            ("previous file", &written.backup),
        ] {
            if let Some(path) = path {
                crate::cli::say(format_args!("{what}: {}", path.display()));
            }
        }
        if found.grade != Grade::Refused {
            return Ok(ExitCode::SUCCESS);
        }
        let why = found.findings.first().map_or("", |f| f.1.as_str());
        match written.file {
            Some(_) => bail!("refused: {why}"),
            // A refused calibration writes no file, so that it cannot be used by mistake.
            None => bail!("refused: no calibration was written; {why}"),
        }
    }

    fn write(
        &self,
        step: &str,
        found: &Finished,
        destination: &Destination,
    ) -> anyhow::Result<Written> {
        let (out, report) = match destination {
            Destination::Rig { folder, name } => {
                return Ok(write_calibration(folder, name, found)?);
            }
            Destination::Named { out, report } => (out, report),
        };
        write(report, found.page.as_bytes(), self.force)?;
        // The result of a check is written even if it is bad.
        let kept = found.grade != Grade::Refused || step == "verify";
        let file = found.file.as_ref().filter(|_| kept);
        if let Some(file) = file {
            write(out, file.as_bytes(), self.force)?;
        }
        Ok(Written {
            file: file.map(|_| out.clone()),
            backup: None,
            report: Some(report.clone()),
        })
    }
}

/// Reads the files of `--rig`: those of a folder or a session, or one `rig.json` of any name.
fn newer_files(path: &Path) -> anyhow::Result<RigFiles> {
    let is_json = path
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("json"));
    if is_json && path.is_file() {
        let files = RigFiles::from_rig_json(path);
        return files.with_context(|| format!("{}: cannot be read", path.display()));
    }
    Ok(RigFiles::at(path)?)
}

/// Shows the progress of a step on the bar; `share` is the share of the recording, 0..=1.
pub fn show_progress(bar: &ProgressBar, share: f64, progress: &Progress) {
    bar.set_position((1000.0 * share) as u64);
    bar.set_message(match progress.hint.as_str() {
        "" => progress.message.clone(),
        hint => format!("{}; {hint}", progress.message),
    });
}

/// Prints grade, figures, findings and hints.
fn print_result(found: &Finished) {
    crate::cli::say(format_args!("{}", found.grade.name()));
    for line in &found.lines {
        crate::cli::say(format_args!("  {line}"));
    }
    for (grade, finding) in &found.findings {
        crate::cli::say(format_args!("  {}: {finding}", grade.name()));
    }
    for hint in &found.hints {
        crate::cli::say(format_args!("  next: {hint}"));
    }
}

/// Creates a progress bar of 1000 steps. indicatif hides it if standard error is not a terminal.
pub fn progress_bar() -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent} % {msg}") {
        bar.set_style(style);
    }
    bar
}
