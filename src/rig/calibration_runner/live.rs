//! Runs a calibration step on what the devices of a live rig deliver, beside their other users.

use super::step_feeder::StepFeeder;
use penumbra_calibration::step::{CameraRole, Progress, Step, StepInputs};
use penumbra_capture::{FrameTap, Hub, Next, TapFilter, TapReader};
use penumbra_config::Config;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_picture::Picture;
use std::time::Duration;

/// Interval of updates while no picture arrives.
const UPDATE_INTERVAL: Duration = Duration::from_millis(100);

/// The state of a running step.
#[derive(Clone, Copy, Debug)]
pub struct StepUpdate<'a> {
    /// The step's progress.
    pub progress: &'a Progress,
    /// The picture that the step has just observed, with its camera.
    pub picture: Option<(CameraRole, &'a Picture)>,
    /// Time since the start of the step, seconds.
    pub seconds: f64,
    /// Numbers of inputs so far.
    pub counts: InputCounts,
}

/// Numbers of inputs that a step has observed and missed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InputCounts {
    /// Pictures observed.
    pub pictures: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// Pictures that arrived while the step was busy.
    pub passed_over: u64,
    /// Tracker readings that were lost because the queue was full.
    pub readings_lost: u64,
}

/// Request to a running step, returned by the receiver of its updates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum StepRequest {
    /// Continue.
    #[default]
    Continue,
    /// Stop observing and evaluate.
    Finish,
    /// Stop without a result.
    Abort,
}

/// Why a step stopped observing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndReason {
    /// [`StepRequest::Finish`].
    Requested,
    /// The step has enough data.
    Complete,
    /// The time limit is reached.
    TimeLimit,
    /// The devices were closed.
    DevicesClosed,
    /// [`StepRequest::Abort`].
    Aborted,
}

/// The live input of a step.
#[derive(Clone, Copy)]
pub struct LiveFeed<'a> {
    /// The queue of all deliveries. Only one step at a time can read it.
    pub hub: &'a Hub,
    /// The settings, for the encoding of pictures.
    pub config: &'a Config,
    /// The tracker's unit of length; `None` if the calibration does not state it.
    pub metres_per_unit: Option<f64>,
    /// Maximum duration.
    pub time_limit: Option<Duration>,
}

impl LiveFeed<'_> {
    /// Passes the deliveries that `step` needs to it until it has enough data, the time limit is
    /// reached, the devices are closed, or `report` requests an end. `report` is called after every
    /// picture, and ten times a second while none arrives.
    pub fn run(
        &self,
        step: &mut dyn Step,
        report: &mut dyn FnMut(&StepUpdate) -> StepRequest,
    ) -> EndReason {
        let (tap, reader) = FrameTap::new(filter(&step.inputs()));
        self.hub.set_tap(Some(tap));
        let reason = self.feed(&reader, step, report);
        self.hub.set_tap(None);
        reason
    }

    fn feed(
        &self,
        reader: &TapReader,
        step: &mut dyn Step,
        report: &mut dyn FnMut(&StepUpdate) -> StepRequest,
    ) -> EndReason {
        let started_at = SystemClock.now();
        let mut feeder: Option<StepFeeder> = None;
        let mut pictures = 0;
        let mut reported_at = started_at;
        loop {
            let next = reader.next(UPDATE_INTERVAL);
            let is_closed = matches!(next, Next::Ended);
            let mut camera = None;
            if let Next::Item(event) = next {
                let start = event.arrived_at();
                let feeder =
                    feeder.get_or_insert_with(|| StepFeeder::new(start, self.metres_per_unit));
                camera = feeder.feed(event, self.config, step);
                pictures += u64::from(camera.is_some());
            }
            let now = SystemClock.now();
            if camera.is_none() && !is_closed && !is_due(reported_at, now) {
                continue;
            }
            reported_at = now;
            let progress = step.progress();
            let feeder = feeder.as_ref();
            let request = report(&StepUpdate {
                progress: &progress,
                picture: camera.zip(feeder.map(StepFeeder::picture)),
                seconds: now.seconds_since(started_at),
                counts: InputCounts {
                    pictures,
                    damaged: feeder.map_or(0, |f| f.damaged as u64),
                    passed_over: reader.pictures_skipped(),
                    readings_lost: reader.readings_lost(),
                },
            });
            match request {
                StepRequest::Abort => return EndReason::Aborted,
                StepRequest::Finish => return EndReason::Requested,
                StepRequest::Continue if progress.share >= 1.0 => return EndReason::Complete,
                StepRequest::Continue if is_closed => return EndReason::DevicesClosed,
                StepRequest::Continue if self.is_time_over(started_at, now) => {
                    return EndReason::TimeLimit;
                }
                StepRequest::Continue => (),
            }
        }
    }

    fn is_time_over(&self, started_at: MonotonicTime, now: MonotonicTime) -> bool {
        let elapsed = now.seconds_since(started_at);
        self.time_limit
            .is_some_and(|limit| elapsed >= limit.as_secs_f64())
    }
}

fn is_due(reported_at: MonotonicTime, now: MonotonicTime) -> bool {
    now.seconds_since(reported_at) >= UPDATE_INTERVAL.as_secs_f64()
}

const fn filter(wants: &StepInputs) -> TapFilter {
    TapFilter {
        scene: wants.scene,
        environment: wants.environment,
        poses: wants.poses,
    }
}
