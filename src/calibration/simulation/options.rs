//! What a rehearsal is like.

use super::motion::Motion;
use crate::intrinsics::Board;
use clap::{Args, ValueEnum};

/// A simulated rig and what is wrong with it.
#[derive(Args, Clone, Debug, PartialEq)]
pub struct SimulationOptions {
    /// Another number, another rig: lens, mounting, tags, motion, noise
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How long it records
    #[arg(long, default_value_t = 20.0, value_parser = seconds)]
    pub seconds: f64,
    /// The scene camera's pictures
    #[arg(long, default_value = "640x480", value_parser = size)]
    pub size: (u32, u32),
    /// Its pictures a second
    #[arg(long, default_value_t = 30.0, value_parser = rate)]
    pub rate: f64,
    /// Tags on the table and on stands, 8 cm
    #[arg(long, default_value_t = 9, value_parser = clap::value_parser!(u32).range(0..=60))]
    pub tags: u32,
    /// A chessboard on the table, in the place of tags
    #[arg(long, value_name = "chess:9x6:0.025", value_parser = Board::parse)]
    pub board: Option<Board>,
    /// How the rig is moved
    #[arg(long, value_enum, default_value_t)]
    pub motion: Motion,
    /// Of the pictures, codes
    #[arg(long, default_value_t = 2.0, value_parser = amount)]
    pub noise: f64,
    /// Of the pictures, pixels
    #[arg(long, default_value_t = 0.6, value_parser = amount)]
    pub blur: f64,
    /// Exposure time, seconds: what moves is smeared
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub shutter: f64,
    /// From the first row to the last, seconds
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub rolling: f64,
    /// Millimetres and degrees
    #[arg(long, value_name = "MM,DEG", default_value = "0.4,0.05", value_parser = pair)]
    pub tracker_noise: (f64, f64),
    /// By how many metres metal nearby shifts the tracker's readings
    #[arg(long, default_value_t = 0.0, value_parser = amount)]
    pub metal: f64,
    /// Seconds from a measurement to its record's arrival
    #[arg(long, default_value_t = 0.0173, allow_hyphen_values = true)]
    pub tracker_latency: f64,
    /// Seconds from the middle of the exposure to the stamp
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    pub camera_latency: f64,
    /// Of the tracker's records that never arrive, in gaps of a quarter of a second; share
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub gaps: f64,
    /// Of the tracker's records that are far off; share
    #[arg(long, default_value_t = 0.0, value_parser = share)]
    pub jumps: f64,
    /// The last tag is knocked over half way
    #[arg(long)]
    pub loose: bool,
    /// An environment camera (fisheye), and where
    #[arg(long, value_enum, default_value_t)]
    pub environment: EnvironmentMount,
    /// rig.json says where the tags are
    #[arg(long)]
    pub known_markers: bool,
    /// rig.json says how the tracker is mounted, and its latency
    #[arg(long)]
    pub known_tracker: bool,
}

/// Where a rehearsal's environment camera is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum EnvironmentMount {
    /// There is none.
    #[default]
    None,
    /// On the table, looking up.
    Standing,
    /// On the rig.
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
        .ok_or_else(|| "expected WIDTHxHEIGHT, e.g. 640x480".to_owned())
}
