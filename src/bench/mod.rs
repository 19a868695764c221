//! `penumbra bench`: how long a frame takes, on the adapter chosen, for the cases of the
//! papers' tables; and what capturing costs.

mod camera_session;
mod capture;
mod kakuta;
mod report;
mod simulated_tracker;
mod stage;
mod supan;
mod thread_time;

pub use report::{BenchReport, CaptureRow, DeviceTally, PassTime, Percentiles, Row, ThreadCost};

use crate::compositor::{Gpu, GpuError};
use crate::rig::RigError;
use crate::session::SessionError;
use std::io;
use thiserror::Error;

/// What to measure.
#[derive(Clone, Debug, Default)]
pub struct BenchOptions {
    /// Case name; all without it.
    pub case: Option<String>,
    /// Frames per row; the case's own number without it.
    pub frames: Option<u32>,
    /// Measure this picture size too.
    pub size: Option<(u32, u32)>,
}

/// Names of all cases.
pub const CASES: [&str; 4] = ["supan", "kakuta2007", "kakuta2004", "capture"];

/// A benchmark cannot be run. Each text is the one line that the user gets.
#[derive(Debug, Error)]
pub enum BenchError {
    /// The graphics device.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The rig that is measured.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The recording that its cameras replay.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Its pictures.
    #[error("a picture cannot be compressed: {0}; choose another --size")]
    Picture(#[from] turbojpeg::Error),
    /// Its tracker.
    #[error("no simulated tracker: {source}; end other programs")]
    Tracker {
        /// What the system said.
        source: io::Error,
    },
    /// Its tracker's protocol.
    #[error(transparent)]
    Protocol(#[from] penumbra_synthetic::UnknownProtocol),
}

impl BenchOptions {
    /// A chosen case draws.
    #[must_use]
    pub fn needs_gpu(&self) -> bool {
        CASES
            .iter()
            .any(|case| *case != "capture" && self.wants(case))
    }

    fn wants(&self, name: &str) -> bool {
        self.case.as_deref().is_none_or(|case| case == name)
    }
}

/// Runs the chosen cases; `progress` is told each row as it is done. Without `gpu` nothing
/// is drawn.
///
/// # Errors
/// The device was lost; the system refuses a file or a thread.
pub fn run(
    gpu: Option<&Gpu>,
    options: &BenchOptions,
    progress: &mut dyn FnMut(&dyn std::fmt::Display),
) -> Result<BenchReport, BenchError> {
    let mut report = BenchReport::new(gpu);
    if let Some(gpu) = gpu {
        progress(&Row::HEADING);
        if options.wants("supan") {
            supan::run(gpu, options, &mut report, &mut |row| progress(row))?;
        }
        kakuta::run(gpu, options, &mut report, &mut |row| progress(row))?;
    }
    if options.wants("capture") {
        let row = capture::run(options)?;
        progress(&row);
        report.capture.push(row);
    }
    Ok(report)
}
