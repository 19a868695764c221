//! Where the scene camera is, and the mirrored sphere, by the fiducials in its picture.

use crate::setup::RigSetup;
use glam::DVec3;
use penumbra_camera::EnvironmentView;
use penumbra_camera::{PinholeCamera, RollingShutter};
use penumbra_config::PoseSource;
use penumbra_fiducials::{
    Detector, Family, PosePrior, RegisteredPose, Registrar, RegistrationMethod, Tag, TagMap,
    TagObservation, nearest_pose,
};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::SpherePosition;
use penumbra_picture::Picture;
use penumbra_registration::{
    HybridPose, HybridRegistration, MarkerAssessment, PoseOrigin, PoseSigma, TrackerPose,
};
use penumbra_rig_model::SphereMarker;
use penumbra_scene::Scene;
use penumbra_status::{RegistrationSource, RegistrationStatus};

/// Standard deviation of a sphere's picture by a tracker's pose or a marker of its own, pixels:
/// neither tells its own.
pub(crate) const UNTOLD_SIGMA: f64 = 0.5;

/// Looks for fiducials in the scene camera's pictures.
pub(crate) struct TagRegistration {
    detector: Detector,
    camera: PinholeCamera,
    /// From one row of it to the next.
    row_seconds: f64,
    /// Where they tell the pose.
    registrar: Option<Registrar>,
    /// Where they tell it together with the tracker.
    fusion: Option<HybridRegistration>,
    /// Poses by markers that were not believed.
    rejected: u64,
    /// Where one carries the mirrored sphere.
    probe: Option<Probe>,
    /// Centre of a sphere that stands still.
    ball: Option<DVec3>,
}

/// The marker that carries the sphere, and where it was last.
struct Probe {
    marker: SphereMarker,
    last: Option<RigidTransform>,
}

/// What the tracker tells of a picture.
#[derive(Clone, Copy, Default)]
pub(crate) struct ByTracker {
    /// The camera's pose.
    pub pose: Option<TrackerPose>,
    /// How it moved while the picture was read.
    pub motion: Option<RollingShutter>,
}

/// What a picture told.
pub(crate) struct RegistrationResult {
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// The same by markers alone, however it is used.
    pub by_markers: Option<RigidTransform>,
    /// The mirrored sphere, where this picture tells more of it than the calibration.
    pub ball: Option<SpherePosition>,
    /// The sphere is carried about, and this picture does not show where.
    pub ball_lost: bool,
    /// For the status.
    pub status: RegistrationStatus,
}

impl TagRegistration {
    /// Of a rig that wants it; `None` where nothing is to be looked for.
    pub fn new(setup: &RigSetup, row_seconds: f64) -> Option<Self> {
        let rig = &setup.calibration;
        let probe = rig.sphere_marker.clone();
        if setup.tags.is_none() && probe.is_none() {
            return None;
        }
        let mut families: Vec<Family> = setup.tags.iter().flat_map(TagMap::families).collect();
        families.extend(probe.iter().map(|p| p.family));
        families.sort_unstable();
        families.dedup();
        let ball = match rig.environment.as_ref().map(|e| &e.view) {
            Some(EnvironmentView::SphereInScene { sphere }) => Some(sphere.centre_in_world),
            _ => None,
        };
        Some(Self {
            detector: Detector::new(&families, &rig.scene_camera.response),
            camera: rig.scene_camera.camera.clone(),
            row_seconds,
            fusion: (setup.pose == PoseSource::Hybrid).then(|| {
                let middle = middle(&setup.scene, setup.tags.as_ref());
                HybridRegistration::new(rig.scene_camera.camera.clone(), middle)
            }),
            rejected: 0,
            registrar: setup.tags.clone().map(Registrar::new),
            ball: ball.filter(|_| probe.is_none()),
            probe: probe.map(|marker| Probe { marker, last: None }),
        })
    }

