//! What is known of a lamp that is followed from picture to picture.

use glam::Vec3;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::place::{LampDistance, LampPlane};
use penumbra_lighting::triangulation::fused;

/// Angle between two sources, radians, below which one may be taken for the other from picture to
/// picture, and above which they are told apart again.
const MEETING: (f32, f32) = (0.2, 0.25);
/// Standard deviations by which the reciprocal of a distance by several views must be above 0.
const NEAR: f32 = 3.0;
/// Least distance of a lamp from the ball in which it is seen, metres.
const LEAST_AWAY: f32 = 0.1;
/// Standard deviations by which two estimates may differ.
const AGREE: f32 = 4.0;
/// Least standard deviation of a reciprocal distance by shadows, 1/m, and as a share: maps of phantoms and poses have
/// errors of their own.
const LEAST_SIGMA: (f32, f32) = (0.03, 0.03);

/// What is known of a lamp that is followed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known {
    pub id: u32,
    /// Unit vector from the observer.
    pub direction: Vec3,
    /// As stated, or by shadows.
    pub distance: LampDistance,
    /// With what several views of it tell.
    pub applied: LampDistance,
    /// The plane in which it is, if that is stated.
    pub plane: Option<LampPlane>,
    /// Factor on its clipped pixels, RGB.
    pub factor: Vec3,
    /// Looks in which its distance is still searched, although it seems to be far.
    pub tries: u32,
    /// The source that it has come close to.
    pub met: Option<u32>,
}

impl Known {
    /// Whether the lamp moves away from a source that it had come close to.
    pub fn parts(&mut self, sources: &[CompactSource]) -> bool {
        let angle = |s: &CompactSource| s.direction.angle_between(self.direction);
        let others = || sources.iter().filter(|s| s.id != self.id);
        let met = self.met.and_then(|id| others().find(|s| s.id == id));
        let parts = met.is_some_and(|s| angle(s) > MEETING.1);
        let close = others().find(|s| angle(s) < MEETING.0).map(|s| s.id);
        self.met = met.map(|s| s.id).or(close);
        parts
    }

    /// The lamp stays where it is while the observer moves by `shift`, metres; it is seen in `direction` (unit vector)
    /// now.
    pub fn move_observer(&mut self, shift: Vec3, direction: Vec3) {
        let before = self.distance.inverse;
        if before > 0.0 {
            let away = (before.recip() - shift.dot(direction)).max(LEAST_AWAY);
            let scale = away.recip() / before;
            self.distance.inverse = before * scale;
            self.distance.sigma *= scale * scale;
        }
    }
}

/// Combines what the shadows tell of a lamp's distance with what several views of it tell, and whether these were
/// from more than two places: two may show two different things.
pub(super) fn combined(
    by_shadows: LampDistance,
    by_views: Option<(LampDistance, bool)>,
) -> LampDistance {
    let is_stated = by_shadows.sigma == 0.0;
    let least = LEAST_SIGMA.0 + LEAST_SIGMA.1 * by_shadows.inverse;
    let by_shadows = LampDistance {
        sigma: by_shadows.sigma.max(if is_stated { 0.0 } else { least }),
        ..by_shadows
    };
    let Some((by_views, is_certain)) = by_views.filter(|_| !is_stated) else {
        return by_shadows;
    };
    let is_near = by_views.inverse > NEAR * by_views.sigma;
    if by_shadows.inverse == 0.0 {
        return if is_near { by_views } else { by_shadows };
    }
    let apart = (by_views.inverse - by_shadows.inverse).abs();
    match apart < AGREE * by_views.sigma.hypot(by_shadows.sigma) {
        true => fused(by_shadows, by_views),
        false if is_certain && is_near => by_views,
        false => by_shadows,
    }
}

#[cfg(test)]
pub(super) mod tests;
