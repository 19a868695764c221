//! `penumbra bench`: time per frame for the cases of the papers' tables, cost of capture, and latency
//! of live pictures.

mod camera_session;
mod capture;
mod kakuta;
mod lightprobe;
mod live;
mod percentiles;
mod report;
mod resized;
mod simulated_tracker;
mod stage;
mod supan;
mod thread_time;

use report::{BenchReport, Row};

use penumbra_compositor::{Gpu, GpuError};
use penumbra_lighting::EnvironmentError;
use penumbra_rig::RigError;
use penumbra_session::SessionError;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// Options of the benchmark.
#[derive(Clone, Debug, Default)]
pub struct BenchOptions {
    /// Name of the case to run; `None` for all.
    pub case: Option<String>,
    /// Frames per row; `None` for the case's default.
    pub frames: Option<u32>,
    /// Picture size, pixels; `None` for the case's default.
    pub size: Option<(u32, u32)>,
    /// Recording that the devices of the live case replay; `None` for the bundled one.
    pub session: Option<PathBuf>,
}

/// Names of all cases.
pub const CASES: [&str; 6] = [
    "supan",
    "kakuta2007",
    "kakuta2004",
    "lightprobe",
    "capture",
    "live",
];

/// An error of the benchmark; the text is the user's message.
#[derive(Debug, Error)]
pub enum BenchError {
    /// The graphics device failed.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The lighting cannot be estimated.
    #[error(transparent)]
    Environment(#[from] EnvironmentError),
    /// The measured rig failed.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The recording that the cameras replay cannot be written or read.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A picture of the recording cannot be compressed.
    #[error("a picture cannot be compressed: {0}; choose another --size")]
    Picture(#[from] turbojpeg::Error),
    /// The simulated tracker cannot start. Without pseudo-terminals the rig is measured without it.
    #[cfg(unix)]
    #[error("cannot start the simulated tracker: {source}; end other programs")]
    Tracker {
        /// The system's message.
        source: io::Error,
    },
    /// A thread cannot start.
    #[error("cannot start a thread: {source}; end other programs")]
    Thread {
        /// The system's message.
        source: io::Error,
    },
    /// The recording has no calibration of the scene camera.
    #[error(
        "the recording has no rig.json with the scene camera's image_size and K; leave out --size, or name \
         another --session"
    )]
    NoCalibration,
    /// A picture of the recording is damaged.
    #[error("the recording has a damaged picture: {0}; name another one with --session")]
    Damaged(#[from] penumbra_picture::PictureError),
    /// The recording's calibration is damaged.
    #[error("the recording's rig.json: {0}; name another one with --session")]
    Calibration(#[from] serde_json::Error),
    /// The rig composited no picture.
    #[error("the live rig composited no picture; choose a recording with pictures with --session")]
    Silent,
    /// The simulated tracker's protocol is unknown.
    #[error(transparent)]
    Protocol(#[from] penumbra_synthetic::UnknownProtocol),
}

impl BenchOptions {
    /// Returns whether any of the chosen cases renders.
    #[must_use]
    pub fn needs_gpu(&self) -> bool {
        CASES
            .iter()
            .any(|case| *case != "capture" && self.wants(case))
    }

    fn session(&self) -> &Path {
        self.session.as_deref().unwrap_or(Path::new(live::SESSION))
    }

    /// Returns whether all cases were chosen but the live case's session, which is bundled with the
    /// repository, is missing.
    fn lacks_session(&self) -> bool {
        self.case.is_none() && self.session.is_none() && !self.session().exists()
    }

    /// Returns the number of rows of the chosen cases, for the progress.
    #[must_use]
    pub fn rows(&self) -> usize {
        let chosen = ROWS.iter().filter(|(case, _)| self.wants(case));
        chosen.map(|(_, rows)| rows).sum()
    }

    fn wants(&self, name: &str) -> bool {
        self.case.as_deref().is_none_or(|case| case == name)
    }
}

/// Number of rows of each case.
const ROWS: [(&str, usize); 6] = [
    ("supan", 5),
    ("kakuta2007", 4),
    ("kakuta2004", 2),
    ("lightprobe", 9),
    ("capture", 1),
    ("live", 4),
];

/// Runs the chosen cases; `progress` receives each row when it is done. Without `gpu` nothing
/// is rendered.
///
/// # Errors
/// The graphics device was lost, or the system cannot provide a file or a thread.
pub fn run(
    gpu: Option<&Gpu>,
    options: &BenchOptions,
    progress: &mut dyn FnMut(&dyn std::fmt::Display),
) -> Result<BenchReport, BenchError> {
    let mut report = BenchReport::new(gpu);
    if let Some(gpu) = gpu {
        if ["supan", "kakuta2007", "kakuta2004", "lightprobe"]
            .iter()
            .any(|case| options.wants(case))
        {
            progress(&Row::HEADING);
        }
        if options.wants("supan") {
            supan::run(gpu, options, &mut report, &mut |row| progress(row))?;
        }
        kakuta::run(gpu, options, &mut report, &mut |row| progress(row))?;
        if options.wants("lightprobe") {
            lightprobe::run(gpu, options, &mut report, &mut |row| progress(row))?;
        }
    }
    if options.wants("capture") {
        let row = capture::run(options)?;
        progress(&row);
        report.capture.push(row);
    }
    if let Some(gpu) = gpu
        && options.wants("live")
    {
        if options.lacks_session() {
            let path = live::SESSION;
            progress(&format_args!(
                "live: skipped, because {path} does not exist; name a recording with --session"
            ));
            return Ok(report);
        }
        live::run(gpu, options, &mut report.live, &mut |row| progress(row))?;
        let seconds = live::recovery(gpu, options)?;
        progress(&format_args!(
            "live: a picture again {seconds:.2} s after the loss of the graphics device"
        ));
        report.recovery_seconds = Some(seconds);
    }
    Ok(report)
}
