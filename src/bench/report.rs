//! The benchmark's table and its JSON.

use super::live::LiveRow;
use super::percentiles::Percentiles;
use penumbra_compositor::Gpu;
use serde::Serialize;
use std::fmt;

/// Everything measured in one run.
#[derive(Clone, Debug, Serialize)]
pub struct BenchReport {
    /// Version of this format.
    pub version: u32,
    /// Adapter name; `None` if nothing was rendered.
    pub adapter: Option<String>,
    /// True for a software driver.
    pub software: bool,
    /// Rows of the rendering cases, one per configuration.
    pub rows: Vec<Row>,
    /// Cost of capture.
    pub capture: Vec<CaptureRow>,
    /// Latency of live pictures.
    pub live: Vec<LiveRow>,
    /// Time without a picture after the graphics device of a live rig was lost, seconds; `None` if that
    /// was not measured.
    pub recovery_seconds: Option<f64>,
}

/// One configuration of a rendering case.
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
    /// Shadow maps updated in each frame.
    pub refreshed_per_frame: u32,
    /// Shadowing planes; 0 with dome lights.
    pub planes: u32,
    /// Non-black basis images on them.
    pub basis_images: u32,
    /// Whether the light changed in every frame.
    pub light_changes: bool,
    /// Triangles of the virtual objects.
    pub triangles: usize,
    /// Virtual lamps.
    pub lamps: u32,
    /// Source of the light of each picture; `None` if the light is synthetic.
    pub environment: Option<&'static str>,
    /// Frames per second: the reciprocal of the mean wall time.
    pub fps: f64,
    /// Milliseconds from the upload of the picture, or from the start of its light estimate, to the
    /// finished picture.
    pub wall_ms: Percentiles,
    /// Milliseconds of all passes on the device.
    pub gpu_ms: Percentiles,
    /// Median processor time per picture of all threads, including those of a software driver,
    /// milliseconds; `None` if it was not measured. Other programs hardly affect it.
    pub processor_ms: Option<f64>,
    /// Median milliseconds of the steps on the processor, if they were measured: the steps of the
    /// light estimate, the entire estimate, and compositing.
    pub stages: Vec<PassTime>,
    /// Median milliseconds of each pass.
    pub passes: Vec<PassTime>,
}

/// Cost of a live rig up to the pictures that are ready for the compositor.
#[derive(Clone, Debug, Default, Serialize)]
pub struct CaptureRow {
    /// Case name.
    pub case: String,
    /// Picture width of both cameras, pixels.
    pub width: u32,
    /// Picture height of both cameras, pixels.
    pub height: u32,
    /// Pictures per second of each camera.
    pub frames_per_second: f64,
    /// Mean size of a picture, kilobytes.
    pub picture_kilobytes: f64,
    /// Duration of the measurement.
    pub seconds: f64,
    /// Scene camera, environment camera, tracker.
    pub devices: Vec<DeviceTally>,
    /// Prepared pictures.
    pub prepared: u64,
    /// Prepared pictures with a pose.
    pub prepared_with_pose: u64,
    /// Pictures skipped for newer ones.
    pub skipped: u64,
    /// Milliseconds of decoding a JPEG picture.
    pub decode_ms: Percentiles,
    /// Milliseconds of the lighting.
    pub light_ms: Percentiles,
    /// Processor time by thread, highest first; empty if the system does not report it.
    pub threads: Vec<ThreadCost>,
}

/// Deliveries of a device.
#[derive(Clone, Debug, Serialize)]
pub struct DeviceTally {
    /// Name of the device.
    pub device: String,
    /// Pictures or readings received.
    pub delivered: u64,
    /// Pictures or readings dropped because a queue was full.
    pub lost: u64,
}

/// Processor time of a thread.
#[derive(Clone, Debug, Serialize)]
pub struct ThreadCost {
    /// Its name.
    pub name: String,
    /// Per cent of one core.
    pub percent_of_core: f64,
    /// Milliseconds for each picture of the scene camera.
    pub ms_per_picture: f64,
}

