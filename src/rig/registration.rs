//! Finds the poses of the scene camera and the mirrored sphere by the fiducials in a picture.

mod placed_ball;

use crate::lens_refiner::LensRefiner;
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
use penumbra_status::{LensStatus, RegistrationSource, RegistrationStatus};
use placed_ball::{BallView, PlacedBall};

/// Assumed standard deviation of a mirrored sphere's position in the picture, along each axis,
/// pixels, where the tracker or the sphere's own marker provides none.
pub(crate) const DEFAULT_SPHERE_SIGMA: f64 = 0.5;

/// Registers the scene camera and the mirrored sphere by fiducials.
pub(crate) struct TagRegistration {
    detector: Detector,
    camera: PinholeCamera,
    /// Readout time from one row of the camera to the next, seconds.
    row_seconds: f64,
    /// Poses by the rig's markers, if it has any.
    registrar: Option<Registrar>,
    /// Combines marker and tracker poses, if the rig uses both.
    hybrid: Option<HybridRegistration>,
    /// Number of marker poses rejected as outliers.
    rejected: u64,
    /// The mirrored sphere, if it has a marker of its own.
    marked_sphere: Option<MarkedSphere>,
    /// Centre of a stationary mirrored sphere, world, metres.
    fixed_sphere: Option<DVec3>,
    /// The stationary mirrored sphere, if a hand has placed it.
    placed_ball: Option<PlacedBall>,
    /// Refines the lens, if configured.
    refiner: Option<LensRefiner>,
}

/// A mirrored sphere with a marker of its own, and the marker's previous pose.
struct MarkedSphere {
    marker: SphereMarker,
    last_pose: Option<RigidTransform>,
}

/// The tracker's estimates for a picture.
#[derive(Clone, Copy, Default)]
pub(crate) struct TrackerEstimate {
    /// The camera's pose.
    pub pose: Option<TrackerPose>,
    /// The camera's motion during the readout of the picture.
    pub motion: Option<RollingShutter>,
}

/// The registration of a picture.
pub(crate) struct RegistrationResult {
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// The pose by markers alone, in every mode.
    pub by_markers: Option<RigidTransform>,
    /// The mirrored sphere, where this picture locates it better than the calibration.
    pub sphere: Option<SpherePosition>,
    /// Whether the sphere is movable and its marker was not found in this picture.
    pub is_sphere_lost: bool,
    /// The status of the registration.
    pub status: RegistrationStatus,
}

impl TagRegistration {
    /// Creates the registration of a rig; `None` if the rig uses no markers.
    pub fn new(setup: &RigSetup, row_seconds: f64, refiner: Option<LensRefiner>) -> Option<Self> {
        let rig = &setup.calibration;
        let marker = rig.sphere_marker.clone();
        if setup.tags.is_none() && marker.is_none() {
            return None;
        }
        let mut families: Vec<Family> = setup.tags.iter().flat_map(TagMap::families).collect();
        families.extend(marker.iter().map(|m| m.family));
        families.sort_unstable();
        families.dedup();
        let sphere = match rig.environment.as_ref().map(|e| &e.view) {
            Some(EnvironmentView::SphereInScene { sphere }) if marker.is_none() => Some(sphere),
            _ => None,
        };
        let placed_ball = sphere.and_then(PlacedBall::new);
        let fixed_sphere = sphere.map(|sphere| sphere.centre_in_world);
        Some(Self {
            detector: Detector::new(&families, &rig.scene_camera.response),
            camera: rig.scene_camera.camera.clone(),
            row_seconds,
            hybrid: (setup.pose == PoseSource::Hybrid).then(|| {
                let centre = scene_centre(&setup.scene, setup.tags.as_ref());
                HybridRegistration::new(rig.scene_camera.camera.clone(), centre)
            }),
            rejected: 0,
            registrar: setup.tags.clone().map(Registrar::new),
            fixed_sphere: fixed_sphere.filter(|_| placed_ball.is_none()),
            placed_ball,
            refiner,
            marked_sphere: marker.map(|marker| MarkedSphere {
                marker,
                last_pose: None,
            }),
        })
    }

    /// Returns the camera by which the last picture was registered.
    pub const fn camera(&self) -> &PinholeCamera {
        &self.camera
    }

    /// Returns the status of the lens, if it is being refined.
    pub fn lens_status(&self) -> Option<LensStatus> {
        self.refiner.as_ref().map(LensRefiner::status)
    }

    /// Uses a lens that was refined since the last picture.
    fn take_lens(&mut self) {
        if let Some(camera) = self.refiner.as_ref().and_then(LensRefiner::take_lens) {
            self.camera = camera;
        }
    }

