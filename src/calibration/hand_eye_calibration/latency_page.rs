//! What the step `latency` shows.

use super::latency::{LatencyStep, Offsets, turns};
use crate::latency::follow::Means;
use crate::latency::{CameraMotion, TrackerTrack};
use crate::report::{Page, Plot};
use crate::step::{Finished, Made};

/// Steps of the drawn correlation, seconds.
const STEP: f64 = 0.002;

impl LatencyStep {
    pub(super) fn page(&self, made: &Made, found: &Finished, offsets: Option<&Offsets>) -> String {
        let facts = [
            format!("{}, from {}", made.date, made.source),
            format!(
                "{} pictures, {} with poses; {} readings of the tracker",
                self.scene.pictures,
                self.sightings.len(),
                self.readings.len()
            ),
        ];
        let mut page = Page::new("Latency of tracker and cameras", &facts);
        page.verdict(found);
        if let (Some(zero), Some(track)) = (self.zero, self.track()) {
            let scene = offsets.and_then(|o| o.scene.as_ref().ok());
            let by_poses: Vec<Amount> = turns(&self.sightings, zero)
                .iter()
                .map(|t| Amount {
                    from: t.from,
                    to: t.to,
                    amount: t.rotation.to_scaled_axis().length(),
                })
                .collect();
            let by_flow = amounts(&self.scene.motions(zero));
            let shown = match scene {
                Some((_, Means::Poses)) => &by_poses,
                _ => &by_flow,
            };
            let offset = scene.map_or(0.0, |s| s.0.seconds);
            self.draw(&mut page, "scene camera", &track, shown, offset);
            if self.environment.pictures > 0 {
                let found = offsets.and_then(|o| o.environment.as_ref()?.as_ref().ok());
                let offset = found.map_or(0.0, |f| f.seconds);
                let motions = amounts(&self.environment.motions(zero));
                self.draw(&mut page, "environment camera", &track, &motions, offset);
            }
        }
        page.finish()
    }

    fn draw(
        &self,
        page: &mut Page,
        camera: &str,
        track: &TrackerTrack,
        seen: &[Amount],
        offset: f64,
    ) {
        page.heading(camera);
        let by_tracker = speeds(track, seen, offset);
        let scale = scale(&by_tracker);
        let camera_speeds: Vec<(f64, f64)> = by_tracker
            .iter()
            .map(|(t, _, camera)| (*t, camera * scale))
            .collect();
        let tracker: Vec<(f64, f64)> = by_tracker.iter().map(|(t, v, _)| (*t, *v)).collect();
        let plot = Plot {
            x: "s".to_owned(),
            y: "speed of turn, rad/s".to_owned(),
            series: vec![
                ("by the tracker, offset taken off".to_owned(), tracker, true),
                (format!("by the {camera}, scaled"), camera_speeds, true),
            ],
        };
        page.plot(&plot, "How both turn");
        let steps = (self.options.range / STEP) as i32;
        let curve = (-steps..=steps)
            .map(|i| f64::from(i) * STEP)
            .filter_map(|o| {
                let speeds = speeds(track, seen, o);
                Some((1e3 * o, correlation(&speeds)?))
            });
        let plot = Plot {
            x: "tracker's clock ahead of the camera's, ms".to_owned(),
            y: "correlation of the speeds".to_owned(),
            series: vec![("correlation".to_owned(), curve.collect(), true)],
        };
        page.plot(&plot, "Which offset fits");
    }
}

/// How much moved between two pictures, in any unit; seconds.
struct Amount {
    from: f64,
    to: f64,
    amount: f64,
}

fn amounts(motions: &[CameraMotion]) -> Vec<Amount> {
    let amount = |m: &CameraMotion| Amount {
        from: m.from,
        to: m.to,
        amount: m.flow.length,
    };
    motions.iter().map(amount).collect()
}

/// Time, speed by the tracker, amount by the camera.
fn speeds(track: &TrackerTrack, seen: &[Amount], offset: f64) -> Vec<(f64, f64, f64)> {
    let one = |m: &Amount| {
        let turn = track.at(m.from + offset)?.inverse() * track.at(m.to + offset)?;
        let span = (m.to - m.from).max(1e-9);
        let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
        Some((m.from, angle / span, m.amount / span))
    };
    seen.iter().filter_map(one).collect()
}

fn scale(speeds: &[(f64, f64, f64)]) -> f64 {
    let (mut both, mut own) = (0.0, 0.0);
    for (_, tracker, camera) in speeds {
        both += tracker * camera;
        own += camera * camera;
    }
    if own > 0.0 { both / own } else { 1.0 }
}

/// Pearson's.
fn correlation(speeds: &[(f64, f64, f64)]) -> Option<f64> {
    let n = speeds.len() as f64;
    let (a, b) = speeds
        .iter()
        .fold((0.0, 0.0), |(a, b), s| (a + s.1, b + s.2));
    let (a, b) = (a / n, b / n);
    let (mut both, mut first, mut second) = (0.0, 0.0, 0.0);
    for (_, x, y) in speeds {
        both += (x - a) * (y - b);
        first += (x - a).powi(2);
        second += (y - b).powi(2);
    }
    let power = (first * second).sqrt();
    (speeds.len() >= 10 && power > 0.0).then(|| both / power)
}