/// A pass and its median time.
#[derive(Clone, Debug, Serialize)]
pub struct PassTime {
    /// Name of the pass, which is that of its shader.
    pub name: &'static str,
    /// Milliseconds.
    pub ms: f64,
}

impl BenchReport {
    pub(super) fn new(gpu: Option<&Gpu>) -> Self {
        Self {
            version: 1,
            adapter: gpu.map(|gpu| gpu.name.clone()),
            software: gpu.is_some_and(|gpu| gpu.software),
            rows: Vec::new(),
            capture: Vec::new(),
            live: Vec::new(),
            recovery_seconds: None,
        }
    }
}

impl Row {
    /// Heading of the table's columns.
    pub const HEADING: &'static str = "case       size       lights redrawn triangles    fps   wall p50   wall p99    gpu p50    gpu p99";
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let size = format!("{}x{}", self.width, self.height);
        write!(
            f,
            "{:10} {:10} {:6} {:7} {:9} {:6.1} {:7.2} ms {:7.2} ms {:7.2} ms {:7.2} ms",
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
        if self.planes > 0 {
            let light = if self.light_changes {
                "changes every frame"
            } else {
                "steady"
            };
            let (planes, images) = (self.planes, self.basis_images);
            write!(
                f,
                "\n          {planes} planes, {images} basis images, light {light}"
            )?;
        }
        if let Some(environment) = self.environment {
            let lamps = self.lamps;
            write!(f, "\n          {lamps} lamps, light from the {environment}")?;
        }
        if let Some(ms) = self.processor_ms {
            write!(f, "\n          {:18} {ms:8.3} ms", "processor time")?;
        }
        for pass in self.stages.iter().chain(&self.passes) {
            write!(f, "\n          {:18} {:8.3} ms", pass.name, pass.ms)?;
        }
        Ok(())
    }
}

impl fmt::Display for CaptureRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: two cameras, {}x{} JPEG of {:.0} kB at {}/s, {:.1} s",
            self.case,
            self.width,
            self.height,
            self.picture_kilobytes,
            self.frames_per_second,
            self.seconds
        )?;
        for tally in &self.devices {
            let DeviceTally {
                device,
                delivered,
                lost,
            } = tally;
            write!(f, "\n  {device}: {delivered} delivered, {lost} lost")?;
        }
        write!(
            f,
            "\n  {} prepared, {} with a pose, {} skipped",
            self.prepared, self.prepared_with_pose, self.skipped
        )?;
        for (name, ms) in [("decode", self.decode_ms), ("light", self.light_ms)] {
            write!(f, "\n  {name} p50 {:.2} ms, p99 {:.2} ms", ms.p50, ms.p99)?;
        }
        write!(f, "\n  thread            % of a core  ms/picture")?;
        for thread in &self.threads {
            let ThreadCost {
                name,
                percent_of_core,
                ms_per_picture,
            } = thread;
            write!(
                f,
                "\n  {name:16} {percent_of_core:12.2} {ms_per_picture:11.3}"
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row() -> Row {
        Row {
            case: "kakuta2007".to_owned(),
            width: 640,
            height: 480,
            lights: 40,
            refreshed_per_frame: 0,
            planes: 38,
            basis_images: 1400,
            light_changes: true,
            triangles: 58_500,
            lamps: 0,
            environment: None,
            fps: 60.0,
            wall_ms: Percentiles::default(),
            gpu_ms: Percentiles::default(),
            processor_ms: None,
            stages: Vec::new(),
            passes: Vec::new(),
        }
    }

    #[test]
    fn only_rows_with_planes_name_planes() {
        let text = row().to_string();
        assert!(
            text.contains("38 planes, 1400 basis images, light changes every frame"),
            "{text}"
        );
        let dome = Row {
            planes: 0,
            basis_images: 0,
            ..row()
        };
        assert!(!dome.to_string().contains("planes"), "{dome}");
    }

    #[test]
    fn case_names_fit_their_column() {
        let heading = Row::HEADING.find("size");
        let size = row().to_string().find("640x480");
        assert_eq!(size, heading);
    }
}
