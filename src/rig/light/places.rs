//! Places of the lamps: as stated, or estimated from real shadows in the scene camera's picture and from several views
//! of them.

use crate::light::agreement::{Agreements, PictureAgreement};
use crate::light::known_lamp::{Known, combined};
use crate::light::lamp_views::LampViews;
use crate::light::sight::Sight;
use crate::light::stated_lights::StatedLights;
use crate::light::surfaces::PhantomSurfaces;
use crate::light::unseen_lamps::UnseenLamps;
use crate::light::view::SceneView;
use glam::{DVec3, Vec3};
use penumbra_config::{EnvironmentConfig, LightPlaces};
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::clipped::nearest_factor;
use penumbra_lighting::lamp_distance::{Colour, DistanceSearch, SeenLamp, SeenSurfaces};
use penumbra_lighting::place::LampDistance;
use penumbra_lighting::{EnvironmentEstimator, Lighting};
use penumbra_rig_model::RigCalibration;
use penumbra_scene::RayCaster;
use std::sync::Arc;

/// Environment pictures between two looks at the shadows.
const INTERVAL: u32 = 6;
/// Looks after which the distance of a lamp that was far is searched again.
const SEARCH_AGAIN: u32 = 5;
/// Looks in which the distance of a lamp that is new is searched, although it seems to be far.
const TRIES: u32 = 4;
/// Number of lamps whose distances are searched, the strongest.
const LAMPS: usize = 8;
/// Share of a new estimate in the distance and the energy of a lamp that is followed.
const SHARE: f32 = 0.3;
/// Share of a lamp's light in clipped pixels from which its energy is estimated.
const CLIPPED: f32 = 0.2;
/// Looks in which a new clipped lamp takes all of the energy that is found.
const SETTLING: u32 = 4;
/// Largest number of rounds over all clipped lamps when one of them is new, and the change of a factor with
/// which they have settled.
const ROUNDS: usize = 8;
const SETTLED: f32 = 1.03;
/// Factor on a lamp's light that makes the light another.
const MUCH: f32 = 1.2;
/// Factor between the light of a source that is gone and that of a new one, below which they may be the same
/// lamp.
const SAME_LAMP: f32 = 1.5;

/// Finds the places of lamps, and follows them.
pub(crate) struct LampPlaces {
    sight: Sight,
    rays: Arc<RayCaster>,
    stated: StatedLights,
    views: LampViews,
    /// Where the environment was last seen from, world, metres.
    observer: Option<DVec3>,
    is_estimated: bool,
    known: Vec<Known>,
    /// Directions and factors that the light was last estimated with.
    applied: Vec<(Vec3, Vec3)>,
    /// Pictures until the next look.
    rests: u32,
    /// Number of looks.
    looks: u32,
    /// Looks until the energy of a clipped lamp that is new has settled.
    settling: u32,
    surfaces: SeenSurfaces,
    agreements: Agreements,
    unseen: UnseenLamps,
    /// The sources of the last picture.
    sources: Vec<CompactSource>,
}

impl LampPlaces {
    pub(crate) fn new(
        rig: &RigCalibration,
        rays: Arc<RayCaster>,
        settings: &EnvironmentConfig,
    ) -> Self {
        Self {
            sight: Sight::new(&rig.scene_camera),
            rays,
            stated: StatedLights::new(&settings.room_lights),
            views: LampViews::new(rig),
            observer: None,
            is_estimated: settings.light_places == LightPlaces::Estimate,
            known: Vec::new(),
            applied: Vec::new(),
            rests: 0,
            looks: 0,
            settling: 0,
            surfaces: SeenSurfaces::default(),
            agreements: Agreements::default(),
            unseen: UnseenLamps::default(),
            sources: Vec::new(),
        }
    }

    /// Replaces the real surfaces.
    pub(crate) fn set_rays(&mut self, rays: Arc<RayCaster>) {
        self.rays = rays;
        self.rests = 0;
        self.agreements.clear();
        self.unseen.restart();
    }

    /// How well the light explains the shadows in the picture; `None` if none was compared.
    pub(crate) fn agreement(&self) -> Option<PictureAgreement> {
        self.agreements.picture(&self.rays)
    }

