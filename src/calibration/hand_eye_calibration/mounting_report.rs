//! The summary and the report of the step `tracker`.

use super::mounting::{MountingResult, MountingStep};
use crate::hand_eye::{HandEye, PosePair};
use crate::report::{Page, Plot};
use crate::step::{CalibrationProvenance, Finished};
use glam::{DVec3, EulerRot};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_numerics::rotation_vector;

impl MountingStep {
    pub(super) fn lines(&self, result: &MountingResult) -> Vec<String> {
        let found = &result.hand_eye;
        let used = found.used.iter().filter(|u| **u).count();
        let offset = result.offset;
        let mut lines = vec![
            describe(
                "camera on the sensor",
                found.sensor_from_camera,
                found.sensor_sigma,
            ),
            describe(
                "transmitter in the world",
                found.world_from_transmitter,
                found.transmitter_sigma,
            ),
            format!(
                "residuals: {:.2} mm and {:.3} degrees RMS over {used} of {} pairs of poses; RMS rotation about the second axis {:.0} degrees",
                1e3 * found.position_rms,
                found.rotation_rms.to_degrees(),
                found.used.len(),
                found.second_axis.to_degrees()
            ),
        ];
        lines.push(if offset.is_estimated {
            format!(
                "the tracker's time stamps are {:.2} ± {:.2} ms later than the scene camera's, estimated from the same pictures",
                1e3 * offset.seconds,
                1e3 * offset.sigma
            )
        } else {
            format!("the tracker's time stamps are assumed to be {:.2} ms later than the scene camera's", 1e3 * offset.seconds)
        });
        if self.options.world_is_board {
            lines.push("the world's origin is the board's first corner, +X along its rows, +Z out of the paper".to_owned());
        }
        if let Some(fit) = &result.field {
            let grid = fit.field.grid();
            let size = grid.high() - grid.low;
            lines.push(format!(
                "distortion map, on held-out poses: {:.2} mm and {:.3} degrees without, {:.2} mm and {:.3} degrees with it; {:.2} × {:.2} × {:.2} m in cells of {:.0} mm",
                1e3 * fit.before.0, fit.before.1.to_degrees(), 1e3 * fit.after.0, fit.after.1.to_degrees(),
                size.x, size.y, size.z, 1e3 * grid.spacing
            ));
        }
        lines
    }

    pub(super) fn report(
        &self,
        provenance: &CalibrationProvenance,
        found: &Finished,
        result: Option<&MountingResult>,
    ) -> String {
        let facts = [
            format!("{}, from {}", provenance.date, provenance.source),
            format!(
                "{} poses from {} pictures; {} tracker readings",
                self.camera_poses.len(),
                self.pictures,
                self.readings.len()
            ),
        ];
        let mut page = Page::new("Mounting of the tracker", &facts);
        page.verdict(found);
        if let Some(result) = result {
            plot_residuals(&mut page, result);
        }
        page.finish()
    }
}

fn describe(
    name: &str,
    pose: RigidTransform,
    (rotation_sigma, position_sigma): (DVec3, DVec3),
) -> String {
    let p = pose.translation * 1e3;
    let (z, y, x) = pose.rotation.to_euler(EulerRot::ZYX);
    let angles = [z, y, x].map(f64::to_degrees);
    format!(
        "{name}: {:.1}, {:.1}, {:.1} mm ± {:.2} mm; azimuth, elevation, roll {:.2}, {:.2}, {:.2} ± {:.3} degrees",
        p.x,
        p.y,
        p.z,
        1e3 * position_sigma.max_element(),
        angles[0],
        angles[1],
        angles[2],
        rotation_sigma.max_element().to_degrees()
    )
}

/// Residuals of a pair.
struct Residual {
    seconds: f64,
    /// Distance from the transmitter, metres.
    distance: f64,
    position_mm: f64,
    rotation_degrees: f64,
}

/// Coordinates of a residual in a plot.
type Coordinates = fn(&Residual) -> (f64, f64);

fn residuals(
    pairs: &[(MonotonicTime, PosePair)],
    found: &HandEye,
    correct: &dyn Fn(RigidTransform) -> RigidTransform,
) -> Vec<Residual> {
    let first = pairs.first().map_or(MonotonicTime::default(), |p| p.0);
    let one = |(at, pair): &(MonotonicTime, PosePair)| {
        let by_tracker = found.world_from_transmitter
            * correct(pair.transmitter_from_sensor)
            * found.sensor_from_camera;
        let rotation = by_tracker.rotation.inverse() * pair.world_from_camera.rotation;
        Residual {
            seconds: at.seconds_since(first),
            distance: pair.transmitter_from_sensor.translation.length(),
            position_mm: 1e3
                * by_tracker
                    .translation
                    .distance(pair.world_from_camera.translation),
            rotation_degrees: rotation_vector(rotation).length().to_degrees(),
        }
    };
    pairs.iter().map(one).collect()
}

fn plot_residuals(page: &mut Page, result: &MountingResult) {
    let used: Vec<_> = result
        .pairs
        .iter()
        .zip(&result.hand_eye.used)
        .filter_map(|(p, used)| used.then_some(*p))
        .collect();
    let field = result.accepted_field();
    let uncorrected = residuals(&used, &result.uncorrected, &|p| p);
    let corrected = residuals(&used, &result.hand_eye, &|p| {
        field.map_or(p, |f| f.correct(p))
    });
    let plots: [(&str, &str, &str, Coordinates); 4] = [
        ("s", "position, mm", "Position residuals over time", |r| {
            (r.seconds, r.position_mm)
        }),
        (
            "s",
            "rotation, degrees",
            "Rotation residuals over time",
            |r| (r.seconds, r.rotation_degrees),
        ),
        (
            "distance from the transmitter, m",
            "position, mm",
            "Position residuals over distance",
            |r| (r.distance, r.position_mm),
        ),
        (
            "distance from the transmitter, m",
            "rotation, degrees",
            "Rotation residuals over distance",
            |r| (r.distance, r.rotation_degrees),
        ),
    ];
    for (x, y, caption, coordinates) in plots {
        let points = |values: &[Residual]| values.iter().map(coordinates).collect::<Vec<_>>();
        let mut series = vec![(
            "tracker against pictures".to_owned(),
            points(&uncorrected),
            false,
        )];
        if field.is_some() {
            series.push((
                "with the distortion map".to_owned(),
                points(&corrected),
                false,
            ));
        }
        let plot = Plot {
            x: x.to_owned(),
            y: y.to_owned(),
            series,
        };
        page.plot(&plot, caption);
    }
}
