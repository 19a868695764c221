//! Tables that the light estimator derives from the scene. They are rebuilt off the frame path when
//! the scene changes.

use crate::error::RigError;
use crate::light::indirect::IndirectLightUpdater;
use crate::light::surfaces::{GroundRadiance, PhantomSurfaces};
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_config::{Clipped, Config};
use penumbra_lighting::{
    ClippedEnergy, EnvironmentEstimator, EnvironmentSettings, read_environment_map,
};
use penumbra_rig_model::{EnvironmentSource, RigCalibration};
use penumbra_scene::raycast::GROUND;
use penumbra_scene::{Part, RayCaster, Scene};
use std::sync::Arc;

/// Tables that depend on the real scene alone.
pub(crate) struct RealLight {
    /// `None` if the current estimator stays in use.
    pub estimator: Option<EnvironmentEstimator>,
    pub phantoms: PhantomSurfaces,
    pub rays: Arc<RayCaster>,
}

impl RealLight {
    /// Creates the tables for `scene`; the estimator, which takes longest, only if `wanted`.
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

/// Tables that depend on the entire scene.
pub(crate) struct SceneLight {
    pub indirect: IndirectLightUpdater,
    pub ground: GroundRadiance,
    /// Whether a material needs Phong's lobes.
    pub phong: bool,
    /// The middle of the virtual objects, world, metres.
    pub reference: DVec3,
    /// `None` if the real scene has not changed.
    pub real: Option<RealLight>,
}

impl SceneLight {
    /// Creates the tables for `scene`, which replaces `before`; `casters` are its virtual parts.
    pub fn new(
        rig: &RigCalibration,
        config: &Config,
        (before, scene): (&Scene, &Scene),
        casters: &[Part],
    ) -> Result<Self, RigError> {
        let other_ground = before.ground_height != scene.ground_height;
        let same = !other_ground
            && penumbra_scene::change::same_parts(&before.phantom_parts, &scene.phantom_parts);
        let real = (!same).then(|| {
            RealLight::new(
                rig,
                scene,
                config,
                other_ground || phantoms_may_occlude(rig),
            )
        });
        let real = real.transpose()?;
        let rays = match &real {
            Some(real) => real.rays.clone(),
            None => Arc::new(RayCaster::from_phantoms(scene)),
        };
        Ok(Self {
            indirect: IndirectLightUpdater::new(scene, casters),
            ground: GroundRadiance::new(rig, scene, rays),
            phong: scene.has_phong(),
            reference: middle_of_objects(scene),
            real,
        })
    }
}

impl SceneLight {
    /// Merges with an `older` change that was not applied.
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

/// Returns the middle of the virtual objects, world, metres; the origin without any.
pub(crate) fn middle_of_objects(scene: &Scene) -> DVec3 {
    let vertices = scene.virtual_parts.iter().flat_map(|part| {
        let each = part.mesh.vertices.iter();
        each.map(|v| part.world_from_part.transform_point3(v.position.as_dvec3()))
    });
    let nothing = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let (low, high) = vertices.fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    if low.x > high.x {
        return DVec3::ZERO;
    }
    0.5 * (low + high)
}

/// Returns whether phantoms may occlude the environment camera's view, in a fixed sphere or directly.
fn phantoms_may_occlude(rig: &RigCalibration) -> bool {
    let view = rig.environment.as_ref().map(|e| &e.view);
    matches!(
        view,
        Some(EnvironmentView::Fisheye { .. } | EnvironmentView::Sphere { .. })
    )
}

/// Returns whether a real object other than the ground or the mirror occludes the ray.
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
    if config.environment.source == EnvironmentSource::Map {
        return stated(config, settings);
    }
    let Some(environment) = &rig.environment else {
        return Ok(None);
    };
    let hidden = |o: DVec3, d: DVec3| hides(rays, o, d);
    let hidden: Option<&penumbra_lighting::resample::Hidden<'_>> = match environment.view {
        // The camera or the sphere is among the phantoms; directions that they occlude are not the
        // environment.
        EnvironmentView::Fisheye { .. } | EnvironmentView::Sphere { .. } => Some(&hidden),
        EnvironmentView::SphereInScene { .. } => None,
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

/// Returns the estimator of the light that the configuration states.
fn stated(
    config: &Config,
    settings: EnvironmentSettings,
) -> Result<Option<EnvironmentEstimator>, RigError> {
    let map = config.environment.map.as_ref().ok_or(RigError::NoMap)?;
    let picture = read_environment_map(&map.path)?;
    let placed = (map.yaw, map.factor);
    let estimator = EnvironmentEstimator::from_map(&picture, placed, settings)?;
    Ok(Some(estimator))
}