    /// What a picture tells.
    pub fn register(
        &mut self,
        picture: &Picture,
        by: ByTracker,
        at: MonotonicTime,
    ) -> RegistrationResult {
        let tracked = by.pose;
        let seen = self.detector.detect(picture, Some(&self.camera));
        let by_tracker = tracked.map(|t| t.world_from_camera);
        let mut told = RegistrationResult {
            world_from_camera: by_tracker,
            by_markers: None,
            ball: None,
            ball_lost: self.probe.is_some(),
            status: RegistrationStatus::by_tracker(tracked.is_some()),
        };
        if let Some(registrar) = &mut self.registrar {
            let expected = PosePrior {
                pose: self.fusion.as_ref().and_then(|f| f.predicted(by_tracker)),
                motion: by.motion,
                row_seconds: self.row_seconds,
            };
            let found = registrar.register_with(&self.camera, seen, at, &expected);
            let sure = |f: &&RegisteredPose| f.method != RegistrationMethod::TagGuessed;
            told.by_markers = found.as_ref().filter(sure).map(|f| f.map_from_camera);
            (told.world_from_camera, told.status) = match &mut self.fusion {
                None => (found.map(|f| f.map_from_camera), by_markers(found.as_ref())),
                Some(fusion) => {
                    // A guess corrects nothing; alone it is better than no pose.
                    let sure = |f: &&RegisteredPose| {
                        tracked.is_none() || f.method != RegistrationMethod::TagGuessed
                    };
                    let sure = found.as_ref().filter(sure);
                    let fused = fusion.register(at, tracked, sure.map(|f| &f.estimate));
                    let rejected =
                        fused.is_some_and(|f| f.assessment == MarkerAssessment::Rejected);
                    self.rejected += u64::from(rejected);
                    let status = by_both(fused.as_ref(), sure, self.rejected);
                    (fused.map(|f| f.world_from_camera), status)
                }
            };
            told.ball = told
                .world_from_camera
                .zip(self.ball)
                .map(|(_, centre)| SpherePosition {
                    centre_in_world: centre,
                    sigma: match (found, told.status.sigma_px) {
                        (Some(f), _) if self.fusion.is_none() => {
                            f.estimate.sigma_at(&self.camera, centre)
                        }
                        (_, sigma) => sigma.unwrap_or(UNTOLD_SIGMA),
                    },
                });
        }
        if let (Some(probe), Some(pose)) = (&mut self.probe, told.world_from_camera) {
            let centre = probe.find(&self.camera, seen);
            told.ball_lost = centre.is_none();
            told.ball = centre.map(|centre_in_camera| SpherePosition {
                centre_in_world: pose.transform_point(centre_in_camera),
                sigma: UNTOLD_SIGMA,
            });
        }
        told
    }
}

/// For the status: a pose by markers alone.
fn by_markers(found: Option<&RegisteredPose>) -> RegistrationStatus {
    RegistrationStatus::by_markers(found.map(|f| {
        let guessed = f.method == RegistrationMethod::TagGuessed;
        (tags_of(f), f.estimate.rms, guessed)
    }))
}

fn tags_of(found: &RegisteredPose) -> usize {
    match found.method {
        RegistrationMethod::Map { tags } => tags,
        _ => 1,
    }
}

/// For the status: a pose by tracker and markers.
fn by_both(
    fused: Option<&HybridPose>,
    found: Option<&RegisteredPose>,
    rejected: u64,
) -> RegistrationStatus {
    let with_count = |status| RegistrationStatus { rejected, ..status };
    let Some(fused) = fused else {
        return with_count(RegistrationStatus::default());
    };
    let status = RegistrationStatus {
        source: match fused.source {
            PoseOrigin::Tracker => RegistrationSource::Tracker,
            PoseOrigin::Corrected { .. } => RegistrationSource::Hybrid,
            PoseOrigin::Markers => RegistrationSource::Markers,
        },
        corrected_ago_s: match fused.source {
            PoseOrigin::Corrected { age } => Some(age),
            PoseOrigin::Tracker | PoseOrigin::Markers => None,
        },
        correction_mm: fused.correction.map(|[metres, _]| metres * 1e3),
        correction_deg: fused.correction.map(|[_, radians]| radians.to_degrees()),
        settling_px: Some(fused.remaining_pixels),
        ..by_markers(found)
    };
    let told = fused.sigma.map(
        |PoseSigma {
             metres,
             radians,
             pixels,
         }| status.with_sigma([metres, radians, pixels]),
    );
    with_count(told.unwrap_or(status))
}

/// What the virtual objects stand about, else the markers; world, metres.
pub(crate) fn middle(scene: &Scene, tags: Option<&TagMap>) -> DVec3 {
    let points = scene.virtual_parts.iter().flat_map(|part| {
        let placed = |v: &penumbra_scene::Vertex| {
            part.world_from_part.transform_point3(v.position.as_dvec3())
        };
        part.mesh.vertices.iter().map(placed)
    });
    let box_of = |points: &mut dyn Iterator<Item = DVec3>| {
        points.fold(None, |bounds: Option<(DVec3, DVec3)>, p| {
            let (low, high) = bounds.unwrap_or((p, p));
            Some((low.min(p), high.max(p)))
        })
    };
    let mut points = points;
    let tags = tags.into_iter().flat_map(|map| map.tags());
    let mut corners = tags.flat_map(Tag::corners);
    let bounds = box_of(&mut points).or_else(|| box_of(&mut corners));
    bounds.map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high))
}

impl Probe {
    /// The sphere's centre in the camera's frame. Of two markers with its number
    /// neither is believed.
    fn find(&mut self, camera: &PinholeCamera, seen: &[TagObservation]) -> Option<DVec3> {
        let SphereMarker {
            family,
            id,
            size,
            centre_in_marker,
        } = &self.marker;
        let mut own = seen.iter().filter(|t| (t.family, t.id) == (*family, *id));
        let (Some(tag), None) = (own.next(), own.next()) else {
            self.last = None;
            return None;
        };
        let pose = nearest_pose(camera, &tag.corners, *size, self.last);
        self.last = pose;
        Some(pose?.transform_point(*centre_in_marker))
    }
}

#[cfg(test)]
mod tests;
