//! The step `map`: gathers views, checks that they suffice, and grades the map.

use super::build::{MapEstimate, TagEstimate, build_map, lines};
use super::{MapTag, Observation, View};
use crate::simulation::flat_on_table;
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, PictureInput, Progress, Step, StepInput,
    StepInputs,
};
use crate::summary::{Findings, grade};
use glam::{DVec2, DVec3};
use penumbra_fiducials::{Detector, Family, TagObservation};
use penumbra_rig_model::Grade;
use penumbra_rig_model::Header;
use penumbra_rig_model::Marker;
use penumbra_rig_model::RigCalibration;
use penumbra_rig_model::markers_file::{MarkerRecord, MarkersRecord};
use penumbra_rig_model::tracker_file::PoseRecord;
use std::collections::BTreeMap;

/// Minimum interval between two pictures, seconds.
const SPACING: f64 = 0.1;
/// Minimum mean motion of the corners between two views, as a share of the picture's width.
const MIN_MOTION: f64 = 0.015;
/// Maximum number of views; when it is exceeded every second view is dropped.
const MAX_VIEWS: usize = 240;
/// Minimum number of views of a map.
const MIN_VIEWS: usize = 4;
/// Number of views that the progress takes as enough.
const ENOUGH_VIEWS: usize = 60;
/// Maximum standard deviation of a tag's position, metres: good, usable.
const MAX_SIGMA: (f64, f64) = (0.001, 0.01);
/// Maximum RMS reprojection error with a correct lens and flat tags, pixels: good, usable.
const MAX_RMS: (f64, f64) = (0.8, 3.0);

/// Options of the step.
#[derive(Clone, Debug)]
pub struct MapOptions {
    /// Families to detect.
    pub families: Vec<Family>,
    /// Default edge of the tags' black border, metres.
    pub size: Option<f64>,
    /// Edge of single tags' black border, metres.
    pub sizes: BTreeMap<u32, f64>,
    /// The tag, flat on the table, that becomes the origin of a new world; `None` keeps the
    /// world of the calibrated tags, or uses the tag with the lowest number if there are none.
    pub origin: Option<u32>,
}

/// The step `map`.
pub struct MapStep {
    options: MapOptions,
    rig: RigCalibration,
    known: Vec<Marker>,
    detector: Detector,
    pub(super) views: Vec<Vec<TagObservation>>,
    pub(super) pictures: usize,
    /// Grows whenever views are dropped.
    min_motion: f64,
    overlay_points: Vec<DVec2>,
    /// Number of pictures that show each tag.
    seen: BTreeMap<(Family, u32), usize>,
}

impl MapStep {
    /// Creates the step for the scene camera of a rig with these calibrated markers.
    #[must_use]
    pub fn new(rig: &RigCalibration, known: &[Marker], options: MapOptions) -> Self {
        Self {
            detector: Detector::new(&options.families, &rig.scene_camera.response),
            options,
            rig: rig.clone(),
            known: known.to_vec(),
            views: Vec::new(),
            pictures: 0,
            min_motion: MIN_MOTION,
            overlay_points: Vec::new(),
            seen: BTreeMap::new(),
        }
    }

    fn observe_picture(&mut self, picture: &PictureInput) {
        let camera = &self.rig.scene_camera.camera;
        self.pictures += 1;
        let fits = (picture.picture.width, picture.picture.height) == (camera.width, camera.height);
        if !fits {
            return;
        }
        let seen = self.detector.detect(picture.picture, Some(camera)).to_vec();
        self.add_tags(seen);
    }

