//! A camera that streams: the buffer loop, the locked controls and the bracketing combined.

mod bracketed;

use crate::controls::CameraControls;
use crate::device::{Capabilities, CaptureFormat, Formats, VideoDevice};
use crate::error::{self, MULTIPLANAR, NOT_A_CAMERA, refused};
use crate::fourcc;
use crate::identity::{self, SystemRoots};
use crate::kernel::V4l2Device;
use crate::mode;
use crate::stream::{FrameLayout, Stream, StreamFrame, StreamItem};
use bracketed::BracketedExposure;
use penumbra_interface::{
    Camera, CameraCounters, CameraReport, CameraSettings, Clock, DeviceError, Frame, StreamMode,
    middle_of_exposure,
};
use rustix::io::Errno;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

/// Opens the camera that the settings name, locks its controls and starts its stream.
///
/// # Errors
/// The camera is missing, in use or disconnected, may not be used, is not a camera, or does
/// not offer the mode. The message includes a remedy.
pub fn open(
    settings: &CameraSettings,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    let probe = |path: &Path| V4l2Device::open(path).ok()?.capabilities().ok();
    let node = identity::resolve(&settings.device, &SystemRoots::default(), probe)?;
    let device = V4l2Device::open(&node.path).map_err(|e| error::open_failed(&node.path, e))?;
    let bus = device.capabilities().map(|c| c.bus).ok();
    let names = CameraNames {
        identity: node.identity(bus.as_deref()),
        path: node.path.display().to_string(),
        is_numbered: settings.device.starts_with("/dev/video"),
    };
    Ok(Box::new(V4l2Camera::start(device, names, settings, clock)?))
}

/// The names of a camera.
pub(crate) struct CameraNames {
    /// The most durable name for the settings.
    pub identity: String,
    /// The device file, which error messages name.
    pub path: String,
    /// The settings use a device number, which changes when devices are unplugged.
    pub is_numbered: bool,
}

/// A camera that streams.
pub(crate) struct V4l2Camera<D: VideoDevice> {
    names: CameraNames,
    stream: Stream<D>,
    layout: FrameLayout,
    mode: StreamMode,
    controls: CameraControls,
    bracketed: Option<BracketedExposure>,
    clock: Arc<dyn Clock>,
    frames: u64,
    unattributed: u64,
    notes: Vec<String>,
}

impl<D: VideoDevice> V4l2Camera<D> {
    /// Sets mode and controls and starts the stream. Controls are set once more afterwards,
    /// because some cameras reset them when a stream starts.
    pub(crate) fn start(
        mut device: D,
        names: CameraNames,
        settings: &CameraSettings,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let path = names.path.clone();
        let failed = |step| {
            let path = path.clone();
            move |errno| error::setup_failed(&path, step, errno)
        };
        let capabilities = capabilities(&device, &path)?;
        let mut notes = numbering_note(&names).into_iter().collect();
        let capture = set_mode(&mut device, settings, &path, &mut notes)?;
        let layout = FrameLayout::of(&capture).ok_or_else(|| {
            let fourcc = fourcc::to_text(capture.fourcc);
            refused(
                &path,
                format!("it only gives {fourcc}, which Penumbra cannot read"),
            )
        })?;
        let mut controls = CameraControls::new(&device, settings);
        let set = controls.apply(&mut device);
        set.map_err(failed("setting controls"))?;
        let bracketed = BracketedExposure::prepare(&mut device, &mut controls, settings, &path)?;
        let buffering = (settings.buffers, settings.silence);
        let mut stream = Stream::start(device, &path, layout, buffering, Arc::clone(&clock))?;
        stream.timestamps.start_is_first_bytes =
            capabilities.driver == "uvcvideo" && !uvc_uses_camera_clock();
        let set = controls.apply(&mut stream.device);
        set.map_err(failed("setting controls"))?;
        if let Some(bracketed) = &bracketed {
            let set = bracketed.set_base(&mut stream.device);
            set.map_err(failed("setting the base exposure"))?;
        }
        controls.subscribe(&mut stream.device);
        Ok(Self {
            names,
            stream,
            layout,
            mode: stream_mode(&capture, &layout),
            controls,
            bracketed,
            clock,
            frames: 0,
            unattributed: 0,
            notes,
        })
    }

    /// Labels a frame with its exposure; `None` if the exposure is not certain.
    fn label(&mut self, frame: StreamFrame) -> Result<Option<Frame>, DeviceError> {
        let (exposure, bracket_ev, in_force) = match &mut self.bracketed {
            None => (self.controls.exposure(), 0.0, self.controls.in_force()),
            Some(bracketed) => {
                let device = &mut self.stream.device;
                let label = bracketed.label(&frame, &self.layout, &self.controls, device);
                let label =
                    label.map_err(|e| error::stream_failed(&self.names.path, "bracketing", e))?;
                let Some((exposure, ev, in_force)) = label else {
                    self.unattributed += 1;
                    return Ok(None);
                };
                (Some(exposure), ev, in_force)
            }
        };
        let micros = exposure.map(|exposure| exposure.exposure_micros);
        self.frames += 1;
        Ok(Some(Frame {
            data: frame.data,
            format: self.layout.format,
            width: self.layout.width,
            height: self.layout.height,
            stride: self.layout.stride,
            sequence: frame.sequence,
            captured_at: middle_of_exposure(frame.timestamp, frame.timestamp_source, micros),
            arrived_at: frame.arrived_at,
            exposure,
            bracket_ev,
            controls: Some(in_force),
        }))
    }