    /// Registers a picture taken at `at`.
    pub fn register(
        &mut self,
        picture: &Picture,
        tracker: TrackerEstimate,
        at: MonotonicTime,
    ) -> RegistrationResult {
        self.take_lens();
        let tracked = tracker.pose;
        let seen = self.detector.detect(picture, Some(&self.camera));
        if let Some(refiner) = &mut self.refiner {
            refiner.look(seen);
        }
        let by_tracker = tracked.map(|t| t.world_from_camera);
        let mut result = RegistrationResult {
            world_from_camera: by_tracker,
            by_markers: None,
            sphere: None,
            is_sphere_lost: self.marked_sphere.is_some(),
            status: RegistrationStatus::by_tracker(tracked.is_some()),
        };
        if let Some(registrar) = &mut self.registrar {
            let prior = PosePrior {
                pose: self.hybrid.as_ref().and_then(|h| h.predicted(by_tracker)),
                motion: tracker.motion,
                row_seconds: self.row_seconds,
            };
            let found = registrar.register_with(&self.camera, seen, at, &prior);
            let unambiguous = |f: &&RegisteredPose| f.method != RegistrationMethod::TagGuessed;
            result.by_markers = found
                .as_ref()
                .filter(unambiguous)
                .map(|f| f.map_from_camera);
            let marker_pose = found.map(|f| f.map_from_camera);
            (result.world_from_camera, result.status) = match &mut self.hybrid {
                None => (marker_pose, marker_status(found.as_ref())),
                Some(hybrid) => {
                    // A guessed pose does not correct the tracker, but is better than no pose.
                    let usable = found
                        .as_ref()
                        .filter(|f| tracked.is_none() || unambiguous(f));
                    let fused = hybrid.register(at, tracked, usable.map(|f| &f.estimate));
                    let rejected =
                        fused.is_some_and(|f| f.assessment == MarkerAssessment::Rejected);
                    self.rejected += u64::from(rejected);
                    let status = hybrid_status(fused.as_ref(), usable, self.rejected);
                    (fused.map(|f| f.world_from_camera), status)
                }
            };
            let own = found.filter(|_| self.hybrid.is_none());
            result.sphere = self
                .fixed_sphere
                .and_then(|centre| result.stationary(centre, own, &self.camera));
        }
        if let (Some(sphere), Some(pose)) = (&mut self.marked_sphere, result.world_from_camera) {
            result.add_marked(sphere.find(&self.camera, seen), pose);
        }
        if let (Some(ball), Some(pose)) = (&mut self.placed_ball, result.world_from_camera) {
            let view = ball.look(picture, &self.camera, pose);
            result.add_ball(view);
        }
        result
    }
}

impl RegistrationResult {
    /// Returns a stationary sphere, with the uncertainty of the pose `found` by markers alone, else
    /// of the pose; `None` without a pose.
    fn stationary(
        &self,
        centre_in_world: DVec3,
        found: Option<RegisteredPose>,
        camera: &PinholeCamera,
    ) -> Option<SpherePosition> {
        self.world_from_camera?;
        let by_pose = || self.status.sigma_px.unwrap_or(DEFAULT_SPHERE_SIGMA);
        Some(SpherePosition {
            centre_in_world,
            sigma: found.map_or_else(by_pose, |f| f.estimate.sigma_at(camera, centre_in_world)),
        })
    }

    /// Adds a sphere with a marker of its own, at its place in the camera's space, if it was found.
    fn add_marked(&mut self, centre: Option<DVec3>, world_from_camera: RigidTransform) {
        self.is_sphere_lost = centre.is_none();
        self.sphere = centre.map(|centre_in_camera| SpherePosition {
            centre_in_world: world_from_camera.transform_point(centre_in_camera),
            sigma: DEFAULT_SPHERE_SIGMA,
        });
    }

    fn add_ball(&mut self, view: BallView) {
        self.sphere = view.position;
        self.is_sphere_lost = view.position.is_none();
        self.status.sphere_support = view.support;
        self.status.sphere_off_mm = view.off.map(|metres| metres * 1e3);
    }
}

/// Returns the status of a pose by markers alone.
fn marker_status(found: Option<&RegisteredPose>) -> RegistrationStatus {
    RegistrationStatus::by_markers(found.map(|f| {
        let guessed = f.method == RegistrationMethod::TagGuessed;
        (tag_count(f), f.estimate.rms, guessed)
    }))
}

fn tag_count(found: &RegisteredPose) -> usize {
    match found.method {
        RegistrationMethod::Map { tags } => tags,
        _ => 1,
    }
}

/// Returns the status of a pose by tracker and markers.
fn hybrid_status(
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
        ..marker_status(found)
    };
    let with_sigma = fused.sigma.map(
        |PoseSigma {
             metres,
             radians,
             pixels,
         }| status.with_sigma([metres, radians, pixels]),
    );
    with_count(with_sigma.unwrap_or(status))
}

/// Returns the centre of the bounding box of the virtual objects, or of the markers if there are no
/// virtual objects; world, metres.
pub(crate) fn scene_centre(scene: &Scene, tags: Option<&TagMap>) -> DVec3 {
    let points = scene.virtual_parts.iter().flat_map(|part| {
        let placed = |v: &penumbra_scene::Vertex| {
            part.world_from_part.transform_point3(v.position.as_dvec3())
        };
        part.mesh.vertices.iter().map(placed)
    });
    let bounding_box = |points: &mut dyn Iterator<Item = DVec3>| {
        points.fold(None, |bounds: Option<(DVec3, DVec3)>, p| {
            let (low, high) = bounds.unwrap_or((p, p));
            Some((low.min(p), high.max(p)))
        })
    };
    let mut points = points;
    let tags = tags.into_iter().flat_map(|map| map.tags());
    let mut corners = tags.flat_map(Tag::corners);
    let bounds = bounding_box(&mut points).or_else(|| bounding_box(&mut corners));
    bounds.map_or(DVec3::ZERO, |(low, high)| 0.5 * (low + high))
}

impl MarkedSphere {
    /// Returns the sphere's centre, camera space, metres. `None` if its marker is missing, or if
    /// two markers have its number.
    fn find(&mut self, camera: &PinholeCamera, seen: &[TagObservation]) -> Option<DVec3> {
        let SphereMarker {
            family,
            id,
            size,
            centre_in_marker,
        } = &self.marker;
        let mut own = seen.iter().filter(|t| (t.family, t.id) == (*family, *id));
        let (Some(tag), None) = (own.next(), own.next()) else {
            self.last_pose = None;
            return None;
        };
        let pose = nearest_pose(camera, &tag.corners, *size, self.last_pose);
        self.last_pose = pose;
        Some(pose?.transform_point(*centre_in_marker))
    }
}

#[cfg(test)]
mod tests;
