//! Steadies the tracker's pose by what the scene camera's picture shows of real surfaces.

use crate::light::updates::SceneUpdates;
use crate::setup::RigSetup;
use glam::DVec3;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_config::PoseSource;
use penumbra_interface::MonotonicTime;
use penumbra_picture::Picture;
use penumbra_registration::{SteadiedPose, Steadying, SteadyingInput, SurfaceAt, TrackerPose};
use penumbra_scene::RayCaster;
use std::sync::Arc;

/// Steadies a rig's poses, and follows changes of its scene.
pub(crate) struct PoseSteadying {
    steadying: Steadying,
    rays: Arc<RayCaster>,
    updates: SceneUpdates,
}

impl PoseSteadying {
    /// Creates the steadying of a rig; `None` unless its poses are the tracker's. `middle`: centre of the
    /// virtual objects, world, metres.
    pub fn new(setup: &RigSetup, middle: DVec3, updates: SceneUpdates) -> Option<Self> {
        (setup.pose == PoseSource::Tracker).then(|| Self {
            steadying: Steadying::new(setup.calibration.scene_camera.camera.clone(), middle),
            rays: Arc::new(RayCaster::from_phantoms(&setup.scene)),
            updates,
        })
    }

    /// Forgets the pictures before.
    pub fn restart(&mut self) {
        self.steadying.restart();
    }

    /// Steadies the pose of a picture taken at `at`. `motion`: that of the camera during the readout. With
    /// `is_beside`, the live rig skipped the picture: those after it are steadied as if it weren't there.
    pub fn steady(
        &mut self,
        (picture, camera): (&Picture, &PinholeCamera),
        (at, is_beside): (MonotonicTime, bool),
        tracked: TrackerPose,
        motion: Option<RollingShutter>,
    ) -> SteadiedPose {
        if let Some(rays) = self.updates.take_surfaces() {
            self.rays = rays;
            self.steadying.restart();
        }
        let rays = &self.rays;
        let surfaces = |origin: DVec3, direction: DVec3| {
            let hit = rays.nearest(origin, direction).filter(|hit| !hit.mirror)?;
            Some(SurfaceAt {
                point: hit.point,
                normal: hit.normal,
            })
        };
        let input = SteadyingInput {
            at,
            camera,
            rgba: &picture.rgba,
            tracked,
            motion,
            surfaces: &surfaces,
        };
        if is_beside {
            return self.steadying.clone().steady(&input);
        }
        self.steadying.steady(&input)
    }
}