    fn watch_controls(&mut self, has_events: bool) -> Result<(), DeviceError> {
        let (device, now) = (&mut self.stream.device, self.clock.now());
        let watched = if has_events {
            self.controls.on_events(device, now)
        } else {
            self.controls.tick(device, now)
        };
        watched.map_err(|e| error::stream_failed(&self.names.path, "watching controls", e))
    }

    fn notes(&self) -> Arc<[String]> {
        let mut notes = self.notes.clone();
        notes.extend(self.bracketed.as_ref().and_then(|b| b.timing_note()));
        notes.extend(self.controls.changes_note());
        if self.stream.without_end_marker > 0 {
            notes.push("its JPEG frames have no end marker; it is added".to_owned());
        }
        let implausible = self.stream.timestamps.implausible;
        if implausible > 0 {
            notes.push(format!(
                "{implausible} time stamps are implausible; the time of arrival is used instead"
            ));
        }
        notes.into()
    }
}

impl<D: VideoDevice> Camera for V4l2Camera<D> {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let until = self.clock.now() + timeout;
        self.watch_controls(false)?;
        loop {
            let left = until.nanos_since(self.clock.now());
            let left = Duration::from_nanos(u64::try_from(left).unwrap_or(0));
            match self.stream.next(left)? {
                StreamItem::TimedOut => return Ok(None),
                StreamItem::ControlEvent => self.watch_controls(true)?,
                StreamItem::Frame(frame) => {
                    if let Some(frame) = self.label(frame)? {
                        return Ok(Some(frame));
                    }
                }
            }
        }
    }

    fn report(&self) -> CameraReport {
        CameraReport {
            identity: self.names.identity.clone(),
            mode: Some(self.mode),
            stamps: self.stream.timestamps.source,
            controls: self.controls.report(),
            counters: CameraCounters {
                frames: self.frames,
                unattributed: self.unattributed,
                controls_changed: self.controls.changes,
                ..self.stream.counters
            },
            notes: self.notes(),
        }
    }
}

/// The capabilities of a camera that this driver can use.
fn capabilities(device: &impl Formats, path: &str) -> Result<Capabilities, DeviceError> {
    let capabilities = device.capabilities().map_err(|errno| match errno {
        // The device does not know the command.
        Errno::NOTTY | Errno::INVAL => refused(path, NOT_A_CAMERA),
        other => error::setup_failed(path, "querying its capabilities", other),
    })?;
    let Capabilities {
        captures,
        multiplanar,
        streams,
        ..
    } = capabilities;
    match (captures, multiplanar, streams) {
        (true, _, true) => Ok(capabilities),
        (true, _, false) => Err(refused(path, "it has no streaming, only read()")),
        (false, true, _) => Err(refused(path, MULTIPLANAR)),
        (false, false, _) => Err(refused(path, NOT_A_CAMERA)),
    }
}

fn set_mode(
    device: &mut impl Formats,
    settings: &CameraSettings,
    path: &str,
    notes: &mut Vec<String>,
) -> Result<CaptureFormat, DeviceError> {
    let failed = |e| error::setup_failed(path, "setting the format", e);
    let present = device.format().map_err(failed)?;
    let wanted = mode::choose(&device.formats(), settings, &present);
    let wanted = wanted.map_err(|message| refused(path, message))?;
    let got = device.set_format(&wanted).map_err(failed)?;
    notes.extend(mode::deviation_note(settings, &wanted, &got));
    Ok(got)
}

/// Whether `uvcvideo` is configured to take time stamps from the cameras' own clocks.
fn uvc_uses_camera_clock() -> bool {
    let parameter = std::fs::read_to_string("/sys/module/uvcvideo/parameters/hwtimestamps");
    parameter.is_ok_and(|value| value.trim() != "0")
}

fn numbering_note(names: &CameraNames) -> Option<String> {
    let CameraNames {
        identity,
        path,
        is_numbered,
    } = names;
    (*is_numbered && identity != path).then(|| {
        format!("the number of {path} changes when devices are unplugged; write {identity}")
    })
}

fn stream_mode(capture: &CaptureFormat, layout: &FrameLayout) -> StreamMode {
    StreamMode {
        width: capture.width,
        height: capture.height,
        format: layout.format,
        frames_per_second: capture.frames_per_second,
    }
}

#[cfg(test)]
mod tests;
