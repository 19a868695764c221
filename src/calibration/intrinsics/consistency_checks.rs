//! Consistency of a calibrated lens with the rig: detects swapped cameras, another picture size and
//! another kind of lens.

use super::estimate::Options;
use super::finding::Finding;
use super::gather::Outcome;
use crate::step::CameraRole;
use penumbra_camera::EnvironmentView;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;

/// Maximum relative difference of focal lengths that may belong to the same lens.
const SAME_LENS: f64 = 0.03;
/// Minimum relative difference of focal lengths that belong to different lenses.
const OTHER_LENS: f64 = 0.15;

/// A camera's lens in the rig's present calibration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownLens {
    /// Width and height of its pictures.
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
    pub fn of(rig: &RigDocument) -> Self {
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
    pub const fn of_eye(&self, eye: CameraRole) -> Option<KnownLens> {
        match eye {
            CameraRole::Scene => self.scene,
            CameraRole::Environment => self.environment,
        }
    }
}

const fn other(eye: CameraRole) -> CameraRole {
    match eye {
        CameraRole::Scene => CameraRole::Environment,
        CameraRole::Environment => CameraRole::Scene,
    }
}

/// Returns the contradictions between the rig and the `outcome` of the camera `eye`.
#[must_use]
pub fn contradictions(
    outcome: &Outcome,
    said: &KnownLenses,
    eye: CameraRole,
    options: &Options,
) -> Vec<(Grade, Finding)> {
    let (Some(result), Some(this)) = (&outcome.result, said.of_eye(eye)) else {
        return Vec::new();
    };
    let lens = &result.estimate.lens;
    let size = (lens.width, lens.height);
    let others = said.of_eye(other(eye));
    let focal = (lens.focal.x * lens.focal.y).sqrt();
    let off = |said: KnownLens| (focal / said.focal - 1.0).abs();
    let mut found = Vec::new();
    let is_others = others.is_some_and(|o| {
        let by_size = o.size == size && this.size != size;
        let by_focal = o.size == size && off(o) < SAME_LENS && off(this) > OTHER_LENS;
        by_size || by_focal
    });
    if is_others {
        let (said, seen) = (eye.name(), other(eye).name());
        found.push((Grade::Refused, Finding::OtherCamera { said, seen }));
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
    #![allow(clippy::unwrap_used)]
    use super::*;
    use crate::intrinsics::estimate::tests::{pinhole, poses, seen};
    use crate::intrinsics::{Board, Gatherer};
    use penumbra_numerics::Random;

    #[test]
    fn swapped_cameras_modes_and_lenses_are_reported() {
        let lens = pinhole();
        let mut gatherer = Gatherer::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in seen(&lens, &poses(12, 0.4, 0.3, 5), 0.15, &mut Random::new(2)) {
            gatherer.offer_points("", (lens.width, lens.height), view.points);
        }
        let options = Options {
            model: LensModel::Brown,
            square_pixels: true,
        };
        let outcome = gatherer.finish(&options);
        let said = |size, focal, fisheye| KnownLens {
            size,
            focal,
            fisheye,
        };
        let true_one = said((lens.width, lens.height), lens.focal.x, false);
        let told = |scene, environment| {
            let lenses = KnownLenses {
                scene: Some(scene),
                environment,
            };
            contradictions(&outcome, &lenses, CameraRole::Scene, &options)
        };
        assert_eq!(told(true_one, None), []);
        let other = said((lens.width, lens.height), 0.6 * lens.focal.x, false);
        let swapped = Finding::OtherCamera {
            said: "scene",
            seen: "environment",
        };
        let refused = |finding: Finding| [(Grade::Refused, finding)];
        assert_eq!(told(other, Some(true_one)), refused(swapped.clone()));
        let small = said((320, 240), 300.0, false);
        assert_eq!(told(small, Some(true_one)), refused(swapped));
        let (width, height) = small.size;
        let mode = Finding::OtherMode { width, height };
        assert_eq!(told(small, None), [(Grade::Usable, mode)]);
        let fisheye = said((lens.width, lens.height), lens.focal.x, true);
        let model = Finding::OtherModel { model: "fisheye" };
        assert_eq!(told(fisheye, None), refused(model));
    }
}
