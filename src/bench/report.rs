//! The benchmark's table and its JSON.

use crate::compositor::Gpu;
use serde::Serialize;
use std::fmt;

/// Everything measured in one run.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Version of this layout.
    pub version: u32,
    /// Adapter name.
    pub adapter: String,
    /// True for a software driver.
    pub software: bool,
    /// One per configuration.
    pub rows: Vec<Row>,
}

/// One configuration.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Case name.
    pub case: String,
    /// Picture width, pixels.
    pub width: u32,
    /// Picture height, pixels.
    pub height: u32,
    /// Dome lights.
    pub lights: u32,
    /// Shadow maps drawn again in each frame.
    pub refreshed_per_frame: u32,
    /// Triangles of the virtual objects.
    pub triangles: usize,
    /// Frames per second: the reciprocal of the mean wall time.
    pub fps: f64,
    /// Milliseconds from upload to finished picture.
    pub wall_ms: Percentiles,
    /// Milliseconds of all passes on the device.
    pub gpu_ms: Percentiles,
    /// Median milliseconds of each pass.
    pub passes: Vec<PassTime>,
}

/// Median and 99th percentile.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Percentiles {
    /// Median.
    pub p50: f64,
    /// 99th percentile.
    pub p99: f64,
}

/// A pass and its median time.
#[derive(Clone, Debug, Serialize)]
pub struct PassTime {
    /// Name of the pass, as of its shader.
    pub name: &'static str,
    /// Milliseconds.
    pub ms: f64,
}

impl Percentiles {
    /// Of unordered values; zero of none.
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        let at = |q: f64| {
            let i = (q * (sorted.len().max(1) - 1) as f64).round() as usize;
            sorted.get(i).copied().unwrap_or_default()
        };
        Self {
            p50: at(0.5),
            p99: at(0.99),
        }
    }
}

impl BenchReport {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            version: 1,
            adapter: gpu.name.clone(),
            software: gpu.software,
            rows: Vec::new(),
        }
    }
}

impl Row {
    /// Heading of the table's columns.
    pub const HEADING: &'static str = "case      size       lights redrawn triangles    fps   wall p50   wall p99    gpu p50    gpu p99";
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = format!("{}x{}", self.width, self.height);
        write!(
            f,
            "{:9} {:10} {:6} {:7} {:9} {:6.1} {:7.2} ms {:7.2} ms {:7.2} ms {:7.2} ms",
            self.case,
            size,
            self.lights,
            self.refreshed_per_frame,
            self.triangles,
            self.fps,
            self.wall_ms.p50,
            self.wall_ms.p99,
            self.gpu_ms.p50,
            self.gpu_ms.p99
        )?;
        for pass in &self.passes {
            write!(f, "\n          {:18} {:8.3} ms", pass.name, pass.ms)?;
        }
        Ok(())
    }
}