    /// Looks at the shadows in a picture, if it is time to, and tells `estimator` the distances of
    /// its lamps; true if a lamp has gained a place that had none, so that the light is another.
    /// `phantoms` are as bright as they are in this light.
    pub(crate) fn look(
        &mut self,
        scene: &SceneView<'_>,
        (lighting, phantoms): (&Lighting, &PhantomSurfaces),
        estimator: &mut EnvironmentEstimator,
    ) -> bool {
        let Some(observer) = estimator.observer() else {
            return false;
        };
        if self.unseen.forget_seen(estimator) {
            // What they lit would be lit twice.
            self.rests = 0;
            estimator.set_unseen(self.unseen.lamps());
            return true;
        }
        let sources = estimator.sources();
        self.follow(&sources, estimator);
        self.move_observer(&sources, observer);
        self.stated.check(&sources, observer);
        let mut gained = self.place_stated(&sources, observer);
        self.see(scene, &sources, observer);
        gained |= self.estimate(scene, (lighting, phantoms), (estimator, &sources, observer));
        gained |= self.combine(&sources, observer);
        let known = self.known.iter();
        let distances: Vec<_> = known.map(|k| (k.id, k.applied)).collect();
        estimator.set_distances(&distances);
        let planes = self.known.iter().filter_map(|k| Some((k.id, k.plane?)));
        estimator.set_planes(&planes.collect::<Vec<_>>());
        // What is left of a source when its clipped pixels have become a source of their own has none.
        let is_clipped = |k: &&Known| sources.iter().any(|s| s.id == k.id && s.clipped > 0.0);
        let clipped = self.known.iter().filter(is_clipped);
        self.applied.clear();
        self.applied
            .extend(clipped.map(|k| (k.direction, k.factor)));
        estimator.set_clipped_factors(self.applied.iter().copied());
        estimator.set_unseen(self.unseen.lamps());
        gained
    }

    /// Takes over the directions of lamps that are followed, and forgets the others, and those that
    /// part from another source: which of the two is which is not certain. One that is gone may be hidden, if
    /// it has not come out elsewhere.
    fn follow(&mut self, sources: &[CompactSource], estimator: &EnvironmentEstimator) {
        let before = std::mem::replace(&mut self.sources, sources.to_vec());
        self.known.retain_mut(|known| {
            let source = sources.iter().find(|s| s.id == known.id);
            let gone = before.iter().find(|s| s.id == known.id && source.is_none());
            let hidden = gone.filter(|gone| !has_moved(gone, &before, sources));
            if hidden.is_some_and(|gone| self.unseen.lose(gone, estimator)) {
                self.rests = 0;
            }
            known.direction = source.map_or(known.direction, |s| s.direction);
            let is_certain = source.is_some() && !known.parts(sources);
            if !is_certain {
                self.views.forget(known.id);
            }
            is_certain
        });
    }

    /// Lamps stay where they are while the ball in which they are seen is carried about.
    fn move_observer(&mut self, sources: &[CompactSource], observer: DVec3) {
        let Some(before) = self.observer.replace(observer) else {
            return;
        };
        if before == observer {
            return;
        }
        self.unseen.move_observer(observer - before);
        for known in &mut self.known {
            if let Some(source) = sources.iter().find(|s| s.id == known.id) {
                known.move_observer((observer - before).as_vec3(), source.direction);
            }
        }
    }

    /// Notes from where the lamps are seen; one that has moved keeps the distance that it had.
    fn see(&mut self, scene: &SceneView<'_>, sources: &[CompactSource], observer: DVec3) {
        if !self.is_estimated || !Sight::fits(scene) {
            return;
        }
        let moved = self.views.see(scene, (sources, observer), &self.rays);
        for known in self.known.iter_mut().filter(|k| moved.contains(&k.id)) {
            known.distance = known.applied;
        }
    }

    /// Combines what shadows and several views tell of each lamp; true if one has gained a place.
    fn combine(&mut self, sources: &[CompactSource], observer: DVec3) -> bool {
        let mut gained = false;
        for known in &mut self.known {
            let Some(source) = sources.iter().find(|s| s.id == known.id) else {
                continue;
            };
            let by_views = self.views.distance(source, observer);
            let now = combined(known.distance, by_views);
            gained |= known.applied.inverse == 0.0 && now.inverse > 0.0;
            known.applied = now;
        }
        gained
    }

    /// Gives new lamps the places that are stated; true if there are any.
    fn place_stated(&mut self, sources: &[CompactSource], observer: DVec3) -> bool {
        let mut gained = false;
        for source in sources {
            if self.known(source.id).is_some() {
                continue;
            }
            if let Some(stated) = self.stated.place(source, observer) {
                if source.clipped > CLIPPED {
                    (self.settling, self.rests) = (SETTLING, 0);
                }
                self.note(source, stated.distance, self.applied_to(source));
                if let Some(known) = self.known.iter_mut().find(|k| k.id == source.id) {
                    known.plane = stated.plane;
                }
                gained = true;
            }
        }
        gained
    }

    fn known(&self, id: u32) -> Option<&Known> {
        self.known.iter().find(|k| k.id == id)
    }

