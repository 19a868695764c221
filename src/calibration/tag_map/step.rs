//! The step `map`: gathers views, checks that they suffice, and grades the map.

use super::build::{Built, Mapped, build, lines};
use super::{Seen, Sight, View};
use crate::simulation::lying;
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, PictureInput, Progress, Step, StepInput,
    StepInputs,
};
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
const ALIKE: f64 = 0.015;
/// Maximum number of views; beyond it every other one is dropped.
const MOST_VIEWS: usize = 240;
/// Minimum number of views of a map.
const LEAST_VIEWS: usize = 4;
/// Maximum standard deviation of a tag's position, metres: good, usable.
const GOOD: f64 = 0.001;
const USABLE: f64 = 0.01;
/// Maximum RMS reprojection error with a correct lens and flat tags, pixels: good, usable.
const SHARP: (f64, f64) = (0.8, 3.0);

/// Options of the step.
#[derive(Clone, Debug)]
pub struct MapOptions {
    /// Families to detect.
    pub families: Vec<Family>,
    /// Default edge of the tags' black border, metres.
    pub size: Option<f64>,
    /// Edge of single tags' black border, metres.
    pub sizes: BTreeMap<u32, f64>,
    /// The tag, flat on the table, that becomes the origin of a new world; `None` keeps the world of
    /// the tags that the calibration knows, or uses the lowest number if it knows none.
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
    stride: f64,
    marks: Vec<DVec2>,
    alone: BTreeMap<(Family, u32), usize>,
}

impl MapStep {
    /// Creates the step for the scene camera of a rig whose markers are known as given.
    #[must_use]
    pub fn new(rig: &RigCalibration, known: &[Marker], options: MapOptions) -> Self {
        Self {
            detector: Detector::new(&options.families, &rig.scene_camera.response),
            options,
            rig: rig.clone(),
            known: known.to_vec(),
            views: Vec::new(),
            pictures: 0,
            stride: ALIKE,
            marks: Vec::new(),
            alone: BTreeMap::new(),
        }
    }

    fn take(&mut self, picture: &PictureInput) {
        let camera = &self.rig.scene_camera.camera;
        self.pictures += 1;
        let fits = (picture.picture.width, picture.picture.height) == (camera.width, camera.height);
        if !fits {
            return;
        }
        let seen = self.detector.detect(picture.picture, Some(camera)).to_vec();
        self.show(seen);
    }

    /// Adds the tags of a picture.
    pub(super) fn show(&mut self, seen: Vec<TagObservation>) {
        // Of two tags with the same number, neither can be identified.
        let once = |t: &&TagObservation| {
            let same = |o: &&TagObservation| (o.family, o.id) == (t.family, t.id);
            seen.iter().filter(same).count() == 1
        };
        let view: Vec<TagObservation> = seen.iter().filter(once).copied().collect();
        self.marks = view.iter().flat_map(|t| t.corners).collect();
        for tag in &view {
            *self.alone.entry((tag.family, tag.id)).or_default() += 1;
        }
        let width = f64::from(self.rig.scene_camera.camera.width);
        let alike = self
            .views
            .last()
            .is_some_and(|last| moved(last, &view) < self.stride * width);
        if view.len() < 2 || alike {
            return;
        }
        self.views.push(view);
        if self.views.len() > MOST_VIEWS {
            let mut keep = false;
            self.views.retain(|_| {
                keep = !keep;
                keep
            });
            self.stride *= 1.5;
        }
    }

    fn size_of(&self, family: Family, id: u32) -> Option<f64> {
        let known = self.known(family, id).map(|m| m.size);
        let said = self.options.sizes.get(&id).copied();
        said.or(known).or(self.options.size)
    }

    fn known(&self, family: Family, id: u32) -> Option<&Marker> {
        let name = family.to_string();
        self.known.iter().find(|m| m.family == name && m.id == id)
    }

    /// Returns the tags seen, at least one with an initial pose; else what is missing.
    fn tags(&self) -> Result<Vec<Seen>, String> {
        let mut numbers: Vec<(Family, u32)> = self
            .views
            .iter()
            .flatten()
            .map(|t| (t.family, t.id))
            .collect();
        numbers.sort_unstable();
        numbers.dedup();
        if self.views.len() < LEAST_VIEWS {
            return Err(format!(
                "{} of {} pictures show two tags or more from another place; move the camera slowly about them, several in the picture",
                self.views.len(),
                self.pictures
            ));
        }
        let mut tags = Vec::new();
        for (family, id) in numbers {
            let size = self.size_of(family, id).ok_or_else(|| {
                format!("the size of {family} {id} is not known; say --size METRES (edge of the black border), or --size-of {id}=METRES")
            })?;
            tags.push(Seen {
                family,
                id,
                size,
                known: self.known(family, id).map(|m| m.world_from_marker),
                map_from_tag: None,
                fixed: false,
                scale: 1.0,
            });
        }
        self.anchor(&mut tags)?;
        Ok(tags)
    }

