//! Status of a running rig: a snapshot (plain data), and an HTTP server that shows it.
//!
//! The rig writes a [`SharedStatus`]; [`StatusServer`] reads it. [`snapshot`] is the data,
//! [`times`] the histograms in it, [`settings`] the live settings. The server consists of
//! [`server`] (socket and limits), `guard` (access), `places` (limits under load), `app` (shared state), `routes`, `calibration_routes` and `scene_routes`, [`metrics`],
//! [`guide`], [`health`] and [`log`] (made from the snapshot), [`preview`] (the environment light), and the dashboard (`files`).
//! [`PageServer`] serves pages of other commands in the same way.

mod app;
pub mod calibration;
mod calibration_routes;
mod descriptors;
pub mod fields;
mod files;
mod guard;
pub mod guide;
pub mod health;
pub mod log;
mod memory;
pub mod metrics;
pub mod objects;
mod places;
pub mod planes;
pub mod playback;
pub mod preview;
mod probe;
pub mod recording;
pub mod registration;
mod routes;
pub mod scene_files;
mod scene_routes;
pub mod server;
pub mod settings;
pub mod shared;
pub mod snapshot;
mod stall;
pub mod stream;
pub mod times;

pub use app::{HTML, StreamLimits, is_json, problem};
pub use fields::STATUS_FIELDS;
pub use files::{CSS, SCRIPT, asset};
pub use guide::GuideStatus;
pub use penumbra_config::token::is_token;
pub use playback::Playback;
pub use preview::environment_preview;
pub use probe::ProbeStatus;
pub use registration::{DisplayStatus, RegistrationSource, RegistrationStatus};
pub use server::{DEFAULT_LISTEN, PageServer, StatusError, StatusServer, StatusService};
pub use settings::{Settings, SettingsChange};
pub use shared::{SharedStatus, View};
pub use snapshot::{LensSource, LensStatus, Levels, SceneStatus, Snapshot};
pub use times::{Histogram, RateMeter, StageTimes};