    fn note(&mut self, source: &CompactSource, distance: LampDistance, factor: Vec3) {
        let now = Known {
            id: source.id,
            direction: source.direction,
            distance,
            applied: self
                .known(source.id)
                .map_or(LampDistance::FAR, |k| k.applied),
            plane: self.known(source.id).and_then(|k| k.plane),
            factor,
            tries: self.known(source.id).map_or(TRIES, |k| k.tries),
            met: self.known(source.id).and_then(|k| k.met),
        };
        match self.known.iter_mut().find(|k| k.id == source.id) {
            Some(known) => *known = now,
            None => self.known.push(now),
        }
    }

    /// The factor that is in the light of a source already.
    fn applied_to(&self, source: &CompactSource) -> Vec3 {
        let nearest = nearest_factor(&self.applied, source.direction);
        nearest
            .filter(|_| source.clipped > 0.0)
            .unwrap_or(Vec3::ONE)
    }

    /// Whether lamps that were far are searched again in this look.
    fn is_late(&self) -> bool {
        self.looks.is_multiple_of(SEARCH_AGAIN)
    }

    fn is_stated(&self, source: &CompactSource, observer: DVec3) -> bool {
        self.stated.place(source, observer).is_some()
    }

    /// Estimates distances from the shadows in the picture; true if a lamp has gained a place.
    fn estimate(
        &mut self,
        scene: &SceneView<'_>,
        (lighting, phantoms): (&Lighting, &PhantomSurfaces),
        (estimator, sources, observer): (&EnvironmentEstimator, &[CompactSource], DVec3),
    ) -> bool {
        let Some(pose) = scene.world_from_camera.filter(|_| self.is_estimated) else {
            return false;
        };
        let any_new = sources
            .iter()
            .filter(|s| !s.is_unseen)
            .take(LAMPS)
            .any(|s| self.known(s.id).is_none());
        if !Sight::fits(scene) || (!any_new && self.rests > 0) {
            self.rests = self.rests.saturating_sub(1);
            return false;
        }
        self.rests = INTERVAL;
        self.looks += 1;
        for known in &mut self.known {
            known.tries = known.tries.saturating_sub(1);
        }
        let rays = Arc::clone(&self.rays);
        self.sight.see(scene, pose, &rays, &mut self.surfaces);
        let surfaces = std::mem::take(&mut self.surfaces);
        let (mut all, unseen): (Vec<SeenLamp>, Vec<SeenLamp>) = estimator
            .lamps()
            .into_iter()
            .partition(|lamp| !lamp.source.is_unseen);
        for lamp in &mut all {
            let known = self.known(lamp.source.id);
            lamp.source.distance = known.map_or(LampDistance::FAR, |k| k.applied);
            lamp.is_energy_unknown = known.is_none() && lamp.source.clipped > CLIPPED;
        }
        let lamps: Vec<CompactSource> = all.iter().map(|lamp| lamp.source).collect();
        all.extend(unseen);
        let blocked =
            |origin: DVec3, to: DVec3, farthest: f64| rays.is_blocked(origin, to, farthest);
        let occluders = |origin: DVec3, to: DVec3| phantoms.met(origin, to);
        let mut search = DistanceSearch::new(
            &surfaces,
            &all,
            (&lighting.irradiance, Some(&occluders)),
            observer,
            &blocked,
        );
        let new: Vec<usize> = (0..lamps.len().min(LAMPS))
            .filter(|k| self.known(lamps[*k].id).is_none())
            .collect();
        let mut gained = self.unseen.keep_lost(&mut search, estimator);
        gained |= self.find_distances(&mut search, (&lamps, observer));
        if new.iter().any(|k| lamps[*k].clipped > CLIPPED) {
            self.settling = SETTLING;
        }
        let is_other = self.estimate_factors(&mut search, &lamps);
        self.settling = self.settling.saturating_sub(1);
        if is_other && self.settling > 0 {
            // More pixels may belong to a lamp that has become brighter.
            self.rests = 0;
        }
        gained |= is_other;
        gained |= !is_other && self.look_for_unseen(&mut search, &all, estimator);
        self.agreements.add(&search.agreement());
        self.surfaces = surfaces;
        gained
    }

    /// Looks for lamps that the environment camera does not see, once it is known what the others explain; true if
    /// there is one.
    fn look_for_unseen(
        &mut self,
        search: &mut DistanceSearch<'_>,
        lamps: &[SeenLamp],
        estimator: &EnvironmentEstimator,
    ) -> bool {
        let hiding = estimator.hiding();
        let is_found = self.unseen.look(search, lamps, &hiding);
        if is_found {
            // Without it, the others were made to explain its shadows.
            self.known.clear();
            self.rests = 0;
        }
        is_found
    }

