//! Finds, opens and reads a camera.

use crate::slot::Slot;
use crate::worker::{self, Started};
use nokhwa::utils::{ApiBackend, CameraIndex};
use penumbra_interface::{
    Camera, CameraCounters, CameraInfo, CameraReport, CameraSettings, Clock, DeviceError, Frame,
    MonotonicTime, StampSource,
};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::time::Duration;

/// Time limit for opening a camera; macOS asks its user for permission first.
const OPEN_TIMEOUT: Duration = Duration::from_secs(20);

/// Limitations of nokhwa, for the report.
const LIMITS: [&str; 2] = [
    "nokhwa: there is no frame counter, so lost frames are not noticed",
    "nokhwa: automatic modes cannot be switched off; do it in the system's settings",
];

/// A camera that streams through nokhwa.
struct NokhwaCamera {
    device: String,
    started: Started,
    slot: Arc<Slot>,
    clock: Arc<dyn Clock>,
    silence: Duration,
    last_frame: MonotonicTime,
    frames: u64,
    stamps: StampSource,
    notes: Arc<[String]>,
}

/// Opens the camera that the settings name: by its name or unique identity as
/// [`list_cameras`] gives them, or by its number; empty is the first one.
///
/// # Errors
/// There is no such camera, or the system cannot open it.
pub fn open(
    settings: &CameraSettings,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    if settings.bracket.is_some() {
        return Err(DeviceError::Refused {
            device: settings.device.clone(),
            reason: "nokhwa does not support bracketing; remove it from the settings".to_owned(),
        });
    }
    ask_permission(&settings.device)?;
    let (index, device) = find(&settings.device)?;
    let slot = Arc::new(Slot::default());
    let started = spawn(index, &device, settings, &slot, Arc::clone(&clock))?;
    let started = started.recv_timeout(OPEN_TIMEOUT).map_err(|_| {
        // If the camera opens later, its thread must end at once.
        slot.close();
        timed_out(&device)
    })??;
    Ok(Box::new(NokhwaCamera {
        device,
        started,
        slot,
        silence: settings.silence,
        last_frame: clock.now(),
        clock,
        frames: 0,
        stamps: StampSource::Arrival,
        notes: LIMITS.map(str::to_owned).into(),
    }))
}

/// On macOS, asks the user whether this program may use cameras; does nothing elsewhere.
fn ask_permission(device: &str) -> Result<(), DeviceError> {
    let (sender, receiver) = sync_channel(1);
    nokhwa::nokhwa_initialize(move |granted| {
        let _ = sender.try_send(granted);
    });
    match receiver.recv_timeout(OPEN_TIMEOUT) {
        Ok(true) => Ok(()),
        Ok(false) => Err(DeviceError::Refused {
            device: device.to_owned(),
            reason: "no permission; allow it in the system's settings, under privacy, camera"
                .to_owned(),
        }),
        Err(_) => Err(timed_out(device)),
    }
}

fn timed_out(device: &str) -> DeviceError {
    DeviceError::Silent {
        device: device.to_owned(),
        millis: u64::try_from(OPEN_TIMEOUT.as_millis()).unwrap_or(u64::MAX),
    }
}

type Opening = Receiver<Result<Started, DeviceError>>;

/// Starts the thread in which nokhwa waits. It ends with the first frame after the camera was
/// dropped, because nokhwa offers no way to wake it.
fn spawn(
    index: CameraIndex,
    device: &str,
    settings: &CameraSettings,
    slot: &Arc<Slot>,
    clock: Arc<dyn Clock>,
) -> Result<Opening, DeviceError> {
    let (sender, receiver) = sync_channel(1);
    let (slot, settings, name) = (Arc::clone(slot), settings.clone(), device.to_owned());
    let work = move || {
        let started = |outcome| {
            // An error means that opening has timed out; the slot is then closed, too.
            let _ = sender.send(outcome);
        };
        worker::run(index, &name, &settings, &*clock, &slot, started);
    };
    // nokhwa blocks without a time limit, and its camera cannot change threads.
    #[allow(clippy::disallowed_methods)]
    let thread = std::thread::Builder::new()
        .name("nokhwa".to_owned())
        .spawn(work);
    thread.map_err(|error| DeviceError::Broken {
        device: device.to_owned(),
        reason: format!("starting its thread: {error}"),
    })?;
    Ok(receiver)
}

/// Lists the cameras of the system. Their formats and controls are not queried, because that
/// would switch each of them on.
#[must_use]
pub fn list_cameras() -> Vec<CameraInfo> {
    let found = nokhwa::query(ApiBackend::Auto).unwrap_or_default();
    let described = found.into_iter().map(|camera| CameraInfo {
        identity: identity(&camera),
        name: camera.human_name(),
        driver: "nokhwa".to_owned(),
        node: camera.index().to_string(),
        trouble: Some("nokhwa can query formats and controls of an open camera only".to_owned()),
        ..CameraInfo::default()
    });
    described.collect()
}

/// The unique identity on macOS and Windows, and the name on Linux, where nokhwa has no other
/// identity.
fn identity(camera: &nokhwa::utils::CameraInfo) -> String {
    let unique = camera.misc();
    if unique.is_empty() || cfg!(target_os = "linux") {
        return camera.human_name();
    }
    unique
}

fn find(device: &str) -> Result<(CameraIndex, String), DeviceError> {
    let found = nokhwa::query(ApiBackend::Auto).map_err(|error| DeviceError::Broken {
        device: device.to_owned(),
        reason: error.to_string(),
    })?;
    let is_meant = |camera: &&nokhwa::utils::CameraInfo| {
        device.is_empty()
            || identity(camera) == device
            || camera.human_name() == device
            || camera.index().to_string() == device
    };
    let camera = found
        .iter()
        .find(is_meant)
        .ok_or_else(|| DeviceError::NotFound {
            device: if device.is_empty() {
                "any camera"
            } else {
                device
            }
            .to_owned(),
        })?;
    Ok((camera.index().clone(), identity(camera)))
}

impl Camera for NokhwaCamera {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let frame = self.slot.take(timeout)?;
        let now = self.clock.now();
        if let Some(frame) = &frame {
            self.last_frame = now;
            self.frames += 1;
            self.stamps = if frame.captured_at == frame.arrived_at {
                StampSource::Arrival
            } else {
                StampSource::WallClock
            };
            return Ok(Some(frame.clone()));
        }
        let silent = u64::try_from(now.nanos_since(self.last_frame)).unwrap_or(0);
        if Duration::from_nanos(silent) < self.silence {
            return Ok(None);
        }
        Err(DeviceError::Silent {
            device: self.device.clone(),
            millis: silent / 1_000_000,
        })
    }

    fn report(&self) -> CameraReport {
        CameraReport {
            identity: self.device.clone(),
            mode: Some(self.started.mode),
            stamps: self.stamps,
            controls: Arc::clone(&self.started.controls),
            counters: CameraCounters {
                frames: self.frames,
                superseded: self.slot.superseded(),
                ..CameraCounters::default()
            },
            notes: Arc::clone(&self.notes),
        }
    }
}

impl Drop for NokhwaCamera {
    fn drop(&mut self) {
        self.slot.close();
    }
}
