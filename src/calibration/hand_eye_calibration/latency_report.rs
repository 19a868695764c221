//! The report of the step `latency`.

use super::latency::{LatencyStep, Offsets, camera_rotations};
use crate::latency::{CameraMotion, OffsetMethod, TrackerTrack};
use crate::report::{Page, Plot};
use crate::step::{CalibrationProvenance, Finished};
use penumbra_numerics::rotation_vector;

/// Step of the plotted correlation, seconds.
const STEP: f64 = 0.002;

impl LatencyStep {
    pub(super) fn report(
        &self,
        provenance: &CalibrationProvenance,
        found: &Finished,
        offsets: Option<&Offsets>,
    ) -> String {
        let facts = [
            format!("{}, from {}", provenance.date, provenance.source),
            format!(
                "{} pictures, {} with poses; {} tracker readings",
                self.scene.pictures,
                self.camera_poses.len(),
                self.readings.len()
            ),
        ];
        let mut page = Page::new("Latency of tracker and cameras", &facts);
        page.verdict(found);
        if let (Some(zero), Some(track)) = (self.zero, self.track()) {
            let scene = offsets.and_then(|o| o.scene.as_ref().ok());
            let by_poses: Vec<Amount> = camera_rotations(&self.camera_poses, zero)
                .iter()
                .map(|r| Amount {
                    from: r.from,
                    to: r.to,
                    amount: r.rotation.to_scaled_axis().length(),
                })
                .collect();
            let by_flow = amounts(&self.scene.motions(zero));
            let plotted = match scene {
                Some((_, OffsetMethod::Poses)) => &by_poses,
                _ => &by_flow,
            };
            let offset = scene.map_or(0.0, |s| s.0.seconds);
            self.plot_camera(&mut page, "scene camera", &track, plotted, offset);
            if self.environment.pictures > 0 {
                let found = offsets.and_then(|o| o.environment.as_ref()?.as_ref().ok());
                let offset = found.map_or(0.0, |f| f.seconds);
                let motions = amounts(&self.environment.motions(zero));
                self.plot_camera(&mut page, "environment camera", &track, &motions, offset);
            }
        }
        page.finish()
    }

    fn plot_camera(
        &self,
        page: &mut Page,
        camera: &str,
        track: &TrackerTrack,
        amounts: &[Amount],
        offset: f64,
    ) {
        page.heading(camera);
        let speeds_at_offset = speeds(track, amounts, offset);
        let scale = scale(&speeds_at_offset);
        let camera_speeds: Vec<(f64, f64)> = speeds_at_offset
            .iter()
            .map(|(t, _, camera)| (*t, camera * scale))
            .collect();
        let tracker: Vec<(f64, f64)> = speeds_at_offset.iter().map(|(t, v, _)| (*t, *v)).collect();
        let plot = Plot {
            x: "s".to_owned(),
            y: "angular speed, rad/s".to_owned(),
            series: vec![
                ("tracker, corrected by the offset".to_owned(), tracker, true),
                (format!("{camera}, scaled"), camera_speeds, true),
            ],
        };
        page.plot(&plot, "Angular speed of tracker and camera");
        let steps = (self.options.range / STEP) as i32;
        let curve = (-steps..=steps)
            .map(|i| f64::from(i) * STEP)
            .filter_map(|o| {
                let speeds = speeds(track, amounts, o);
                Some((1e3 * o, correlation(&speeds)?))
            });
        let plot = Plot {
            x: "clock offset, tracker minus camera, ms".to_owned(),
            y: "correlation of the angular speeds".to_owned(),
            series: vec![("correlation".to_owned(), curve.collect(), true)],
        };
        page.plot(&plot, "Correlation over the offset");
    }
}

/// Amount of motion between two pictures, in any unit; times in seconds.
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

/// Returns time (seconds), angular speed of the tracker (radians per second), speed of the camera.
fn speeds(track: &TrackerTrack, amounts: &[Amount], offset: f64) -> Vec<(f64, f64, f64)> {
    let speeds = |m: &Amount| {
        let from = track.rotation_at(m.from + offset)?;
        let rotation = from.inverse() * track.rotation_at(m.to + offset)?;
        let span = (m.to - m.from).max(1e-9);
        Some((
            m.from,
            rotation_vector(rotation).length() / span,
            m.amount / span,
        ))
    };
    amounts.iter().filter_map(speeds).collect()
}

/// Returns the factor that scales the camera's speeds to the tracker's (least squares).
fn scale(speeds: &[(f64, f64, f64)]) -> f64 {
    let (mut both, mut own) = (0.0, 0.0);
    for (_, tracker, camera) in speeds {
        both += tracker * camera;
        own += camera * camera;
    }
    if own > 0.0 { both / own } else { 1.0 }
}

/// Returns Pearson's correlation; `None` for fewer than 10 values or without motion.
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