    fn anchor(&self, tags: &mut [Seen]) -> Result<(), String> {
        let keep = self.options.origin.is_none() && tags.iter().any(|t| t.known.is_some());
        if keep {
            for tag in tags.iter_mut().filter(|t| t.known.is_some()) {
                (tag.map_from_tag, tag.fixed) = (tag.known, true);
            }
            return Ok(());
        }
        let origin = match self.options.origin {
            Some(id) => tags.iter_mut().find(|t| t.id == id),
            None => tags.first_mut(),
        };
        let Some(origin) = origin else {
            return Err(
                "the tag named by --origin is never seen with others; name one that is".to_owned(),
            );
        };
        origin.map_from_tag = Some(lying(0.0, DVec3::ZERO));
        origin.fixed = true;
        Ok(())
    }

    fn built(&self) -> Result<Built, String> {
        let tags = self.tags()?;
        let sight = |seen: &TagObservation| {
            let tag = tags
                .iter()
                .position(|t| (t.family, t.id) == (seen.family, seen.id))?;
            Some(Sight {
                tag,
                corners: seen.corners,
                used: true,
            })
        };
        let views = self.views.iter().map(|view| View {
            sights: view.iter().filter_map(sight).collect(),
            camera_from_map: None,
        });
        let views = views.collect();
        Ok(build(&self.rig.scene_camera.camera, tags, views))
    }

    fn judge(&self, built: &Built) -> Vec<(Grade, String)> {
        let mut findings = built.findings.clone();
        if built.tags.len() < 2 {
            let none = "no two tags could be linked; show several in each picture, from many sides";
            findings.push((Grade::Refused, none.to_owned()));
        }
        if built.rms > SHARP.0 {
            let grade = if built.rms > SHARP.1 {
                Grade::Refused
            } else {
                Grade::Usable
            };
            findings.push((
                grade,
                format!(
                    "corners are {:.2} px off; calibrate the lens (`calibrate intrinsics`), keep tags flat and the camera slow",
                    built.rms
                ),
            ));
        }
        for tag in &built.tags {
            let sigma = tag.sigma.1.max_element();
            if sigma > GOOD {
                let grade = if sigma > USABLE {
                    Grade::Refused
                } else {
                    Grade::Usable
                };
                findings.push((
                    grade,
                    format!(
                        "{} is known to {:.1} mm only; show it together with its neighbours from more sides",
                        tag.seen.name(),
                        1e3 * sigma
                    ),
                ));
            }
        }
        let never: Vec<String> = self
            .alone
            .keys()
            .filter(|(family, id)| {
                let there =
                    |v: &Vec<TagObservation>| v.iter().any(|t| (t.family, t.id) == (*family, *id));
                !self.views.iter().any(there) && self.alone[&(*family, *id)] > 2
            })
            .map(|(family, id)| format!("{family} {id}"))
            .collect();
        if !never.is_empty() {
            findings.push((
                Grade::Usable,
                format!(
                    "seen alone only: {}; show them together with others",
                    never.join(", ")
                ),
            ));
        }
        findings
    }

    fn record(&self, built: &Built, header: Header) -> MarkersRecord {
        let marker = |m: &Mapped| MarkerRecord {
            family: m.seen.family.to_string(),
            id: m.seen.id,
            size_m: m.seen.size,
            pose: PoseRecord::new(m.pose, m.sigma),
            sightings: m.sights.0,
            rms: m.rms,
        };
        MarkersRecord {
            header,
            new_world: self.options.origin.is_some(),
            markers: built.tags.iter().map(marker).collect(),
        }
    }
}

/// Returns the mean distance of corners that both views show, pixels; large if they show
/// different tags.
fn moved(last: &[TagObservation], view: &[TagObservation]) -> f64 {
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

    fn observe(&mut self, shown: &StepInput) {
        if let StepInput::Picture(picture) = shown
            && picture.camera == CameraRole::Scene
        {
            self.take(picture);
        }
    }

    fn progress(&self) -> Progress {
        Progress {
            share: (self.views.len() as f64 / 60.0).min(1.0),
            message: format!("{} views, {} tags", self.views.len(), self.alone.len()),
            hint: if self.views.len() < 60 {
                "move slowly about the tags, several in the picture".to_owned()
            } else {
                String::new()
            },
            overlay_points: self.marks.clone(),
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, provenance: &CalibrationProvenance) -> Finished {
        let built = self.built();
        let mut findings = match &built {
            Ok(built) => self.judge(built),
            Err(reason) => vec![(Grade::Refused, reason.clone())],
        };
        findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        let grade = findings.first().map_or(Grade::Good, |f| f.0);
        let lines = built.as_ref().map_or_else(|_| Vec::new(), lines);
        let mut found = Finished {
            grade,
            lines,
            findings,
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        found.report = self.page(provenance, &found, built.as_ref().ok());
        if let (Ok(built), true) = (&built, grade != Grade::Refused) {
            let record = self.record(built, found.header("map", provenance));
            found.file = serde_json::to_string_pretty(&record).ok();
        }
        found
    }
}
