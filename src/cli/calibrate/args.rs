//! The common arguments of the steps of `penumbra calibrate`: input, output, and running a step.

use super::live::{self, LiveArgs};
use crate::cli::files::{claim, write};
use crate::cli::progress::Progress as Line;
use anyhow::{Context as _, anyhow, bail};
use clap::Args;
use penumbra_calibration::step::{CalibrationProvenance, Finished, Progress, Step};
use penumbra_config::Config;
use penumbra_rig::RigFiles;
use penumbra_rig::calibration_runner::files::{
    WrittenFiles, calibration_folder, prepare, write_calibration,
};
use penumbra_rig::calibration_runner::steps::calibration_file_name;
use penumbra_rig::calibration_runner::{RigContext, feed_session};
use penumbra_rig::wall_date::iso_now;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;
use penumbra_session::Session;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

#[derive(Debug, Args)]
pub struct InputArgs {
    /// A recording; without it the live rig
    #[arg(long, value_name = "SESSION.mcap")]
    pub session: Option<PathBuf>,
    /// A rig.json, or a folder with rig.json and calibration/NAME.json; they replace those in the
    /// recording
    #[arg(long, value_name = "rig.json|DIR", requires = "session")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    pub output: OutputArgs,
}

// Output files and device notes. (Not a docstring, which clap would show as the command's help.)
#[derive(Debug, Args)]
pub struct OutputArgs {
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
    /// rig's folder (`[calibration] from`), where existing files are kept under their date
    #[arg(long, value_name = "FILE.json", required_unless_present = "config")]
    pub out: Option<PathBuf>,
    /// Overwrite existing files
    #[arg(long)]
    pub force: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

/// Destination of a calibration.
enum Destination {
    /// The file of `--out`.
    Named { out: PathBuf, report: PathBuf },
    /// The folder of the rig's files.
    Rig { folder: PathBuf, name: String },
}

impl InputArgs {
    /// Reads the configuration.
    pub fn config(&self) -> anyhow::Result<Config> {
        self.output.config()
    }

    /// Reads the rig's known calibration.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        if self.session.is_none() {
            return self.output.rig();
        }
        let files = self.files()?;
        Ok(RigDocument::from_session(&|name: &str| files.get(name))?)
    }

    /// Returns the rig's files: those in the recording, or those of the configuration.
    pub fn files(&self) -> anyhow::Result<RigFiles> {
        Ok(match &self.session {
            Some(path) => match &self.rig {
                Some(newer) => RigFiles::at(path)?.with(newer_files(newer)?),
                None => RigFiles::at(path)?,
            },
            None => RigFiles::load(&self.config()?)?,
        })
    }

    /// Runs `step` on the recording or the live rig, shows its progress, and prints and writes its
    /// result.
    pub fn run_step(&self, step: &mut dyn Step) -> anyhow::Result<ExitCode> {
        let tracker = self.rig().ok().and_then(|rig| rig.calibration.tracker);
        let metres = tracker.map(|tracker| tracker.metres_per_unit);
        self.output.run_step(self.session.as_deref(), metres, step)
    }
}