    /// Finds the distances of lamps: of near ones beside the last, of others anywhere, together. True if a
    /// lamp has gained a place.
    fn find_distances(
        &mut self,
        search: &mut DistanceSearch<'_>,
        (lamps, observer): (&[CompactSource], DVec3),
    ) -> bool {
        let is_late = self.is_late();
        let (mut new, mut far) = (Vec::new(), Vec::new());
        for (k, lamp) in lamps.iter().enumerate().take(LAMPS) {
            if self.is_stated(lamp, observer) {
                continue;
            }
            let Some(known) = self.known(lamp.id).copied() else {
                new.push(k);
                continue;
            };
            let near = known.distance.inverse.max(known.applied.inverse);
            if near == 0.0 {
                let is_tried = known.tries > 0 || is_late;
                far.extend(is_tried.then_some(k));
            } else if let Some(mut now) = search.find(k, near) {
                if now.inverse > 0.0 && known.distance.inverse > 0.0 {
                    now.inverse =
                        known.distance.inverse + (now.inverse - known.distance.inverse) * SHARE;
                }
                self.note(lamp, now, known.factor);
            }
        }
        // One of those that seemed to be far before, in turn.
        let turn = self.looks as usize % far.len().max(1);
        new.extend(far.get(turn));
        let found = search.find_together(&new);
        for k in new {
            let distance = found.iter().find(|(lamp, _)| *lamp == k);
            let distance = distance.map_or(LampDistance::FAR, |(_, distance)| *distance);
            let known = self.known(lamps[k].id);
            let factor = known.map_or_else(|| self.applied_to(&lamps[k]), |k| k.factor);
            self.note(&lamps[k], distance, factor);
        }
        found.iter().any(|(_, distance)| distance.inverse > 0.0)
    }

    /// Estimates the factors on clipped lamps, at once while they settle, else as a small step; true if
    /// one has changed much.
    fn estimate_factors(
        &mut self,
        search: &mut DistanceSearch<'_>,
        lamps: &[CompactSource],
    ) -> bool {
        let anew = self.settling > 0;
        // One lamp's light changes what the shadows of the others tell.
        let (rounds, share) = if anew { (ROUNDS, 1.0) } else { (1, SHARE) };
        let is_clipped = |(_, lamp): &(usize, &CompactSource)| lamp.clipped > CLIPPED;
        let all = lamps.iter().enumerate().take(LAMPS);
        let clipped: Vec<(usize, &CompactSource)> = all.filter(is_clipped).collect();
        let is_other = |factor: Vec3, limit: f32| {
            factor.max_element() > limit || factor.min_element() < limit.recip()
        };
        let (mut gained, mut has_settled) = (false, false);
        for round in 1..=rounds {
            // Colours once they have settled.
            let is_last = has_settled || round == rounds;
            let colour = match (is_last, anew) {
                (false, _) => Colour::Kept,
                (true, true) => Colour::BestMatch,
                (true, false) => Colour::IfBetter,
            };
            has_settled = true;
            if anew && round > 1 {
                gained |= is_other(Vec3::splat(self.scale_together(search, &clipped)), MUCH);
            }
            for (k, lamp) in &clipped {
                let Some(known) = self.known(lamp.id).copied() else {
                    continue;
                };
                // On the clipped pixels alone, so that it never corrects too much: the next look does
                // the rest.
                let factor = search.find_factor(*k, known.factor, colour).powf(share);
                gained |= is_other(factor, MUCH);
                has_settled &= !is_other(factor, SETTLED);
                self.note(lamp, known.distance, known.factor * factor);
            }
            if is_last {
                break;
            }
        }
        gained
    }

    /// Multiplies the factors of several clipped lamps by the one that fits best, which it returns.
    fn scale_together(
        &mut self,
        search: &mut DistanceSearch<'_>,
        clipped: &[(usize, &CompactSource)],
    ) -> f32 {
        let with_known = |(k, lamp): &(usize, &CompactSource)| Some((*k, *self.known(lamp.id)?));
        let all: Vec<(usize, Known)> = clipped.iter().filter_map(with_known).collect();
        if all.len() < 2 {
            return 1.0;
        }
        let numbers: Vec<usize> = all.iter().map(|(k, _)| *k).collect();
        let least = all.iter().map(|(_, known)| known.factor.min_element());
        let least = least.fold(f32::MAX, f32::min).recip();
        let factor = search.find_common_factor(&numbers, least);
        for known in &mut self.known {
            if all.iter().any(|(_, k)| k.id == known.id) {
                known.factor *= factor;
            }
        }
        factor
    }
}

/// Whether a source that is `gone` is probably one of the new ones: it has moved farther than it could be
/// followed.
fn has_moved(gone: &CompactSource, before: &[CompactSource], now: &[CompactSource]) -> bool {
    let is_new = |s: &&CompactSource| !s.is_unseen && before.iter().all(|b| b.id != s.id);
    let light = |s: &CompactSource| s.irradiance.element_sum();
    let mut new = now.iter().filter(is_new).map(light);
    new.any(|new| new.max(light(gone)) < SAME_LAMP * new.min(light(gone)))
}

#[cfg(test)]
pub(super) mod tests;
