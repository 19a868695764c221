//! The options of a simulated rig: its properties and its defects.

use super::motion::Motion;
use crate::intrinsics::Board;
use clap::{Args, ValueEnum};

/// Properties and defects of a simulated rig.
#[derive(Args, Clone, Debug, PartialEq)]
pub struct SimulationOptions {
    /// Random seed of lens, mounting, tags, motion and noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Duration of the recording, seconds
    #[arg(long, default_value_t = 20.0, value_parser = seconds)]
    pub seconds: f64,
    /// Size of the scene camera's pictures, pixels
    #[arg(long, default_value = "640x480", value_parser = size)]
    pub size: (u32, u32),
    /// Pictures of the scene camera per second
    #[arg(long, default_value_t = 30.0, value_parser = rate)]
    pub rate: f64,
    /// Number of 8 cm tags on the table and on stands
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub tags: u32,
    /// Chessboard on the table instead of tags
    #[arg(long, value_name = "chess:9x6:0.025", value_parser = Board::parse)]
    pub board: Option<Board>,
    /// Motion of the rig
    #[arg(long, value_enum, default_value_t)]
    pub motion: Motion,
    /// Standard deviation of the pictures' noise, codes
    #[arg(long, default_value_t = 2.0, value_parser = amount)]
    pub noise: f64,
    /// Standard deviation of the pictures' blur, pixels
    #[arg(long, default_value_t = 0.6, value_parser = amount)]
    pub blur: f64,
    /// Exposure time, seconds; causes motion blur
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub shutter: f64,
    /// Rolling shutter: time from the first to the last row, seconds
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub rolling: f64,
    /// Standard deviation of the tracker's noise, millimetres and degrees
    #[arg(long, value_name = "MM,DEG", default_value = "0.4,0.05", value_parser = pair)]
    pub tracker_noise: (f64, f64),
    /// Displacement of the tracker's readings by metal nearby, metres
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub metal: f64,
    /// Time from a measurement of the tracker to the arrival of its record, seconds
    #[arg(long, default_value_t = 0.0173, allow_hyphen_values = true)]
    pub tracker_latency: f64,
    /// Time from the middle of an exposure to the picture's time stamp, seconds
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub camera_latency: f64,
    /// Share of the tracker's records that are lost, in gaps of a quarter of a second
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub gaps: f64,
    /// Share of the tracker's records that are outliers
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub jumps: f64,
    /// Move the last tag halfway through the recording
    #[arg(long)]
    pub loose: bool,
    /// Mount of an environment camera (fisheye)
    #[arg(long, value_enum, default_value_t)]
    pub environment: EnvironmentMount,
    /// Write the tags' poses into rig.json
    #[arg(long)]
    pub known_markers: bool,
    /// Write the tracker's mounting and latency into rig.json
    #[arg(long)]
    pub known_tracker: bool,
}

/// Mount of the environment camera.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum EnvironmentMount {
    /// No environment camera.
    #[default]
    None,
    /// On the table, looking up.
    Standing,
    /// On the rig, moving with it.
    Carried,
}

impl Default for SimulationOptions {
    fn default() -> Self {
        Self {
            seed: 1,
            seconds: 20.0,
            size: (640, 480),
            rate: 30.0,
            tags: 9,
            board: None,
            motion: Motion::Free,
            noise: 2.0,
            blur: 0.6,
            shutter: 0.0,
            rolling: 0.0,
            tracker_noise: (0.4, 0.05),
            metal: 0.0,
            tracker_latency: 0.0173,
            camera_latency: 0.0,
            gaps: 0.0,
            jumps: 0.0,
            loose: false,
            environment: EnvironmentMount::None,
            known_markers: false,
            known_tracker: false,
        }
    }
}

fn number(text: &str, low: f64, high: f64) -> Result<f64, String> {
    let value = text.parse::<f64>().ok();
    value
        .filter(|v| (low..=high).contains(v))
        .ok_or_else(|| format!("expected a number from {low} to {high}"))
}

fn seconds(text: &str) -> Result<f64, String> {
    number(text, 0.5, 600.0)
}

fn rate(text: &str) -> Result<f64, String> {
    number(text, 1.0, 240.0)
}

fn amount(text: &str) -> Result<f64, String> {
    number(text, 0.0, 50.0)
}

fn share(text: &str) -> Result<f64, String> {
    number(text, 0.0, 0.9)
}

fn pair(text: &str) -> Result<(f64, f64), String> {
    let (a, b) = text
        .split_once(',')
        .ok_or("expected two numbers and a comma")?;
    Ok((amount(a)?, amount(b)?))
}

fn size(text: &str) -> Result<(u32, u32), String> {
    let sides = text.split_once('x');
    let parsed = sides.and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parsed
        .filter(|(w, h)| (64..=4096).contains(w) && (64..=4096).contains(h))
        .ok_or_else(|| "expected WIDTHxHEIGHT, 64 to 4096 pixels each, e.g. 640x480".to_owned())
}
