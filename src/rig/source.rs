//! The source of frames: a recording or live devices.

use crate::composites::Composites;
use crate::error::RigError;
use crate::viewed::{RefinedLens, viewed_rig};
use penumbra_capture::{Capture, Devices, Hub, LiveDevice};
use penumbra_config::TrackerSource;
use penumbra_config::{Config, TrackerUnits};
use penumbra_interface::{MonotonicTime, SystemClock};
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::lens_files::SCENE_LENS;
use penumbra_session::{Attachment, Session, ViewedRig, import};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::{Arc, OnceLock, Weak};

/// Picture size of a camera whose size is not configured, pixels.
const DEFAULT_SIZE: (u32, u32) = (640, 480);

/// A recording or a live rig; all later processing is the same for both.
#[derive(Clone)]
pub enum Source {
    /// A recording.
    Recorded(Session),
    /// Live devices.
    Live(Live),
}

/// Live devices and the files of their rig.
#[derive(Clone)]
pub struct Live {
    /// Queue of the devices' deliveries.
    pub hub: Arc<Hub>,
    /// The configured devices.
    pub devices: Arc<Devices>,
    /// Supervisors of the devices; empty until they are opened.
    capture: Arc<OnceLock<Capture>>,
    /// The rig's files (calibration, phantoms, objects), and what else a recording holds beside the
    /// devices' deliveries.
    pub contents: RecordingContents,
}

/// What a recording holds beside the devices' deliveries.
#[derive(Clone, Default)]
pub struct RecordingContents {
    /// Files of the rig, which are attached.
    pub files: Arc<RigFiles>,
    /// Composited pictures.
    pub composites: Arc<Composites>,
    /// What viewers are told of the rig.
    pub viewed: Arc<ViewedRig>,
    /// The scene camera's lens, if it was refined since the start.
    pub refined_lens: Arc<RefinedLens>,
}

/// Observes the devices of a [`Live`] without keeping them open.
#[derive(Clone, Default)]
pub struct DeviceObserver(Weak<OnceLock<Capture>>);

impl DeviceObserver {
    /// Returns the devices; empty before they are opened and after they are closed.
    #[must_use]
    pub fn devices(&self) -> Vec<LiveDevice> {
        let capture = self.0.upgrade();
        let devices = capture
            .as_ref()
            .and_then(|c| Some(c.get()?.devices().to_vec()));
        devices.unwrap_or_default()
    }
}

/// The files that describe a rig, which a session holds as attachments.
#[derive(Clone, Debug, Default)]
pub struct RigFiles(Vec<Attachment>);

impl RigFiles {
    /// Loads the files of the folder or session named by the configuration's `calibration`; empty
    /// if there is none.
    ///
    /// # Errors
    /// The path is neither a folder nor a session, or a file in it cannot be read.
    pub fn load(config: &Config) -> Result<Self, RigError> {
        let Some(path) = &config.calibration else {
            return Ok(Self::default());
        };
        Self::at(path)
    }

    /// Loads the files of a folder or session.
    ///
    /// # Errors
    /// As [`RigFiles::load`].
    pub fn at(path: &Path) -> Result<Self, RigError> {
        if path.is_file() {
            return Ok(Self(Session::open(path)?.attachments().to_vec()));
        }
        Ok(Self(import::attachments_in(path)?))
    }

    /// Reads a `rig.json` of any name, without the calibration files beside it.
    ///
    /// # Errors
    /// The file cannot be read or is larger than 16 MiB.
    pub fn from_rig_json(path: &Path) -> std::io::Result<Self> {
        const MAX_BYTES: u64 = 16 << 20;
        let mut data = Vec::new();
        File::open(path)?
            .take(MAX_BYTES + 1)
            .read_to_end(&mut data)?;
        if data.len() as u64 > MAX_BYTES {
            return Err(std::io::Error::other("the file is larger than 16 MiB"));
        }
        Ok(Self(vec![Attachment {
            name: "rig.json".to_owned(),
            media_type: "application/json".to_owned(),
            data: data.into(),
        }]))
    }

    /// Adds `newer` files, which replace files of the same name.
    #[must_use]
    pub fn with(mut self, newer: Self) -> Self {
        self.0.extend(newer.0);
        self
    }

    /// Returns the bytes of a file.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&[u8]> {
        let found = self.0.iter().rev().find(|file| file.name == name)?;
        Some(&found.data)
    }

    /// Parses the description of the rig. Without a `rig.json`, it consists of the calibration
    /// files and default values.
    ///
    /// # Errors
    /// A file is invalid.
    pub fn document(&self, config: &Config) -> Result<RigDocument, RigError> {
        let attachments = |name: &str| self.get(name);
        Ok(match self.get("rig.json") {
            Some(_) => RigDocument::from_session(&attachments)?,
            None => RigDocument::without_rig_json(configured_size(config), &attachments)?,
        })
    }

    /// Returns all files.
    #[must_use]
    pub fn all(&self) -> &[Attachment] {
        &self.0
    }
}

