//! What is drawn follows what is known, without a jump.

use super::{difference, nudged};
use glam::{DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;

/// Pixels a second by which what is drawn may slide while the camera is at rest.
pub(super) const AT_REST: f64 = 9.0;
/// Share of the picture's own motion by which it may slide besides: nobody sees a tenth of a
/// motion that the hand makes.
pub(super) const OF_MOTION: f64 = 0.1;

/// Where probes for a distance in pixels lie, shares of the picture from its middle.
const PROBES: [DVec2; 5] = [
    DVec2::ZERO,
    DVec2::new(-0.3, -0.3),
    DVec2::new(0.3, -0.3),
    DVec2::new(0.3, 0.3),
    DVec2::new(-0.3, 0.3),
];

/// How far pictures of the same points at `distance` metres (spread over the middle of the
/// picture) are apart by two poses of a camera: the largest, pixels.
#[must_use]
pub fn apart_pixels(
    camera: &PinholeCamera,
    a: RigidTransform,
    b: RigidTransform,
    distance: f64,
) -> f64 {
    let size = DVec2::new(f64::from(camera.width), f64::from(camera.height));
    let b_from_a = b.inverse() * a;
    let most = PROBES.iter().map(|share| {
        let p = *share * size / camera.focal * distance;
        let p = p.extend(distance);
        match (
            camera.project(p),
            camera.project(b_from_a.transform_point(p)),
        ) {
            (Some(one), Some(other)) => one.distance(other),
            _ => size.length(),
        }
    });
    most.fold(0.0, f64::max)
}

/// What was drawn by the picture just before.
#[derive(Clone, Debug)]
pub(super) struct Following {
    /// drawn = this × tracked.
    of_tracked: Option<RigidTransform>,
    /// drawn = this × the pose by markers.
    of_marked: Option<RigidTransform>,
    /// The last pose, and the one before it.
    drawn: Option<(RigidTransform, RigidTransform)>,
}

impl Following {
    /// Nothing was drawn.
    pub const fn new() -> Self {
        Self {
            of_tracked: None,
            of_marked: None,
            drawn: None,
        }
    }

    /// The pose to draw by: what would be drawn had nothing new been learnt, moved to the
    /// `target` as far as may be. The poses are this picture's by the tracker and by
    /// markers; `time` is since the picture before (seconds) with the picture's motion in it
    /// (pixels).
    pub fn follow(
        &mut self,
        (camera, distance): (&PinholeCamera, f64),
        target: RigidTransform,
        (tracked, marked): (Option<RigidTransform>, Option<RigidTransform>),
        (seconds, motion): (f64, f64),
    ) -> RigidTransform {
        let drawn = self.carried(tracked, marked).map_or(target, |from| {
            let apart = apart_pixels(camera, from, target, distance);
            let allowed = AT_REST * seconds + OF_MOTION * motion;
            part_of_the_way(from, target, allowed / apart.max(1e-9))
        });
        self.of_tracked = tracked.map(|t| drawn * t.inverse());
        self.of_marked = marked.map(|m| drawn * m.inverse());
        self.drawn = Some((drawn, self.drawn.map_or(drawn, |(last, _)| last)));
        drawn
    }

    /// What goes on from the picture before: with a source that spoke then and speaks now, else
    /// with the motion of the last two pictures.
    fn carried(
        &self,
        tracked: Option<RigidTransform>,
        marked: Option<RigidTransform>,
    ) -> Option<RigidTransform> {
        let by =
            |offset: Option<RigidTransform>, pose: Option<RigidTransform>| Some(offset? * pose?);
        let on = || {
            let (last, before) = self.drawn?;
            let (turn, shift) = difference(&before, &last);
            Some(nudged(last, turn, shift))
        };
        by(self.of_tracked, tracked)
            .or_else(|| by(self.of_marked, marked))
            .or_else(on)
    }
}

fn part_of_the_way(from: RigidTransform, to: RigidTransform, share: f64) -> RigidTransform {
    if share >= 1.0 {
        return to;
    }
    let (turn, shift): (DVec3, DVec3) = difference(&from, &to);
    nudged(from, turn * share, shift * share)
}
