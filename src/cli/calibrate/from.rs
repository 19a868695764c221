//! What the steps of `penumbra calibrate` have in common: where their pictures and poses come
//! from, and what is told and written.

use super::live::{self, LiveArgs};
use crate::cli::files::{claim, write};
use anyhow::{anyhow, bail};
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
    /// Folder with newer calibration files (rig.json, calibration/NAME.json), which replace those in
    /// the recording
    #[arg(long, value_name = "DIR", requires = "session")]
    rig: Option<PathBuf>,
    #[command(flatten)]
    pub to: ToArgs,
}

// Where to, with what noted. (No docstring: clap would take it for the command's.)
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

/// Where a calibration goes.
enum Place {
    /// As it was typed.
    Named { out: PathBuf, report: PathBuf },
    /// Among the rig's files.
    Rig { folder: PathBuf, name: String },
}

impl FromArgs {
    /// The configuration.
    pub fn config(&self) -> anyhow::Result<Config> {
        self.to.config()
    }

    /// The rig's known calibration.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        if self.session.is_none() {
            return self.to.rig();
        }
        let files = self.files()?;
        Ok(RigDocument::of_session(&|name: &str| files.get(name))?)
    }

    /// The rig's files: those that the recording carries, or those of the configuration.
    pub fn files(&self) -> anyhow::Result<RigFiles> {
        Ok(match &self.session {
            Some(path) => match &self.rig {
                Some(newer) => RigFiles::at(path)?.with(RigFiles::at(newer)?),
                None => RigFiles::at(path)?,
            },
            None => RigFiles::load(&self.config()?)?,
        })
    }

    /// Shows `step` what it wants, tells how far it is, what it found, and writes that.
    pub fn carry_out(&self, step: &mut dyn Step) -> anyhow::Result<ExitCode> {
        let tracker = self.rig().ok().and_then(|rig| rig.calibration.tracker);
        let metres = tracker.map(|tracker| tracker.metres_per_unit);
        self.to.carry_out(self.session.as_deref(), metres, step)
    }
}

impl ToArgs {
    /// As [`FromArgs::config`].
    pub fn config(&self) -> anyhow::Result<Config> {
        Ok(match &self.config {
            Some(path) => Config::load(path)?,
            None => Config::default(),
        })
    }

    /// The live rig's known calibration.
    pub fn rig(&self) -> anyhow::Result<RigDocument> {
        Ok(Known::read(&self.config()?)?.document)
    }

    /// As [`FromArgs::carry_out`]; `metres_per_unit` is the tracker's, where it is known.
    pub fn carry_out(
        &self,
        session: Option<&Path>,
        metres_per_unit: Option<f64>,
        step: &mut dyn Step,
    ) -> anyhow::Result<ExitCode> {
        let config = self.config()?;
        let Some(path) = session else {
            let place = self.place(step, true)?;
            let noted = (self.device.as_ref(), self.serial.as_ref());
            let found = live::carry_out(step, &config, &self.live, noted)?;
            return self.conclude(step.name(), &found, &place);
        };
        self.carry_out_by(&path.display().to_string(), step, |step, bar| {
            let session = Session::open(path)?;
            let told = |share: f64, progress: &Progress| tell_progress(bar, share, progress);
            Ok(show_session(
                &session,
                &config,
                metres_per_unit,
                step,
                told,
            )?)
        })
    }

    /// Lets `show` show the step everything; it returns how many pictures were damaged.
    pub fn carry_out_by<S: Step + ?Sized>(
        &self,
        source: &str,
        step: &mut S,
        show: impl FnOnce(&mut S, &ProgressBar) -> anyhow::Result<usize>,
    ) -> anyhow::Result<ExitCode> {
        let place = self.place(step, false)?;
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
        self.conclude(step.name(), &found, &place)
    }

    /// Checks what can be checked before the work.
    fn place<S: Step + ?Sized>(&self, step: &S, live: bool) -> anyhow::Result<Place> {
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
            return Ok(Place::Rig { folder, name });
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
        Ok(Place::Named { out, report })
    }

    fn conclude(&self, step: &str, found: &Finished, place: &Place) -> anyhow::Result<ExitCode> {
        tell(found);
        let written = self.write(step, found, place)?;
        let what = match step {
            "verify" => "check",
            _ => "calibration",
        };
        for (what, path) in [
            ("report", &written.report),
            (what, &written.file),
            ("the one before", &written.backup),
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
            // What is not there cannot be used by mistake.
            None => bail!("refused: no calibration was written; {why}"),
        }
    }

    fn write(&self, step: &str, found: &Finished, place: &Place) -> anyhow::Result<Written> {
        let (out, report) = match place {
            Place::Rig { folder, name } => return Ok(write_calibration(folder, name, found)?),
            Place::Named { out, report } => (out, report),
        };
        write(report, found.page.as_bytes(), self.force)?;
        // A check is kept whatever it found.
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

/// On the bar.
pub fn tell_progress(bar: &ProgressBar, share: f64, progress: &Progress) {
    bar.set_position((1000.0 * share) as u64);
    bar.set_message(match progress.hint.as_str() {
        "" => progress.message.clone(),
        hint => format!("{}; {hint}", progress.message),
    });
}

fn tell(found: &Finished) {
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

/// Hidden by indicatif where standard error is no terminal.
pub fn progress_bar() -> ProgressBar {
    let bar = ProgressBar::new(1000);
    if let Ok(style) = ProgressStyle::with_template("{bar:30} {percent} % {msg}") {
        bar.set_style(style);
    }
    bar
}
