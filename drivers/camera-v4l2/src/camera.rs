//! A camera that streams: the buffer loop, the contract about controls and the bracketing
//! put together.

mod cycled;

use crate::contract::Contract;
use crate::fourcc;
use crate::identity::{self, Roots};
use crate::kernel::Node;
use crate::mode;
use crate::stream::{Layout, Next, Stream, Taken};
use crate::trouble;
use crate::video::{Capabilities, Geometry, Modes, Video};
use cycled::Cycled;
use penumbra_interface::{
    Camera, CameraCounters, CameraReport, CameraSettings, Clock, DeviceError, Frame, StreamMode,
    middle_of_exposure,
};
use rustix::io::Errno;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

pub(crate) const MULTIPLANAR: &str = "a multi-planar capture device (usually a camera without \
    its image processor); use it through libcamera's V4L2 compatibility layer";

pub(crate) const NO_CAMERA: &str = "no camera (metadata, an output, a codec or another kind of device); \
    `penumbra devices` lists the cameras";

/// Opens the camera that the settings name, locks its controls and starts its stream.
///
/// # Errors
/// Each says what is wrong and what to do: not there, in use, no permission, no camera, a
/// mode that it does not offer.
pub fn open(
    settings: &CameraSettings,
    clock: Arc<dyn Clock>,
) -> Result<Box<dyn Camera>, DeviceError> {
    let probe = |node: &Path| Node::open(node).ok()?.capabilities().ok();
    let place = identity::resolve(&settings.device, &Roots::default(), probe)?;
    let node = Node::open(&place.node).map_err(|e| trouble::on_open(&place.node, e))?;
    let bus = node.capabilities().map(|c| c.bus).ok();
    let who = Who {
        identity: place.identity(bus.as_deref()),
        device: place.node.display().to_string(),
        by_number: settings.device.starts_with("/dev/video"),
    };
    Ok(Box::new(V4l2Camera::start(node, who, settings, clock)?))
}

/// Names of a camera.
pub(crate) struct Who {
    pub identity: String,
    /// In errors: the device file.
    pub device: String,
    /// Named by a number that replugging changes.
    pub by_number: bool,
}

/// A camera that streams.
pub(crate) struct V4l2Camera<V: Video> {
    who: Who,
    stream: Stream<V>,
    layout: Layout,
    mode: StreamMode,
    contract: Contract,
    cycled: Option<Cycled>,
    clock: Arc<dyn Clock>,
    frames: u64,
    unattributed: u64,
    notes: Vec<String>,
}

impl<V: Video> V4l2Camera<V> {
    /// Sets up and starts: mode, controls, stream, and the controls again, because some
    /// cameras forget them when their stream starts.
    pub(crate) fn start(
        mut video: V,
        who: Who,
        settings: &CameraSettings,
        clock: Arc<dyn Clock>,
    ) -> Result<Self, DeviceError> {
        let device = who.device.clone();
        let failed = |what| {
            let device = device.clone();
            move |error| trouble::on_setup(&device, what, error)
        };
        let capabilities = video.capabilities().map_err(|error| match error {
            // Other device files can be opened, too, and know nothing of this question.
            Errno::NOTTY | Errno::INVAL => refused(&device, NO_CAMERA.to_owned()),
            other => trouble::on_setup(&device, "asking who it is", other),
        })?;
        check_kind(&capabilities).map_err(|reason| refused(&device, reason))?;
        let mut notes = notes(&who);
        let geometry = choose_mode(&mut video, settings, &device, &mut notes)?;
        let layout = Layout::of(&geometry).ok_or_else(|| {
            let fourcc = fourcc::text(geometry.fourcc);
            refused(
                &device,
                format!("it insists on {fourcc}, which Penumbra does not read"),
            )
        })?;
        let mut contract = Contract::new(&video, settings);
        contract
            .apply(&mut video)
            .map_err(failed("setting controls"))?;
        let cycled = Cycled::prepare(&mut video, &mut contract, settings, &device)?;
        let buffering = (settings.buffers, settings.silence);
        let mut stream = Stream::start(video, &device, layout, buffering, Arc::clone(&clock))?;
        stream.stamps.first_bytes = capabilities.driver == "uvcvideo" && !uvc_stamps_by_camera();
        contract
            .apply(&mut stream.video)
            .map_err(failed("setting controls"))?;
        if let Some(cycled) = &cycled {
            cycled
                .restart(&mut stream.video)
                .map_err(failed("setting the base exposure"))?;
        }
        contract.watch(&mut stream.video);
        Ok(Self {
            who,
            stream,
            layout,
            mode: stream_mode(&geometry, &layout),
            contract,
            cycled,
            clock,
            frames: 0,
            unattributed: 0,
            notes,
        })
    }

