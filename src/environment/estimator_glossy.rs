//! What glossy surfaces mirror, and how it is filtered.

use super::super::box_chain::box_chain;
use super::super::light::{CubeMap, Filtering};
use super::*;
use glam::DVec3;
use penumbra_interface::RigidTransform;

impl EnvironmentEstimator {
    /// Changes how reflections are filtered; from the next light on.
    pub const fn set_filtering(&mut self, filtering: Filtering) {
        self.settings.filtering = filtering;
    }

    /// Changes whether there is something with Phong's lobes to filter for.
    pub fn set_phong(&mut self, wanted: bool) {
        self.settings.phong = wanted;
        self.prefilter.want_phong(wanted);
    }

    pub(super) fn radiance_map(&self, full: &[Vec3], input: &EnvironmentInput) -> CubeMap {
        match self.settings.filtering {
            Filtering::Prefiltered => self.prefilter.apply(full),
            Filtering::Box => {
                // The paper's ball is seen by the scene camera; without a pose, from above.
                let towards = |(pose, _): (RigidTransform, _)| -pose.rotation.mul_vec3(DVec3::Z);
                let axis = input
                    .scene
                    .map_or(Vec3::Z, |scene| towards(scene).as_vec3());
                box_chain(self.grid.size, full, axis)
            }
        }
    }
}
