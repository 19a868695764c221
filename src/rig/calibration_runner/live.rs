//! Shows a step of calibration what a live rig's devices deliver, beside everybody else.

use super::showing::Showing;
use penumbra_calibration::step::{Eye, Progress, Step, Wants};
use penumbra_capture::{FrameTap, Hub, Next, TapFilter, TapReader};
use penumbra_config::Config;
use penumbra_interface::{Clock, MonotonicTime, SystemClock};
use penumbra_picture::Picture;
use std::time::Duration;

/// How often it is told how it goes, and a wish is heard, while no picture comes.
const TELL_EVERY: Duration = Duration::from_millis(100);

/// How it goes at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Moment<'a> {
    /// How far the step is.
    pub progress: &'a Progress,
    /// The picture that it has just been shown, and whose it is.
    pub picture: Option<(Eye, &'a Picture)>,
    /// Since the beginning.
    pub seconds: f64,
    /// What it was shown so far, and what not.
    pub counts: ShownCounts,
}

/// What a step was shown, and what not.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ShownCounts {
    /// Pictures shown.
    pub pictures: u64,
    /// Pictures that could not be decoded.
    pub damaged: u64,
    /// Pictures skipped while the step was busy.
    pub skipped: u64,
    /// Readings of the tracker that found no room.
    pub readings_lost: u64,
}

/// What whoever is told wants next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Wish {
    /// More.
    #[default]
    GoOn,
    /// It shall conclude from what it has seen.
    Finish,
    /// Nothing shall come of it.
    Abort,
}

/// Why nothing more is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndedBy {
    /// Somebody asked.
    Asked,
    /// It has seen enough.
    Enough,
    /// The time that was given is over.
    TimeOver,
    /// The devices were closed.
    DevicesClosed,
    /// Nothing shall come of it.
    Aborted,
}

/// What a calibration is made with.
#[derive(Clone, Copy)]
pub struct LiveShow<'a> {
    /// What devices deliver comes by here. One step at a time can look on.
    pub hub: &'a Hub,
    /// How pictures are spelled.
    pub config: &'a Config,
    /// The tracker's unit, where the calibration says it.
    pub metres_per_unit: Option<f64>,
    /// The longest that it may take.
    pub longest: Option<Duration>,
}

impl LiveShow<'_> {
    /// Shows `step` what it wants until it has enough or `told`, which is called after every
    /// picture and ten times a second, wishes otherwise.
    pub fn show(&self, step: &mut dyn Step, told: &mut dyn FnMut(&Moment) -> Wish) -> EndedBy {
        let (tap, end) = FrameTap::new(filter(&step.wants()));
        self.hub.set_tap(Some(tap));
        let shown = self.watch(&end, step, told);
        self.hub.set_tap(None);
        shown
    }

    fn watch(
        &self,
        end: &TapReader,
        step: &mut dyn Step,
        told: &mut dyn FnMut(&Moment) -> Wish,
    ) -> EndedBy {
        let began = SystemClock.now();
        let mut showing: Option<Showing> = None;
        let mut pictures = 0;
        let mut told_at = began;
        loop {
            let next = end.next(TELL_EVERY);
            let is_over = matches!(next, Next::Ended);
            let mut eye = None;
            if let Next::Item(event) = next {
                let start = event.arrived_at();
                let showing =
                    showing.get_or_insert_with(|| Showing::new(start, self.metres_per_unit));
                eye = showing.show(event, self.config, step);
                pictures += u64::from(eye.is_some());
            }
            let now = SystemClock.now();
            if eye.is_none() && !is_over && !is_due(told_at, now) {
                continue;
            }
            told_at = now;
            let progress = step.progress();
            let showing = showing.as_ref();
            let wish = told(&Moment {
                progress: &progress,
                picture: eye.zip(showing.map(Showing::picture)),
                seconds: now.seconds_since(began),
                counts: ShownCounts {
                    pictures,
                    damaged: showing.map_or(0, |s| s.damaged as u64),
                    skipped: end.pictures_skipped(),
                    readings_lost: end.readings_lost(),
                },
            });
            match wish {
                Wish::Abort => return EndedBy::Aborted,
                Wish::Finish => return EndedBy::Asked,
                Wish::GoOn if progress.share >= 1.0 => return EndedBy::Enough,
                Wish::GoOn if is_over => return EndedBy::DevicesClosed,
                Wish::GoOn if self.is_late(began, now) => return EndedBy::TimeOver,
                Wish::GoOn => (),
            }
        }
    }

    fn is_late(&self, began: MonotonicTime, now: MonotonicTime) -> bool {
        let taken = now.seconds_since(began);
        self.longest.is_some_and(|most| taken >= most.as_secs_f64())
    }
}

fn is_due(told_at: MonotonicTime, now: MonotonicTime) -> bool {
    now.seconds_since(told_at) >= TELL_EVERY.as_secs_f64()
}

const fn filter(wants: &Wants) -> TapFilter {
    TapFilter {
        scene: wants.scene,
        environment: wants.environment,
        poses: wants.poses,
    }
}
