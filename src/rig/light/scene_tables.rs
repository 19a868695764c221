//! What the light's station keeps of the scene: made anew, beside the frame path, when the
//! scene is changed.

use crate::error::RigError;
use crate::light::indirect::IndirectLightUpdater;
use crate::light::surfaces::{GroundRadiance, PhantomSurfaces};
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_config::{Clipped, Config};
use penumbra_lighting::{ClippedEnergy, EnvironmentEstimator, EnvironmentSettings};
use penumbra_rig_model::RigCalibration;
use penumbra_scene::raycast::GROUND;
use penumbra_scene::{Part, RayCaster, Scene};
use std::sync::Arc;

/// What depends on real things alone.
pub(crate) struct RealLight {
    /// None where the one in use stays as it is.
    pub estimator: Option<EnvironmentEstimator>,
    pub phantoms: PhantomSurfaces,
    pub rays: Arc<RayCaster>,
}

impl RealLight {
    /// Of `scene`; the estimator, whose tables take longest, where it is `wanted`.
    pub fn new(
        rig: &RigCalibration,
        scene: &Scene,
        config: &Config,
        wanted: bool,
    ) -> Result<Self, RigError> {
        let rays = Arc::new(RayCaster::from_phantoms(scene));
        let estimator = wanted.then(|| estimator(rig, config, &rays, scene));
        Ok(Self {
            estimator: estimator.transpose()?.flatten(),
            phantoms: PhantomSurfaces::new(rig, scene),
            rays,
        })
    }
}

/// What depends on the whole scene.
pub(crate) struct SceneLight {
    pub near: IndirectLightUpdater,
    pub ground: GroundRadiance,
    /// Whether anything wants Phong's lobes.
    pub phong: bool,
    /// None where real things are what they were.
    pub real: Option<RealLight>,
}

impl SceneLight {
    /// Of `scene`, which takes the place of `before`; `casters` are its virtual parts.
    pub fn new(
        rig: &RigCalibration,
        config: &Config,
        (before, scene): (&Scene, &Scene),
        casters: &[Part],
    ) -> Result<Self, RigError> {
        let other_ground = before.ground_height != scene.ground_height;
        let same = !other_ground
            && penumbra_scene::change::same_parts(&before.phantom_parts, &scene.phantom_parts);
        let real =
            (!same).then(|| RealLight::new(rig, scene, config, other_ground || stands_among(rig)));
        let real = real.transpose()?;
        let rays = match &real {
            Some(real) => real.rays.clone(),
            None => Arc::new(RayCaster::from_phantoms(scene)),
        };
        Ok(Self {
            near: IndirectLightUpdater::new(scene, casters),
            ground: GroundRadiance::new(rig, scene, rays),
            phong: scene.has_phong(),
            real,
        })
    }
}

impl SceneLight {
    /// In place of an `older` one that nobody has taken.
    pub fn over(mut self, older: Self) -> Self {
        self.real = match (self.real, older.real) {
            (Some(mut new), Some(old)) => {
                new.estimator = new.estimator.or(old.estimator);
                Some(new)
            }
            (new, old) => new.or(old),
        };
        self
    }
}

/// Whether phantoms may hide the environment from its camera.
fn stands_among(rig: &RigCalibration) -> bool {
    let view = rig.environment.as_ref().map(|e| &e.view);
    matches!(view, Some(EnvironmentView::Fisheye { .. }))
}

/// A real thing other than the ground and the mirror itself ends the ray.
pub(crate) fn hides(rays: &RayCaster, origin: DVec3, direction: DVec3) -> bool {
    rays.nearest(origin, direction)
        .is_some_and(|hit| !hit.mirror && hit.surface != GROUND)
}

fn estimator(
    rig: &RigCalibration,
    config: &Config,
    rays: &Arc<RayCaster>,
    scene: &Scene,
) -> Result<Option<EnvironmentEstimator>, RigError> {
    let Some(environment) = &rig.environment else {
        return Ok(None);
    };
    let settings = EnvironmentSettings {
        cube_size: config.environment.cube_size,
        placement: config.environment.light_placement,
        lights: config.environment.light_count as usize,
        ground: scene.ground_height.is_some(),
        ground_height: scene.ground_height.unwrap_or_default(),
        clipped: match config.environment.clipped {
            Clipped::Estimate => ClippedEnergy::default(),
            Clipped::Keep => ClippedEnergy::Keep,
        },
        irradiance: config.environment.irradiance,
        filtering: config.shading.reflections,
        phong: scene.has_phong(),
        ..EnvironmentSettings::default()
    };
    let hidden = |o: DVec3, d: DVec3| hides(rays, o, d);
    let hidden: Option<&penumbra_lighting::resample::Hidden<'_>> = match environment.view {
        // The camera stands among the phantoms; what they hide is not the environment.
        EnvironmentView::Fisheye { .. } => Some(&hidden),
        _ => None,
    };
    let mut estimator =
        EnvironmentEstimator::new(&environment.view, &environment.response, settings, hidden)?;
    if let Some(vignetting) = &environment.vignetting {
        let size = match &environment.view {
            EnvironmentView::Fisheye { lens, .. } => (lens.width, lens.height),
            EnvironmentView::Sphere { camera, .. } => (camera.width, camera.height),
            EnvironmentView::SphereInScene { .. } => {
                let camera = &rig.scene_camera.camera;
                (camera.width, camera.height)
            }
        };
        estimator.set_vignetting(vignetting, size);
    }
    Ok(Some(estimator))
}
