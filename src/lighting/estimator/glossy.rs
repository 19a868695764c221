//! The radiance map for glossy surfaces, and how it is filtered.

use super::super::box_chain::box_chain;
use super::super::compact_source_specular::{excesses, owner};
use super::super::cube::sample_seamless;
use super::super::light::{CubeMap, Filtering};
use super::super::lobes::widths;
use super::super::place::{LightPlace, Remote, Seen};
use super::super::prefilter::level_count;
use super::*;
use glam::{DVec3, Quat};
use penumbra_interface::RigidTransform;

impl EnvironmentEstimator {
    /// Changes the filtering of reflections, from the next update on.
    pub const fn set_filtering(&mut self, filtering: Filtering) {
        self.settings.filtering = filtering;
    }

    /// Switches the filtering for Phong's lobes on or off.
    pub fn set_phong(&mut self, wanted: bool) {
        self.settings.phong = wanted;
        self.prefilter.set_phong(wanted);
    }

    /// Returns `sources` as seen from where lights are needed, with their places,
    /// and the map `full`, which contains them and `without` does not, with the near ones moved to
    /// these directions. Their radiance stays the same.
    pub(super) fn moved_sources(
        &self,
        full: Vec<Vec3>,
        without: &[Vec3],
        sources: &[CompactSource],
        views: &Viewpoints,
    ) -> (Vec<(Seen, LightPlace)>, Vec<Vec3>) {
        let as_seen = |s: &CompactSource| Seen {
            direction: s.direction,
            irradiance: s.irradiance,
            angular_radius: s.angular_radius,
        };
        let owner = |direction: Vec3| owner(sources.iter().map(as_seen), direction);
        let moved = |s: &CompactSource| {
            let views = if s.is_unseen { views.direct() } else { *views };
            views.moved(as_seen(s), Remote::Inverse(s.distance.inverse))
        };
        let places: Vec<(Seen, LightPlace)> = sources.iter().map(moved).collect();
        if places.iter().all(|(_, place)| place.is_far()) {
            return (places, full);
        }
        let excess = |(all, rest): (&Vec3, &Vec3)| (*all - *rest).max(Vec3::ZERO).to_array();
        let excess: Vec<[f32; 3]> = full.iter().zip(without).map(excess).collect();
        let mut out = without.to_vec();
        for (i, d) in self.grid.directions.iter().enumerate() {
            if owner(*d).is_none_or(|k| sources[k].distance.inverse == 0.0) {
                out[i] += Vec3::from(excess[i]);
            }
            for (k, (source, (there, place))) in sources.iter().zip(&places).enumerate() {
                let direction = there.direction;
                let reach = 3.0 * source.angular_radius + 4.0 / self.grid.size as f32;
                if place.is_far() || direction.dot(*d) < 0.5 {
                    continue;
                }
                // It turns towards who looks at it: a lamp is as round from there as from here.
                let turn = Quat::from_rotation_arc(direction, source.direction);
                let nearer = place.inverse_distance / source.distance.inverse;
                let beside = turn * (*d - direction) / nearer;
                let seen = (source.direction + beside).normalize();
                if seen.distance(source.direction) < reach && owner(seen) == Some(k) {
                    out[i] += sample_seamless(&excess, self.grid.size, seen);
                }
            }
        }
        (places, out)
    }

    /// Filters `full`, which contains `sources` that `without` does not, both in the scene's units.
    pub(super) fn radiance_map(
        &self,
        full: &[Vec3],
        without: &[Vec3],
        sources: &[(Seen, LightPlace)],
        input: &EnvironmentInput,
    ) -> CubeMap {
        let map = match self.settings.filtering {
            Filtering::Prefiltered => {
                let widths: Vec<_> = widths(self.grid.size, level_count(self.grid.size)).collect();
                let excesses = excesses(&self.grid, full, without, sources, &widths);
                self.prefilter.apply_without(full, &excesses)
            }
            Filtering::Box => {
                // The paper's sphere is seen by the scene camera; without a pose, from above.
                let towards = |(pose, _): (RigidTransform, _)| -pose.rotation.mul_vec3(DVec3::Z);
                let axis = input
                    .scene
                    .map_or(Vec3::Z, |scene| towards(scene).as_vec3());
                box_chain(self.grid.size, full, axis)
            }
        };
        CubeMap {
            seen_from: self.observer().map(|observer| observer.as_vec3()),
            ..map
        }
    }
}
