//! Where frames come from: a recording, or devices.

use crate::error::RigError;
use penumbra_capture::{Capture, Devices, Hub, LiveDevice};
use penumbra_config::TrackerSource;
use penumbra_config::{Config, TrackerUnits};
use penumbra_interface::{MonotonicTime, SystemClock};
use penumbra_rig_model::RigDocument;
use penumbra_session::{Attachment, Session, import};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::{Arc, OnceLock, Weak};

/// Size of the picture of a camera that nobody has said anything about, pixels.
const USUAL_SIZE: (u32, u32) = (640, 480);

/// A recording or a live rig; everything after it is the same.
#[derive(Clone)]
pub enum Source {
    /// A recording.
    Recorded(Session),
    /// Devices.
    Live(Live),
}

/// Devices, and what was known of the rig beforehand.
#[derive(Clone)]
pub struct Live {
    /// Where what they deliver is to be had.
    pub hub: Arc<Hub>,
    /// Which.
    pub devices: Arc<Devices>,
    /// Their supervisors, once they are open.
    capture: Arc<OnceLock<Capture>>,
    /// Calibration, phantoms, objects.
    pub files: Arc<RigFiles>,
}

/// Looks at devices as long as somebody else keeps them open.
#[derive(Clone, Default)]
pub struct DeviceObserver(Weak<OnceLock<Capture>>);

impl DeviceObserver {
    /// The devices; none before they are opened and after they are closed.
    #[must_use]
    pub fn devices(&self) -> Vec<LiveDevice> {
        let capture = self.0.upgrade();
        let devices = capture
            .as_ref()
            .and_then(|c| Some(c.get()?.devices().to_vec()));
        devices.unwrap_or_default()
    }
}

/// The files that say what a rig is: those that a session carries as attachments.
#[derive(Clone, Debug, Default)]
pub struct RigFiles(Vec<Attachment>);

impl RigFiles {
    /// Of the folder or the session that the configuration names; none if it names none.
    ///
    /// # Errors
    /// Neither a folder nor a session is there; something in it cannot be read.
    pub fn load(config: &Config) -> Result<Self, RigError> {
        let Some(path) = &config.calibration else {
            return Ok(Self::default());
        };
        Self::at(path)
    }

    /// Of a folder or a session.
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

    /// These, and `newer` ones before those of the same name.
    #[must_use]
    pub fn with(mut self, newer: Self) -> Self {
        self.0.extend(newer.0);
        self
    }

    /// A file's bytes.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&[u8]> {
        let found = self.0.iter().rev().find(|file| file.name == name)?;
        Some(&found.data)
    }

    /// What they say of the rig; without a `rig.json`, what was calibrated of it, and guesses.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn document(&self, config: &Config) -> Result<RigDocument, RigError> {
        let attachments = |name: &str| self.get(name);
        Ok(match self.get("rig.json") {
            Some(_) => RigDocument::from_session(&attachments)?,
            None => RigDocument::without_rig_json(wanted_size(config), &attachments)?,
        })
    }

    /// All of them.
    #[must_use]
    pub fn all(&self) -> &[Attachment] {
        &self.0
    }
}

impl Live {
    /// The configured devices, not open yet. With `composed` false they are recorded alone.
    ///
    /// # Errors
    /// Files of the rig that cannot be read; a unit that contradicts them.
    pub fn new(config: &Config, composed: bool) -> Result<Self, RigError> {
        let files = RigFiles::load(config)?;
        let devices = Devices {
            scene_camera: Some(config.scene_camera.source.clone()),
            environment_camera: config.environment_camera.clone(),
            tracker: tracker(config, &files)?,
        };
        Ok(Self {
            hub: Hub::new(Arc::new(SystemClock), composed),
            devices: Arc::new(devices),
            capture: Arc::default(),
            files: Arc::new(files),
        })
    }

    /// Starts to supervise the devices.
    ///
    /// # Errors
    /// No more threads.
    pub fn open(&self) -> Result<(), RigError> {
        let capture = Capture::start(&self.devices, &self.hub)
            .map_err(|source| RigError::Thread { source })?;
        // Opening twice closes the second ones again.
        let _ = self.capture.set(capture);
        Ok(())
    }

    /// The devices, for somebody who must not keep them open.
    #[must_use]
    pub fn onlooker(&self) -> DeviceObserver {
        DeviceObserver(Arc::downgrade(&self.capture))
    }

    /// What is known of the devices.
    #[must_use]
    pub fn supervised(&self) -> &[LiveDevice] {
        self.capture.get().map_or(&[], Capture::devices)
    }
}

/// The tracker, told to measure in the unit that it was calibrated in: a recording keeps the
/// calibration and the bytes, and they must go together.
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
        (Some(told), Some(metres)) if (told.metres() - metres).abs() > 1e-6 => {
            return Err(RigError::Units { told, metres });
        }
        (None, Some(metres)) => tracker.units = TrackerUnits::from_metres(metres),
        _ => (),
    }
    Ok(source)
}

impl Source {
    /// A file that belongs to the rig.
    #[must_use]
    pub fn attachment(&self, name: &str) -> Option<&[u8]> {
        match self {
            Self::Recorded(session) => session.attachment(name),
            Self::Live(live) => live.files.get(name),
        }
    }

    /// What the rig's owner wrote down about it. A live rig may do without.
    pub(super) fn document(&self, config: &Config) -> Result<RigDocument, RigError> {
        match self {
            Self::Live(live) => live.files.document(config),
            Self::Recorded(session) => Ok(RigDocument::from_session(&|name: &str| {
                session.attachment(name)
            })?),
        }
    }

    /// There are pictures of an environment camera.
    #[must_use]
    pub fn has_environment(&self) -> bool {
        match self {
            Self::Recorded(session) => session.has_environment(),
            Self::Live(live) => live.devices.environment_camera.is_some(),
        }
    }

    /// What is played or seen, in a word.
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

    /// Share of a recording that has arrived by `at`.
    #[must_use]
    pub fn share_played(&self, at: MonotonicTime) -> Option<f64> {
        match self {
            Self::Recorded(session) => session.progress_at(at),
            Self::Live(_) => None,
        }
    }

    /// Devices deliver, now.
    #[must_use]
    pub const fn is_live(&self) -> bool {
        matches!(self, Self::Live(_))
    }
}

fn wanted_size(config: &Config) -> (u32, u32) {
    match &config.scene_camera.source {
        penumbra_config::CameraSource::System(s) if s.width > 0 && s.height > 0 => {
            (s.width, s.height)
        }
        _ => USUAL_SIZE,
    }
}