impl Live {
    /// Creates the configured devices without opening them. `composed`: their pictures are
    /// composed, not only recorded.
    ///
    /// # Errors
    /// The rig's files cannot be read, or the configured unit of the tracker contradicts its
    /// calibration.
    pub fn new(config: &Config, composed: bool) -> Result<Self, RigError> {
        let files = RigFiles::load(config)?;
        let devices = Devices {
            scene_camera: Some(config.scene_camera.source.clone()),
            environment_camera: config.environment_camera.clone(),
            tracker: tracker(config, &files)?,
        };
        let contents = RecordingContents {
            viewed: Arc::new(viewed(config, &files, devices.tracker.as_ref())),
            files: Arc::new(files),
            ..RecordingContents::default()
        };
        Ok(Self {
            hub: Hub::new(Arc::new(SystemClock), composed),
            devices: Arc::new(devices),
            capture: Arc::default(),
            contents,
        })
    }

    /// Opens the devices and starts their supervision.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn open(&self) -> Result<(), RigError> {
        let capture = Capture::start(&self.devices, &self.hub)
            .map_err(|source| RigError::Thread { source })?;
        // If the devices are open already, this drops the second capture and closes it.
        let _ = self.capture.set(capture);
        Ok(())
    }

    /// Returns an observer of the devices that does not keep them open.
    #[must_use]
    pub fn observer(&self) -> DeviceObserver {
        DeviceObserver(Arc::downgrade(&self.capture))
    }

    /// Returns the supervised devices; empty before they are opened.
    #[must_use]
    pub fn supervised(&self) -> &[LiveDevice] {
        self.capture.get().map_or(&[], Capture::devices)
    }
}

/// Returns the configured tracker, set to the unit of its calibration: a recording holds the
/// calibration and the tracker's bytes, which must use the same unit.
///
/// # Errors
/// The rig's files are invalid, or the configured unit contradicts the calibration.
pub(super) fn tracker(
    config: &Config,
    files: &RigFiles,
) -> Result<Option<TrackerSource>, RigError> {
    let mut source = config.tracker.clone();
    let Some(TrackerSource::System(tracker)) = &mut source else {
        return Ok(source);
    };
    let document = files.document(config)?;
    let metres = document.calibration.tracker.map(|t| t.metres_per_unit);
    match (tracker.units, metres) {
        (Some(configured), Some(metres)) if (configured.metres() - metres).abs() > 1e-6 => {
            return Err(RigError::Units { configured, metres });
        }
        (None, Some(metres)) => tracker.units = TrackerUnits::from_metres(metres),
        _ => (),
    }
    Ok(source)
}

/// Returns what viewers of a recording are told of the rig: nothing where its files are invalid, which whoever
/// uses them reports.
fn viewed(config: &Config, files: &RigFiles, tracker: Option<&TrackerSource>) -> ViewedRig {
    let lens_known = files.get("rig.json").or(files.get(SCENE_LENS)).is_some();
    let document = files.document(config).ok();
    document.map_or_else(ViewedRig::default, |document| {
        viewed_rig(&document.calibration, lens_known, tracker)
    })
}

impl Source {
    /// Returns a file of the rig.
    #[must_use]
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        match self {
            Self::Recorded(session) => session.attachment(name),
            Self::Live(live) => live.contents.files.get(name),
        }
    }

    /// Returns the files of the rig.
    pub(super) fn files(&self) -> RigFiles {
        match self {
            Self::Recorded(session) => RigFiles(session.attachments().to_vec()),
            Self::Live(live) => RigFiles::clone(&live.contents.files),
        }
    }

    /// Parses the description of the rig. Only a live rig may lack a `rig.json`.
    pub(super) fn document(&self, config: &Config) -> Result<RigDocument, RigError> {
        match self {
            Self::Live(live) => live.contents.files.document(config),
            Self::Recorded(session) => Ok(RigDocument::from_session(&|name: &str| {
                session.attachment(name)
            })?),
        }
    }

    /// Returns whether the source has pictures of an environment camera.
    #[must_use]
    pub fn has_environment(&self) -> bool {
        match self {
            Self::Recorded(session) => session.has_environment(),
            Self::Live(live) => live.devices.environment_camera.is_some(),
        }
    }

    /// Returns the file name of the recording, or `live`.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Recorded(session) => {
                let name = session.path().file_name().unwrap_or_default();
                name.to_string_lossy().into_owned()
            }
            Self::Live(_) => "live".to_owned(),
        }
    }

    /// Returns the share of a recording, 0..=1, that arrived by `at`; `None` for live devices and
    /// for a recording without duration.
    #[must_use]
    pub fn share_played(&self, at: MonotonicTime) -> Option<f64> {
        match self {
            Self::Recorded(session) => session.progress_at(at),
            Self::Live(_) => None,
        }
    }

    /// Returns whether the source is live devices.
    #[must_use]
    pub const fn is_live(&self) -> bool {
        matches!(self, Self::Live(_))
    }
}

/// Returns the configured size of the scene camera's pictures, else the default, pixels.
fn configured_size(config: &Config) -> (u32, u32) {
    match &config.scene_camera.source {
        penumbra_config::CameraSource::System(s) if s.width > 0 && s.height > 0 => {
            (s.width, s.height)
        }
        _ => DEFAULT_SIZE,
    }
}
