//! The radiance map for glossy surfaces, and how it is filtered.

use super::super::box_chain::box_chain;
use super::super::compact_source_specular::excesses;
use super::super::light::{CubeMap, Filtering};
use super::super::lobes::widths;
use super::super::prefilter::level_count;
use super::*;
use glam::DVec3;
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

    /// Filters `full`, which contains `sources` that `without` does not, both in the scene's units.
    pub(super) fn radiance_map(
        &self,
        full: &[Vec3],
        without: &[Vec3],
        sources: &[Source],
        input: &EnvironmentInput,
    ) -> CubeMap {
        match self.settings.filtering {
            Filtering::Prefiltered => {
                let towards: Vec<Vec3> = sources.iter().map(|s| s.direction).collect();
                let widths = widths(self.grid.size, level_count(self.grid.size));
                let excesses = excesses(&self.grid, full, without, &towards, &widths);
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
        }
    }
}