    /// A frame from a picture; `None` if its exposure is not certain.
    fn frame(&mut self, taken: Taken) -> Result<Option<Frame>, DeviceError> {
        let (exposure, bracket_ev, controls) = match &mut self.cycled {
            None => (self.contract.exposure(), 0.0, self.contract.in_force()),
            Some(cycled) => {
                let video = &mut self.stream.video;
                let labelled = cycled.label(&taken, &self.layout, &self.contract, video);
                let labelled =
                    labelled.map_err(|e| trouble::on_stream(&self.who.device, "bracketing", e))?;
                let Some((exposure, ev, controls)) = labelled else {
                    self.unattributed += 1;
                    return Ok(None);
                };
                (Some(exposure), ev, controls)
            }
        };
        let micros = exposure.map(|exposure| exposure.exposure_micros);
        self.frames += 1;
        Ok(Some(Frame {
            data: taken.data,
            format: self.layout.format,
            width: self.layout.width,
            height: self.layout.height,
            stride: self.layout.stride,
            sequence: taken.sequence,
            captured_at: middle_of_exposure(taken.stamp, taken.stamp_source, micros),
            arrived_at: taken.arrived_at,
            exposure,
            bracket_ev,
            controls: Some(controls),
        }))
    }

    fn watch_controls(&mut self, events: bool) -> Result<(), DeviceError> {
        let (video, now) = (&mut self.stream.video, self.clock.now());
        let watched = if events {
            self.contract.on_events(video, now)
        } else {
            self.contract.tick(video, now)
        };
        watched.map_err(|e| trouble::on_stream(&self.who.device, "watching controls", e))
    }

    fn notes(&self) -> Arc<[String]> {
        let mut notes = self.notes.clone();
        notes.extend(self.cycled.as_ref().and_then(|c| c.finding()));
        notes.extend(self.contract.tampering());
        if self.stream.unended > 0 {
            notes.push("its JPEGs have no end marker; it was added".to_owned());
        }
        let implausible = self.stream.stamps.implausible;
        if implausible > 0 {
            notes.push(format!(
                "{implausible} stamps could not be true: arrival taken instead"
            ));
        }
        notes.into()
    }
}

impl<V: Video> Camera for V4l2Camera<V> {
    fn next_frame(&mut self, timeout: Duration) -> Result<Option<Frame>, DeviceError> {
        let until = self.clock.now() + timeout;
        self.watch_controls(false)?;
        loop {
            let left = until.nanos_since(self.clock.now());
            let left = Duration::from_nanos(u64::try_from(left).unwrap_or(0));
            match self.stream.next(left)? {
                Next::Nothing => return Ok(None),
                Next::Event => self.watch_controls(true)?,
                Next::Picture(taken) => {
                    if let Some(frame) = self.frame(taken)? {
                        return Ok(Some(frame));
                    }
                }
            }
        }
    }

    fn report(&self) -> CameraReport {
        CameraReport {
            identity: self.who.identity.clone(),
            mode: Some(self.mode),
            stamps: self.stream.stamps.source,
            controls: self.contract.report(),
            counters: CameraCounters {
                frames: self.frames,
                unattributed: self.unattributed,
                controls_changed: self.contract.changed,
                ..self.stream.counters
            },
            notes: self.notes(),
        }
    }
}

pub(crate) fn refused(device: &str, reason: String) -> DeviceError {
    DeviceError::Refused {
        device: device.to_owned(),
        reason,
    }
}

fn check_kind(capabilities: &Capabilities) -> Result<(), String> {
    let Capabilities {
        captures,
        multiplanar,
        streams,
        ..
    } = *capabilities;
    match (captures, multiplanar, streams) {
        (true, _, true) => Ok(()),
        (true, _, false) => Err("it offers no streaming, only read()".to_owned()),
        (false, true, _) => Err(MULTIPLANAR.to_owned()),
        (false, false, _) => Err(NO_CAMERA.to_owned()),
    }
}

fn choose_mode(
    video: &mut impl Video,
    settings: &CameraSettings,
    device: &str,
    notes: &mut Vec<String>,
) -> Result<Geometry, DeviceError> {
    let failed = |e| trouble::on_setup(device, "choosing the format", e);
    let present = video.geometry().map_err(failed)?;
    let wanted = mode::choose(&video.formats(), settings, &present);
    let wanted = wanted.map_err(|reason| refused(device, reason))?;
    let got = video.set_geometry(&wanted).map_err(failed)?;
    notes.extend(mode::difference(settings, &wanted, &got));
    Ok(got)
}

/// Whether `uvcvideo` was told to trust the cameras' own clocks.
fn uvc_stamps_by_camera() -> bool {
    let told = std::fs::read_to_string("/sys/module/uvcvideo/parameters/hwtimestamps");
    told.is_ok_and(|told| told.trim() != "0")
}

fn notes(who: &Who) -> Vec<String> {
    let numbered = who.by_number && who.identity != who.device;
    numbered
        .then(|| {
            let Who {
                device, identity, ..
            } = who;
            format!("the number of {device} changes when devices are replugged; write {identity}")
        })
        .into_iter()
        .collect()
}

fn stream_mode(geometry: &Geometry, layout: &Layout) -> StreamMode {
    StreamMode {
        width: geometry.width,
        height: geometry.height,
        format: layout.format,
        frames_per_second: geometry.frames_per_second,
    }
}

#[cfg(test)]
mod tests;