impl OutputArgs {
    /// Reads the configuration; the default without `--config`.
    pub fn config(&self) -> anyhow::Result<Config> {
        Ok(match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        })
    }

    /// Reads the live rig's known calibration.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        Ok(RigContext::read(&self.config()?)?.document)
    }

    /// Like [`InputArgs::run_step`]; `metres_per_unit` is the tracker's unit of length, if known.
    pub fn run_step(
        &self,
        session: Option<&Path>,
        metres_per_unit: Option<f64>,
        step: &mut dyn Step,
    ) -> anyhow::Result<ExitCode> {
        let config = self.config()?;
        let Some(path) = session else {
            let destination = self.destination(step, true)?;
            let device_note = (self.device.as_ref(), self.serial.as_ref());
            let found = live::run_step(step, &config, &self.live, device_note)?;
            return self.conclude(step.name(), &found, &destination);
        };
        self.run_step_with(&path.display().to_string(), step, |step, line| {
            let session = Session::open(path)?;
            let report = |share: f64, progress: &Progress| show_progress(line, share, progress);
            Ok(feed_session(
                &session,
                &config,
                metres_per_unit,
                step,
                report,
            ))
        })
    }

    /// Runs `step` on the input that `feed` passes to it, and prints and writes its result. `feed`
    /// returns the number of damaged pictures.
    pub fn run_step_with<S: Step + ?Sized>(
        &self,
        source: &str,
        step: &mut S,
        feed: impl FnOnce(&mut S, &Line) -> anyhow::Result<usize>,
    ) -> anyhow::Result<ExitCode> {
        let destination = self.destination(step, false)?;
        let line = Line::new(step.name());
        let damaged = feed(step, &line)?;
        line.finish();
        if damaged > 0 {
            crate::cli::warn(format_args!("{damaged} damaged pictures were skipped"));
        }
        let found = step.finish(&CalibrationProvenance {
            date: iso_now(),
            source: source.to_owned(),
            device: self.device.clone(),
            serial: self.serial.clone(),
        });
        self.conclude(step.name(), &found, &destination)
    }

    /// Determines the destination, and checks before the step runs that it can be written.
    fn destination<S: Step + ?Sized>(&self, step: &S, live: bool) -> anyhow::Result<Destination> {
        let Some(out) = &self.out else {
            if !live {
                bail!("name the calibration file with --out FILE.json");
            }
            let config = self.config()?;
            let folder = calibration_folder(&config)
                .map_err(|error| anyhow!("{error}, or name a file with --out"))?;
            let name = calibration_file_name(step);
            prepare(folder, &name)?;
            let folder = folder.to_owned();
            return Ok(Destination::Rig { folder, name });
        };
        let report = out.with_extension("html");
        if report == *out {
            bail!(
                "{}: is the name of the report; name a .json file",
                out.display()
            );
        }
        claim(out, self.force)?;
        claim(&report, self.force)?;
        let out = out.clone();
        Ok(Destination::Named { out, report })
    }

    /// Prints and writes the result. A refused result is an error.
    fn conclude(
        &self,
        step: &str,
        found: &Finished,
        destination: &Destination,
    ) -> anyhow::Result<ExitCode> {
        let written = if self.json {
            let written = self.write(step, found, destination)?;
            crate::cli::say(serde_json::to_string_pretty(&result(found, &written))?);
            written
        } else {
            print_result(found);
            let written = self.write(step, found, destination)?;
            print_files(step, &written);
            written
        };
        if found.grade != Grade::Refused {
            return Ok(ExitCode::SUCCESS);
        }
        let why = found.findings.first().map_or("", |f| f.1.as_str());
        match written.file {
            Some(_) => bail!("refused: {why}"),
            None => bail!("refused: no calibration was written; {why}"),
        }
    }

    fn write(
        &self,
        step: &str,
        found: &Finished,
        destination: &Destination,
    ) -> anyhow::Result<WrittenFiles> {
        let (out, report) = match destination {
            Destination::Rig { folder, name } => {
                return Ok(write_calibration(folder, name, found)?);
            }
            Destination::Named { out, report } => (out, report),
        };
        // The result of a verification is written whatever its grade; a refused calibration must
        // not be used by mistake.
        let is_written = found.grade != Grade::Refused || step == "verify";
        let file = found.file.as_ref().filter(|_| is_written);
        let Some(file) = file else {
            // Under a name of its own, which the next try may replace.
            let report = out.with_extension("refused.html");
            write(&report, found.report.as_bytes(), true)?;
            return Ok(WrittenFiles {
                report: Some(report),
                ..WrittenFiles::default()
            });
        };
        write(report, found.report.as_bytes(), self.force)?;
        write(out, file.as_bytes(), self.force)?;
        Ok(WrittenFiles {
            file: Some(out.clone()),
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

/// Shows a step's progress; `share` is that of the input, 0 to 1.
pub fn show_progress(line: &Line, share: f64, progress: &Progress) {
    let text = match progress.hint.as_str() {
        "" => progress.message.clone(),
        hint => format!("{}; {hint}", progress.message),
    };
    line.show(share, &text);
}

/// Returns grade, results, findings, hints and files for scripts.
fn result(found: &Finished, written: &WrittenFiles) -> Value {
    let findings = found.findings.iter();
    let findings = findings.map(|(grade, text)| json!({ "grade": grade.name(), "text": text }));
    json!({
        "grade": found.grade.name(),
        "figures": found.lines,
        "findings": findings.collect::<Vec<_>>(),
        "next": found.hints,
        "file": written.file,
        "report": written.report,
        "backup": written.backup,
    })
}

/// Prints the names of the files.
fn print_files(step: &str, written: &WrittenFiles) {
    let what = match step {
        "verify" => "check",
        _ => "calibration",
    };
    for (what, path) in [
        ("report", &written.report),
        (what, &written.file),
        ("backup", &written.backup),
    ] {
        if let Some(path) = path {
            crate::cli::say(format_args!("{what}: {}", path.display()));
        }
    }
}

/// Prints grade, results, findings and hints.
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
