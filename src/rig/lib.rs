//! Runs a rig: pairs what its devices deliver, estimates light, composes, outputs, reports.
//!
//! # A frame on its way
//!
//! 1. A driver fills a `Frame` (bytes and timestamps); `capture` makes it a `SessionEvent`, and
//!    its hub a `Delivery` in one queue for all devices. A recording yields `SessionEvent`s.
//! 2. [`feed`] pairs it with a pose and the environment pictures (`RigFrame`) and adds what a
//!    live rig noted about it ([`feed::JournaledFrame`]).
//! 3. [`prepare`], one frame ahead on its own thread, decodes the picture, finds the camera's pose
//!    (`registration`, `display`) and asks [`light`] for the light of the frame, for which frames of
//!    a recording wait (`held_frames`); the result is a [`frame::PreparedFrame`].
//! 4. [`runner`] takes it, and `run` sends it with the settings as one `FrameInput` through the
//!    compositor to the outputs. `scenes` and `planes` exchange scene and bake between frames;
//!    `scene_folder` offers other scenes.
//! 5. `status` publishes the frame's figures; [`report`] sums them up after the run.
//!
//! Beside the frames: [`recorder`] writes deliveries into a session, on request with the composited pictures
//! (`composites`), [`service`] serves the status
//! page, [`check`] checks the files of a configuration, and [`calibration_runner`] runs calibration steps on the same deliveries.
//!
//! Threads are started through `penumbra_interface::threads`: `prepare` (frames), `light::worker`
//! and `light::indirect` (light), `latency_monitor`, `reload` (scene files), `baking`, `recorder`,
//! `service`, and `calibration_runner`. Device threads belong to `capture`, the writer of frames
//! to `output`.

// What a run is made of.
mod context;
mod damage;
mod error;
mod markers;
mod settings;
mod setup;
pub mod source;

// A frame from its arrival to the outputs.
pub mod bake;
mod baking;
pub mod display;
pub mod feed;
pub mod frame;
mod held_frames;
mod journal;
mod latency_monitor;
pub mod light;
mod objects;
mod pace;
mod picture_problems;
mod planes;
mod playback;
mod poses;
pub mod prepare;
mod rectifier;
mod registration;
mod release;
mod reload;
mod run;
pub mod runner;
mod scene_folder;
mod scene_origin;
mod scenes;

// What is known of the run.
mod latency_status;
mod lens_refiner;
mod levels;
mod live_status;
mod notify;
mod probe_status;
mod rates;
pub mod report;
pub mod status;
mod steadied;

// Beside the frames.
pub mod calibration_runner;
pub mod check;
mod composites;
pub mod recorder;
pub mod service;
pub mod simulate;
pub mod synced_file;
mod viewed;
pub mod wall_date;

pub use composites::Composites;
pub use context::RunOptions;
pub use damage::{DamagedPart, LostCounts};
pub use error::RigError;
pub use lens_refiner::REFINED_SOURCE;
pub use penumbra_output::Screen;
pub use recorder::Recorder;
pub use report::Report;
pub use runner::Runner;
pub use settings::live_settings;
pub use setup::RigSetup;
pub use source::{Live, RecordingContents, RigFiles, Source};
pub use viewed::{FoundLens, RefinedLens};
