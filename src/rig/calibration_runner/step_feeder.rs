//! Decodes recorded or delivered events and passes them to a calibration step.

use crate::feed::decoder_for;
use penumbra_calibration::step::{CameraRole, PictureInput, Step, StepInput};
use penumbra_config::Config;
use penumbra_interface::{Frame, MonotonicTime};
use penumbra_picture::{Picture, decode_into};
use penumbra_session::SessionEvent;
use penumbra_tracker_serial::AnyDecoder;
use std::sync::Arc;

/// Decodes events and passes them to a step in the order of arrival.
pub(super) struct StepFeeder {
    start: MonotonicTime,
    /// Earliest time of the next picture of a camera and bracket (hundredths of a stop), seconds
    /// since `start`.
    next: Vec<((CameraRole, i64), f64)>,
    picture: Picture,
    tracker: Option<(Arc<str>, AnyDecoder)>,
    metres_per_unit: Option<f64>,
    /// Number of pictures that could not be decoded and of file sections that could not be read.
    pub damaged: usize,
}

impl StepFeeder {
    /// Creates a feeder for events from `start` on. `metres_per_unit` is the tracker's unit of
    /// length; `None` if the calibration does not state it.
    pub fn new(start: MonotonicTime, metres_per_unit: Option<f64>) -> Self {
        Self {
            start,
            next: Vec::new(),
            picture: Picture::default(),
            tracker: None,
            metres_per_unit,
            damaged: 0,
        }
    }

    /// Returns the last decoded picture.
    pub const fn picture(&self) -> &Picture {
        &self.picture
    }

    /// Passes an event to `step` if the step needs it. Returns the camera if the event was a
    /// picture and was passed on.
    pub fn feed(
        &mut self,
        event: SessionEvent,
        config: &Config,
        step: &mut dyn Step,
    ) -> Option<CameraRole> {
        let wants = step.inputs();
        let (camera, frame) = match event {
            SessionEvent::Scene(frame) if wants.scene => (CameraRole::Scene, frame),
            SessionEvent::Environment(frame) if wants.environment => {
                (CameraRole::Environment, frame)
            }
            SessionEvent::TrackerBytes {
                protocol,
                bytes,
                arrived_at,
            } if wants.poses => {
                self.decoder(&protocol).push(&bytes, arrived_at, |sample| {
                    step.observe(&StepInput::Pose(&sample))
                });
                return None;
            }
            SessionEvent::Pose(sample) if wants.poses => {
                step.observe(&StepInput::Pose(&sample));
                return None;
            }
            _ => return None,
        };
        if frame.bracket_ev != 0.0 && !wants.brackets || !self.is_due(camera, &frame, wants.spacing)
        {
            return None;
        }
        if decode_into(&frame, &config.input.encoding(), &mut self.picture).is_err() {
            self.damaged += 1;
            return None;
        }
        step.observe(&StepInput::Picture(PictureInput {
            camera,
            picture: &self.picture,
            captured_at: frame.captured_at,
            bracket_ev: frame.bracket_ev,
            exposure: frame.exposure.map(|e| 1e-6 * e.exposure_micros * e.gain),
            seconds: frame.arrived_at.seconds_since(self.start),
        }));
        Some(camera)
    }

    fn is_due(&mut self, camera: CameraRole, frame: &Frame, spacing: f64) -> bool {
        let key = (camera, (100.0 * frame.bracket_ev).round() as i64);
        let at = frame.arrived_at.seconds_since(self.start);
        let known = self.next.iter().position(|(k, _)| *k == key);
        let i = known.unwrap_or_else(|| {
            self.next.push((key, f64::MIN));
            self.next.len() - 1
        });
        let due = at >= self.next[i].1;
        if due {
            self.next[i].1 = at + spacing;
        }
        due
    }

    fn decoder(&mut self, protocol: &Arc<str>) -> &mut AnyDecoder {
        let known = self.tracker.take().filter(|(known, _)| known == protocol);
        let (_, decoder) = self.tracker.insert(known.unwrap_or_else(|| {
            let decoder = decoder_for(protocol, self.metres_per_unit);
            (Arc::clone(protocol), decoder)
        }));
        decoder
    }
}
