//! Checks the consistency of a calibrated lens with the rig: swapped cameras, another picture size,
//! another lens model.

use super::estimate::Options;
use super::findings::Finding;
use super::view_collector::Outcome;
use crate::step::CameraRole;
use penumbra_camera::EnvironmentView;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;

/// Maximum relative difference of focal lengths that may belong to the same lens.
const MAX_SAME_LENS: f64 = 0.03;
/// Minimum relative difference of focal lengths that belong to different lenses.
const MIN_OTHER_LENS: f64 = 0.15;

/// A camera's lens in the rig's present calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownLens {
    /// Width and height of its pictures, pixels.
    pub size: (u32, u32),
    /// Focal length, pixels or (fisheye) pixels per radian.
    pub focal: f64,
    /// The lens is a fisheye (Kannala–Brandt).
    pub fisheye: bool,
}

/// Both cameras' lenses in the rig's present calibration, if known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct KnownLenses {
    /// The scene camera's.
    pub scene: Option<KnownLens>,
    /// The environment camera's.
    pub environment: Option<KnownLens>,
}

impl KnownLenses {
    /// Returns the lenses of a rig.
    #[must_use]
    pub fn from_rig(rig: &RigDocument) -> Self {
        let pinhole = |camera: &penumbra_camera::PinholeCamera| KnownLens {
            size: (camera.width, camera.height),
            focal: camera.focal.x,
            fisheye: false,
        };
        let view = rig.calibration.environment.as_ref().map(|e| &e.view);
        Self {
            scene: Some(pinhole(&rig.calibration.scene_camera.camera)),
            environment: match view {
                Some(EnvironmentView::Fisheye { lens, .. }) => Some(KnownLens {
                    size: (lens.width, lens.height),
                    focal: lens.focal,
                    fisheye: true,
                }),
                Some(EnvironmentView::Sphere { camera, .. }) => Some(pinhole(camera)),
                _ => None,
            },
        }
    }

    /// Returns the lens of one camera.
    #[must_use]
    pub const fn lens(&self, camera: CameraRole) -> Option<KnownLens> {
        match camera {
            CameraRole::Scene => self.scene,
            CameraRole::Environment => self.environment,
        }
    }
}

const fn other_role(camera: CameraRole) -> CameraRole {
    match camera {
        CameraRole::Scene => CameraRole::Environment,
        CameraRole::Environment => CameraRole::Scene,
    }
}

/// Returns the inconsistencies between the rig's lenses and the `outcome` of a calibration of
/// `camera`.
#[must_use]
pub fn inconsistencies(
    outcome: &Outcome,
    present: &KnownLenses,
    camera: CameraRole,
    options: &Options,
) -> Vec<(Grade, Finding)> {
    let (Some(result), Some(this)) = (&outcome.result, present.lens(camera)) else {
        return Vec::new();
    };
    let lens = &result.estimate.lens;
    let size = (lens.width, lens.height);
    let other = present.lens(other_role(camera));
    let focal = (lens.focal.x * lens.focal.y).sqrt();
    let difference = |lens: KnownLens| (focal / lens.focal - 1.0).abs();
    let mut found = Vec::new();
    let is_other_camera = other.is_some_and(|o| {
        let by_size = o.size == size && this.size != size;
        let by_focal =
            o.size == size && difference(o) < MAX_SAME_LENS && difference(this) > MIN_OTHER_LENS;
        by_size || by_focal
    });
    if is_other_camera {
        let (given, seen) = (camera.name(), other_role(camera).name());
        found.push((Grade::Refused, Finding::OtherCamera { given, seen }));
    } else if this.size != size {
        found.push((
            Grade::Usable,
            Finding::OtherMode {
                width: this.size.0,
                height: this.size.1,
            },
        ));
    }
    if this.fisheye != (options.model == LensModel::KannalaBrandt) {
        let model = if this.fisheye { "fisheye" } else { "brown" };
        found.push((Grade::Refused, Finding::OtherModel { model }));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::intrinsics::estimate::tests::{pinhole, poses, simulated_views};
    use crate::intrinsics::{Board, ViewCollector};
    use penumbra_numerics::Random;

    #[test]
    fn reports_swapped_cameras_other_mode_and_other_model() {
        let lens = pinhole();
        let mut collector = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in simulated_views(&lens, &poses(12, 0.4, 0.3, 5), 0.15, &mut Random::new(2)) {
            collector.add_points("", (lens.width, lens.height), view.points);
        }
        let options = Options {
            model: LensModel::Brown,
            square_pixels: true,
        };
        let outcome = collector.finish(&options);
        let known = |size, focal, fisheye| KnownLens {
            size,
            focal,
            fisheye,
        };
        let correct = known((lens.width, lens.height), lens.focal.x, false);
        let findings = |scene, environment| {
            let lenses = KnownLenses {
                scene: Some(scene),
                environment,
            };
            inconsistencies(&outcome, &lenses, CameraRole::Scene, &options)
        };
        assert_eq!(findings(correct, None), []);
        let other = known((lens.width, lens.height), 0.6 * lens.focal.x, false);
        let swapped = Finding::OtherCamera {
            given: "scene",
            seen: "environment",
        };
        let refused = |finding: Finding| [(Grade::Refused, finding)];
        assert_eq!(findings(other, Some(correct)), refused(swapped.clone()));
        let small = known((320, 240), 300.0, false);
        assert_eq!(findings(small, Some(correct)), refused(swapped));
        let (width, height) = small.size;
        let mode = Finding::OtherMode { width, height };
        assert_eq!(findings(small, None), [(Grade::Usable, mode)]);
        let fisheye = known((lens.width, lens.height), lens.focal.x, true);
        let model = Finding::OtherModel { model: "fisheye" };
        assert_eq!(findings(fisheye, None), refused(model));
    }
}