    /// Adds the tags of a picture.
    pub(super) fn add_tags(&mut self, seen: Vec<TagObservation>) {
        // Two tags with the same number cannot be told apart.
        let is_unique = |t: &&TagObservation| {
            let same = |o: &&TagObservation| (o.family, o.id) == (t.family, t.id);
            seen.iter().filter(same).count() == 1
        };
        let view: Vec<TagObservation> = seen.iter().filter(is_unique).copied().collect();
        self.overlay_points = view.iter().flat_map(|t| t.corners).collect();
        for tag in &view {
            *self.seen.entry((tag.family, tag.id)).or_default() += 1;
        }
        let width = f64::from(self.rig.scene_camera.camera.width);
        let is_similar = self
            .views
            .last()
            .is_some_and(|last| mean_motion(last, &view) < self.min_motion * width);
        if view.len() < 2 || is_similar {
            return;
        }
        self.views.push(view);
        if self.views.len() > MAX_VIEWS {
            let mut keep = false;
            self.views.retain(|_| {
                keep = !keep;
                keep
            });
            self.min_motion *= 1.5;
        }
    }

    fn size_of(&self, family: Family, id: u32) -> Option<f64> {
        let known = self.known(family, id).map(|m| m.size);
        let given = self.options.sizes.get(&id).copied();
        given.or(known).or(self.options.size)
    }

    fn known(&self, family: Family, id: u32) -> Option<&Marker> {
        let name = family.to_string();
        self.known.iter().find(|m| m.family == name && m.id == id)
    }

    /// Returns the tags seen, at least one with an initial pose; the error says what is missing.
    fn tags(&self) -> Result<Vec<MapTag>, String> {
        let mut numbers: Vec<(Family, u32)> = self
            .views
            .iter()
            .flatten()
            .map(|t| (t.family, t.id))
            .collect();
        numbers.sort_unstable();
        numbers.dedup();
        if self.views.len() < MIN_VIEWS {
            return Err(format!(
                "{} of {} pictures show two tags or more from a new viewpoint, {MIN_VIEWS} are needed; move the camera slowly around the tags, with several in the picture",
                self.views.len(),
                self.pictures
            ));
        }
        let mut tags = Vec::new();
        for (family, id) in numbers {
            let size = self.size_of(family, id).ok_or_else(|| {
                format!("the size of {family} {id} is not known; give --size METRES (edge of the black border) or --size-of {id}=METRES")
            })?;
            tags.push(MapTag {
                family,
                id,
                size,
                calibrated_pose: self.known(family, id).map(|m| m.world_from_marker),
                map_from_tag: None,
                is_fixed: false,
                scale: 1.0,
            });
        }
        self.fix_origin(&mut tags)?;
        Ok(tags)
    }

    /// Fixes the calibrated tags, or the origin of a new world.
    fn fix_origin(&self, tags: &mut [MapTag]) -> Result<(), String> {
        let is_calibrated = |t: &MapTag| t.calibrated_pose.is_some();
        if self.options.origin.is_none() && tags.iter().any(is_calibrated) {
            for tag in tags.iter_mut().filter(|t| is_calibrated(t)) {
                (tag.map_from_tag, tag.is_fixed) = (tag.calibrated_pose, true);
            }
            return Ok(());
        }
        let origin = match self.options.origin {
            Some(id) => tags.iter_mut().find(|t| t.id == id),
            None => tags.first_mut(),
        };
        let Some(origin) = origin else {
            return Err(
                "the tag of --origin was never seen together with another tag; choose one that was"
                    .to_owned(),
            );
        };
        origin.map_from_tag = Some(flat_on_table(0.0, DVec3::ZERO));
        origin.is_fixed = true;
        Ok(())
    }

    fn estimate(&self) -> Result<MapEstimate, String> {
        let tags = self.tags()?;
        let observation = |seen: &TagObservation| {
            let tag = tags
                .iter()
                .position(|t| (t.family, t.id) == (seen.family, seen.id))?;
            Some(Observation {
                tag,
                corners: seen.corners,
                is_used: true,
            })
        };
        let views = self.views.iter().map(|view| View {
            observations: view.iter().filter_map(observation).collect(),
            camera_from_map: None,
        });
        let views = views.collect();
        Ok(build_map(&self.rig.scene_camera.camera, tags, views))
    }

