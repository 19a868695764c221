//! Where the scene camera is, and the mirrored sphere, by the fiducials in its picture.

use super::{RigError, RigSetup};
use crate::calibration::PinholeCamera;
use crate::calibration::fiducial::{
    Detector, Family, Registrar, Registration, Tag, TagMap, TagSeen, nearest_pose,
};
use crate::calibration::rig::{EnvironmentView, SphereMarker};
use crate::calibration::rig_json::Marker;
use crate::config::{Config, PoseSource};
use crate::environment::BallSeen;
use crate::picture::Picture;
use crate::status::RegistrationStatus;
use glam::DVec3;
use penumbra_interface::{MonotonicTime, RigidTransform};

/// Standard deviation of a sphere's picture by a tracker's pose or a marker of its own, pixels:
/// neither tells its own.
pub(super) const UNTOLD_SIGMA: f64 = 0.5;

/// Looks for fiducials in the scene camera's pictures.
pub(super) struct Station {
    detector: Detector,
    camera: PinholeCamera,
    /// Where they tell the pose.
    registrar: Option<Registrar>,
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

/// What a picture told.
pub(super) struct Told {
    /// The scene camera's pose.
    pub world_from_camera: Option<RigidTransform>,
    /// The mirrored sphere, where this picture tells more of it than the calibration.
    pub ball: Option<BallSeen>,
    /// The sphere is carried about, and this picture does not show where.
    pub ball_lost: bool,
    /// For the status.
    pub status: RegistrationStatus,
}

impl Station {
    /// Of a rig that wants it; `None` where nothing is to be looked for.
    pub fn new(setup: &RigSetup) -> Option<Self> {
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
            registrar: setup.tags.clone().map(Registrar::new),
            ball: ball.filter(|_| probe.is_none()),
            probe: probe.map(|marker| Probe { marker, last: None }),
        })
    }

    /// What a picture tells; `tracked` is the pose by the tracker.
    pub fn look(
        &mut self,
        picture: &Picture,
        tracked: Option<RigidTransform>,
        at: MonotonicTime,
    ) -> Told {
        let seen = self.detector.detect(picture, Some(&self.camera));
        let mut told = Told {
            world_from_camera: tracked,
            ball: None,
            ball_lost: self.probe.is_some(),
            status: RegistrationStatus::by_tracker(tracked.is_some()),
        };
        if let Some(registrar) = &mut self.registrar {
            let found = registrar.register(&self.camera, seen, at);
            told.world_from_camera = found.map(|f| f.map_from_camera);
            told.status = RegistrationStatus::by_markers(found.map(|f| {
                let tags = match f.how {
                    Registration::Map { tags } => tags,
                    _ => 1,
                };
                (tags, f.estimate.rms, f.how == Registration::TagGuessed)
            }));
            told.ball = found.zip(self.ball).map(|(f, centre)| BallSeen {
                centre_in_world: centre,
                sigma: f.estimate.sigma_at(&self.camera, centre),
            });
        }
        if let (Some(probe), Some(pose)) = (&mut self.probe, told.world_from_camera) {
            let centre = probe.find(&self.camera, seen);
            told.ball_lost = centre.is_none();
            told.ball = centre.map(|centre_in_camera| BallSeen {
                centre_in_world: pose.transform_point(centre_in_camera),
                sigma: UNTOLD_SIGMA,
            });
        }
        told
    }
}

impl Probe {
    /// The sphere's centre in the camera's frame. Of two markers with its number
    /// neither is believed.
    fn find(&mut self, camera: &PinholeCamera, seen: &[TagSeen]) -> Option<DVec3> {
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

/// The map of the calibration's markers, where the configuration wants the pose by them.
pub(super) fn wanted_tags(markers: &[Marker], config: &Config) -> Result<Option<TagMap>, RigError> {
    if config.registration.pose == PoseSource::Tracker {
        return Ok(None);
    }
    if markers.is_empty() {
        return Err(RigError::NoMarkers);
    }
    let tag = |m: &Marker| {
        let family = m.family.parse().map_err(|e| RigError::Markers {
            reason: format!("{e}"),
        })?;
        Ok(Tag {
            family,
            id: m.id,
            size: m.size,
            map_from_tag: m.world_from_marker,
        })
    };
    let tags = markers.iter().map(tag).collect::<Result<_, RigError>>()?;
    let map = TagMap::new(tags).map_err(|e| RigError::Markers {
        reason: e.to_string(),
    })?;
    Ok(Some(map))
}

#[cfg(test)]
mod tests;
