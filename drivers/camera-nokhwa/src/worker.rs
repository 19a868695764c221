//! The thread of nokhwa's camera.

use crate::controls;
use crate::format;
use crate::slot::Slot;
use nokhwa::utils::CameraIndex;
use nokhwa::{Buffer, Camera, NokhwaError};
use penumbra_interface::{
    CameraSettings, Clock, ControlReport, DeviceError, Frame, MonotonicTime, StreamMode,
};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Maximum age of an arriving picture; if its time stamp is older, the wall clock has jumped.
const MAX_AGE: Duration = Duration::from_secs(5);

/// Mode and controls of the started stream.
pub(crate) struct Started {
    pub mode: StreamMode,
    pub controls: Arc<[ControlReport]>,
}

/// Opens the camera and streams until the slot is closed or the camera fails; the result of
/// opening is passed to `started`.
pub(crate) fn run(
    index: CameraIndex,
    device: &str,
    settings: &CameraSettings,
    clock: &dyn Clock,
    slot: &Slot,
    started: impl FnOnce(Result<Started, DeviceError>),
) {
    let (mut camera, mode) = match start(index, device, settings) {
        Ok((camera, start)) => {
            let mode = start.mode;
            started(Ok(start));
            (camera, mode)
        }
        Err(error) => return started(Err(error)),
    };
    let mut sequence = 0;
    loop {
        let frame = match camera.frame() {
            Ok(buffer) => frame(&buffer, &mode, sequence, clock.now()),
            Err(error) => {
                slot.fail(broken(device, &error));
                break;
            }
        };
        sequence += 1;
        if !slot.put(frame) {
            break;
        }
    }
    // The camera may be disconnected, and dropping it closes it anyway.
    let _ = camera.stop_stream();
}

fn start(
    index: CameraIndex,
    device: &str,
    settings: &CameraSettings,
) -> Result<(Camera, Started), DeviceError> {
    let failed = |error| broken(device, &error);
    let mut camera = Camera::new(index, format::requested(settings)).map_err(failed)?;
    camera.open_stream().map_err(failed)?;
    let streamed = camera.camera_format();
    let mode = format::mode(streamed).ok_or_else(|| DeviceError::Refused {
        device: device.to_owned(),
        reason: format!(
            "it streams {}, which Penumbra cannot read",
            streamed.format()
        ),
    })?;
    let controls = controls::apply(&mut camera, &settings.controls).into();
    Ok((camera, Started { mode, controls }))
}

fn frame(buffer: &Buffer, mode: &StreamMode, sequence: u64, arrived_at: MonotonicTime) -> Frame {
    let captured_at = age(buffer).map_or(arrived_at, |age| arrived_at - age);
    Frame {
        data: format::cut(&buffer.buffer_bytes(), mode),
        format: mode.format,
        width: mode.width,
        height: mode.height,
        stride: 0,
        sequence,
        captured_at,
        arrived_at,
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

/// The age of a picture by its time stamp, which is of the wall clock.
fn age(buffer: &Buffer) -> Option<Duration> {
    let stamp = buffer.capture_timestamp()?;
    // The time stamp is of the wall clock, so its age is measured by that clock.
    #[allow(clippy::disallowed_methods)]
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    now.checked_sub(stamp).filter(|age| *age <= MAX_AGE)
}

/// Converts an error of nokhwa. Its errors differ only in their texts, so all are treated as
/// recoverable by opening the camera again.
fn broken(device: &str, error: &NokhwaError) -> DeviceError {
    DeviceError::Broken {
        device: device.to_owned(),
        reason: error
            .to_string()
            .split_whitespace()
            .collect::<Vec<_>>()
            .join(" "),
    }
}