    fn assess(&self, estimate: &MapEstimate) -> Findings {
        let mut findings = estimate.findings.clone();
        if estimate.tags.len() < 2 {
            let text = "no two tags could be linked; show several in each picture, from many sides";
            findings.push((Grade::Refused, text.to_owned()));
        }
        if estimate.rms > MAX_RMS.0 {
            let grade = if estimate.rms > MAX_RMS.1 {
                Grade::Refused
            } else {
                Grade::Usable
            };
            findings.push((
                grade,
                format!(
                    "reprojection error is {:.2} px RMS; calibrate the lens (`calibrate intrinsics`), keep the tags flat and move the camera slowly",
                    estimate.rms
                ),
            ));
        }
        for tag in &estimate.tags {
            let sigma = tag.sigma.1.max_element();
            if sigma > MAX_SIGMA.0 {
                let grade = if sigma > MAX_SIGMA.1 {
                    Grade::Refused
                } else {
                    Grade::Usable
                };
                findings.push((
                    grade,
                    format!(
                        "the position of {} has a standard deviation of {:.1} mm; show it together with its neighbours from more sides",
                        tag.tag.name(),
                        1e3 * sigma
                    ),
                ));
            }
        }
        let isolated: Vec<String> = self
            .seen
            .iter()
            .filter(|((family, id), pictures)| {
                let shows_it =
                    |v: &Vec<TagObservation>| v.iter().any(|t| (t.family, t.id) == (*family, *id));
                !self.views.iter().any(shows_it) && **pictures > 2
            })
            .map(|((family, id), _)| format!("{family} {id}"))
            .collect();
        if !isolated.is_empty() {
            findings.push((
                Grade::Usable,
                format!(
                    "never seen together with another tag: {}; show them together with others",
                    isolated.join(", ")
                ),
            ));
        }
        findings
    }

    fn record(&self, estimate: &MapEstimate, header: Header) -> MarkersRecord {
        let marker = |m: &TagEstimate| MarkerRecord {
            family: m.tag.family.to_string(),
            id: m.tag.id,
            size_m: m.tag.size,
            pose: PoseRecord::new(m.pose, m.sigma),
            sightings: m.used_observations,
            rms: m.rms,
        };
        MarkersRecord {
            header,
            new_world: self.options.origin.is_some(),
            markers: estimate.tags.iter().map(marker).collect(),
        }
    }
}

/// Returns the mean motion of the corners of `view` since `last`, pixels; infinity if `last` lacks
/// one of its tags.
fn mean_motion(last: &[TagObservation], view: &[TagObservation]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for tag in view {
        let same = last
            .iter()
            .find(|t| (t.family, t.id) == (tag.family, tag.id));
        let Some(same) = same else {
            return f64::INFINITY;
        };
        for (a, b) in same.corners.iter().zip(tag.corners) {
            sum += a.distance(b);
            count += 1;
        }
    }
    sum / f64::from(count.max(1))
}

impl Step for MapStep {
    fn name(&self) -> &'static str {
        "map"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: false,
            brackets: false,
            poses: false,
            spacing: SPACING,
        }
    }

    fn observe(&mut self, input: &StepInput) {
        if let StepInput::Picture(picture) = input
            && picture.camera == CameraRole::Scene
        {
            self.observe_picture(picture);
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            share: (self.views.len() as f64 / ENOUGH_VIEWS as f64).min(1.0),
            message: format!("{} views, {} tags", self.views.len(), self.seen.len()),
            hint: if self.views.len() < ENOUGH_VIEWS {
                "move slowly around the tags, with several in the picture".to_owned()
            } else {
                String::new()
            },
            overlay_points: self.overlay_points.clone(),
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        let estimate = self.estimate();
        let mut findings = match &estimate {
            Ok(estimate) => self.assess(estimate),
            Err(reason) => vec![(Grade::Refused, reason.clone())],
        };
        let grade = grade(&mut findings);
        let lines = estimate.as_ref().map_or_else(|_| Vec::new(), lines);
        let mut found = Finished {
            grade,
            lines,
            findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        found.report = self.report(provenance, &found, estimate.as_ref().ok());
        if let (Ok(estimate), true) = (&estimate, grade != Grade::Refused) {
            let record = self.record(estimate, found.header("map", provenance));
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}
