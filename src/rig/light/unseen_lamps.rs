//! Lamps that the environment camera does not see, as long as real shadows show them.

use glam::{DVec3, Vec3};
use penumbra_lighting::EnvironmentEstimator;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::lamp_distance::{DistanceSearch, Hiding, SeenLamp, UnseenLamp};

/// Most of them.
const LAMPS: usize = 2;
/// Looks from which on all that is to be tried is tried in parts: all of it in the first, in the time of a few pictures.
const TRIES: usize = 1;
/// Looks until all has been tried again.
const PARTS: usize = 40;
/// Looks in a row that show nothing of a lamp, after which it is gone.
const MISSES: u32 = 3;
/// Looks in which a new one takes all of a new estimate: the other lamps have just found their places beside it.
const SETTLING: u32 = 2;
/// Angle, radians, up to which a source is taken for a lamp that is followed.
const SAME: f32 = 1e-3;

/// A lamp that is followed.
#[derive(Clone, Copy, Debug)]
struct Followed {
    lamp: UnseenLamp,
    /// Looks that have shown it.
    looks: u32,
    /// Looks in a row that did not show it.
    misses: u32,
}

/// Finds them and follows them.
#[derive(Debug, Default)]
pub(super) struct UnseenLamps {
    all: Vec<Followed>,
    /// Lamps that were seen until now.
    lost: Vec<UnseenLamp>,
    looks: usize,
}

impl UnseenLamps {
    /// The lamps.
    pub fn lamps(&self) -> impl Iterator<Item = UnseenLamp> + '_ {
        self.all.iter().map(|followed| followed.lamp)
    }

    /// Searches from the beginning.
    pub fn restart(&mut self) {
        self.looks = 0;
    }

    /// The environment is seen from elsewhere from now on, by `shift`, metres.
    pub fn move_observer(&mut self, shift: DVec3) {
        for followed in &mut self.all {
            followed.lamp = followed.lamp.seen_from_elsewhere(shift.as_vec3());
        }
    }

    /// Forgets lamps where nothing hides them any more: they are among those that are seen. True if there was one.
    pub fn forget_seen(&mut self, estimator: &EnvironmentEstimator) -> bool {
        if self.all.is_empty() {
            return false;
        }
        let (before, hiding) = (self.all.len(), estimator.hiding());
        let is_hidden = |followed: &Followed| hiding(followed.lamp.direction) != Hiding::Nothing;
        self.all.retain(is_hidden);
        self.all.len() < before
    }

    /// Notes a lamp that was seen until now, if something may hide it; true if so.
    pub fn lose(&mut self, source: &CompactSource, estimator: &EnvironmentEstimator) -> bool {
        let is_hidden = estimator.hiding()(source.direction) != Hiding::Nothing;
        if is_hidden {
            self.lost.push(UnseenLamp::of(source));
        }
        is_hidden
    }

    /// Keeps those of the lost lamps whose shadows are still there. True if there is one.
    pub fn keep_lost(
        &mut self,
        search: &mut DistanceSearch<'_>,
        estimator: &EnvironmentEstimator,
    ) -> bool {
        let before = self.all.len();
        for lamp in std::mem::take(&mut self.lost) {
            if self.all.len() < LAMPS {
                let kept = search.keep_unseen(&lamp, &estimator.hiding());
                self.all.extend(kept.map(Followed::new));
            }
        }
        self.all.len() > before
    }

    /// Looks at the shadows in a picture; `lamps` are those of `search`, and `hiding` tells what may
    /// hide a lamp from the environment camera. True if there is a lamp that was not there.
    pub fn look(
        &mut self,
        search: &mut DistanceSearch<'_>,
        lamps: &[SeenLamp],
        hiding: &dyn Fn(Vec3) -> Hiding,
    ) -> bool {
        for followed in &mut self.all {
            followed.look(search, lamps, hiding);
        }
        self.all.retain(|followed| followed.misses < MISSES);
        let part = if self.looks < TRIES {
            (0, 1)
        } else {
            (self.looks % PARTS, PARTS)
        };
        self.looks += 1;
        if self.all.len() >= LAMPS {
            return false;
        }
        let found = search.find_unseen(hiding, part);
        self.all.extend(found.map(Followed::new));
        found.is_some()
    }
}

impl Followed {
    const fn new(lamp: UnseenLamp) -> Self {
        Self {
            lamp,
            looks: 0,
            misses: 0,
        }
    }

    /// Takes a share of where and how bright the picture shows the lamp.
    fn look(
        &mut self,
        search: &DistanceSearch<'_>,
        lamps: &[SeenLamp],
        hiding: &dyn Fn(Vec3) -> Hiding,
    ) {
        let same = |lamp: &SeenLamp| {
            let angle = || lamp.source.direction.angle_between(self.lamp.direction);
            lamp.source.is_unseen && angle() < SAME
        };
        let Some(number) = lamps.iter().position(same) else {
            return;
        };
        let is_new = self.looks < SETTLING;
        match search.follow_unseen(number, (&self.lamp, is_new), hiding) {
            Some(now) => (self.lamp, self.looks, self.misses) = (now, self.looks + 1, 0),
            None => self.misses += 1,
        }
    }
}

#[cfg(test)]
mod tests;
