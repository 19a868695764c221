//! What the step `tracker` says and shows.

use super::mounting::{Mounted, MountingStep};
use crate::hand_eye::{HandEye, PosePair};
use crate::report::{Page, Plot};
use crate::step::{Finished, Made};
use glam::{DQuat, DVec3, EulerRot};
use penumbra_interface::{MonotonicTime, RigidTransform};

impl MountingStep {
    pub(super) fn lines(&self, mounted: &Mounted) -> Vec<String> {
        let found = &mounted.hand_eye;
        let used = found.used.iter().filter(|u| **u).count();
        let (seconds, sigma, estimated) = mounted.offset;
        let mut lines = vec![
            described(
                "camera on the sensor",
                found.sensor_from_camera,
                found.sensor_sigma,
            ),
            described(
                "transmitter in the world",
                found.world_from_transmitter,
                found.transmitter_sigma,
            ),
            format!(
                "what is left: {:.2} mm and {:.3} degrees RMS of {used} of {} pairs of poses; turned about a second axis by {:.0} degrees",
                1e3 * found.position_rms,
                found.rotation_rms.to_degrees(),
                found.used.len(),
                found.spread.to_degrees()
            ),
        ];
        lines.push(if estimated {
            format!(
                "the tracker's stamps are {:.2} ± {:.2} ms later than the scene camera's, from the same pictures",
                1e3 * seconds,
                1e3 * sigma
            )
        } else {
            format!("the tracker's stamps were taken to be {:.2} ms later than the scene camera's", 1e3 * seconds)
        });
        if self.options.world_is_board {
            lines.push("the world begins at the board's first corner, +X along its rows, +Z out of the paper".to_owned());
        }
        if let Some(fit) = &mounted.field {
            let grid = fit.field.grid();
            let size = grid.high() - grid.low;
            lines.push(format!(
                "distortion, of poses held out: {:.2} mm and {:.3} degrees before, {:.2} mm and {:.3} degrees after; {:.2} × {:.2} × {:.2} m in cells of {:.0} mm",
                1e3 * fit.before.0, fit.before.1.to_degrees(), 1e3 * fit.after.0, fit.after.1.to_degrees(),
                size.x, size.y, size.z, 1e3 * grid.spacing
            ));
        }
        lines
    }

    pub(super) fn page(&self, made: &Made, found: &Finished, mounted: Option<&Mounted>) -> String {
        let facts = [
            format!("{}, from {}", made.date, made.source),
            format!(
                "{} poses from {} pictures; {} readings of the tracker",
                self.sightings.len(),
                self.pictures,
                self.readings.len()
            ),
        ];
        let mut page = Page::new("Mounting of the tracker", &facts);
        page.verdict(found);
        if let Some(mounted) = mounted {
            draw(&mut page, mounted);
        }
        page.finish()
    }
}

fn described(what: &str, pose: RigidTransform, (turn, shift): (DVec3, DVec3)) -> String {
    let p = pose.translation * 1e3;
    let (z, y, x) = pose.rotation.to_euler(EulerRot::ZYX);
    let angles = [z, y, x].map(f64::to_degrees);
    format!(
        "{what}: {:.1}, {:.1}, {:.1} mm ± {:.2} mm; azimuth, elevation, roll {:.2}, {:.2}, {:.2} ± {:.3} degrees",
        p.x,
        p.y,
        p.z,
        1e3 * shift.max_element(),
        angles[0],
        angles[1],
        angles[2],
        turn.max_element().to_degrees()
    )
}

/// Seconds, distance from the transmitter, position (mm) and rotation (degrees) left.
type Left = (f64, f64, f64, f64);
/// What of it is drawn.
type Shown = fn(&Left) -> (f64, f64);

fn left(
    pairs: &[(MonotonicTime, PosePair)],
    found: &HandEye,
    correct: &dyn Fn(RigidTransform) -> RigidTransform,
) -> Vec<Left> {
    let first = pairs.first().map_or(MonotonicTime::default(), |p| p.0);
    let one = |(at, pair): &(MonotonicTime, PosePair)| {
        let by_tracker = found.world_from_transmitter
            * correct(pair.transmitter_from_sensor)
            * found.sensor_from_camera;
        let turn: DQuat = by_tracker.rotation.inverse() * pair.world_from_camera.rotation;
        let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
        (
            at.seconds_since(first),
            pair.transmitter_from_sensor.translation.length(),
            1e3 * by_tracker
                .translation
                .distance(pair.world_from_camera.translation),
            angle.to_degrees(),
        )
    };
    pairs.iter().map(one).collect()
}

fn draw(page: &mut Page, mounted: &Mounted) {
    let used: Vec<_> = mounted
        .pairs
        .iter()
        .zip(&mounted.hand_eye.used)
        .filter_map(|(p, used)| used.then_some(*p))
        .collect();
    let field = mounted.believed();
    let straight = left(&used, &mounted.straight, &|p| p);
    let bent = left(&used, &mounted.hand_eye, &|p| {
        field.map_or(p, |f| f.correct(p))
    });
    let plots: [(&str, &str, &str, Shown); 4] = [
        (
            "s",
            "position, mm",
            "What is left of positions, over time",
            |l| (l.0, l.2),
        ),
        (
            "s",
            "rotation, degrees",
            "What is left of rotations, over time",
            |l| (l.0, l.3),
        ),
        (
            "distance from the transmitter, m",
            "position, mm",
            "Over space",
            |l| (l.1, l.2),
        ),
        (
            "distance from the transmitter, m",
            "rotation, degrees",
            "Over space",
            |l| (l.1, l.3),
        ),
    ];
    for (x, y, caption, of) in plots {
        let points = |values: &[Left]| values.iter().map(of).collect::<Vec<_>>();
        let mut series = vec![(
            "tracker against pictures".to_owned(),
            points(&straight),
            false,
        )];
        if field.is_some() {
            series.push((
                "with the map of distortion".to_owned(),
                points(&bent),
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
