//! The step `intrinsics`: calibrates one camera's lens from a board shown to it.

use super::assessment::Assessment;
use super::board::Board;
use super::detect::Grey;
use super::estimate::Options;
use super::report;
use super::sharpness::{Sharpness, SharpnessGatherer};
use super::view_collector::{AssessedLens, Outcome, PictureResult, ViewCollector};
use crate::intrinsics::KnownLenses;
use crate::intrinsics::consistency_checks::inconsistencies;
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, Progress, Step, StepInput, StepInputs,
};
use crate::summary::{Findings, grade};
use penumbra_camera::Response;
use penumbra_picture::Picture;
use penumbra_rig_model::DeviceRecord;
use penumbra_rig_model::Grade;
use penumbra_rig_model::RigDocument;
use penumbra_rig_model::lens_record::LensRecord;
use std::fmt::Write;

/// Minimum interval between two pictures, seconds.
const MIN_SPACING: f64 = 0.2;
/// Number of pictures after which the interval grows by another `MIN_SPACING`.
const SLOWDOWN_PICTURES: f64 = 300.0;
/// Sufficient number of views.
const ENOUGH_VIEWS: f64 = 15.0;
/// Minimum number of views for an intermediate estimate, which shows what is missing.
const MIN_VIEWS: usize = 4;

/// Collects views of a board in one camera's pictures, estimates the lens and assesses it.
#[derive(Clone, Debug)]
pub struct IntrinsicsStep {
    camera: CameraRole,
    board: Board,
    options: Options,
    present: KnownLenses,
    collector: ViewCollector,
    sharpness: SharpnessGatherer,
    response: Response,
    pictures: usize,
    last: Option<PictureResult>,
    intermediate: Option<(AssessedLens, Assessment)>,
    /// Number of views at which the next intermediate lens is estimated.
    next: usize,
}

impl IntrinsicsStep {
    /// Creates the step for one camera; `present` are the lenses of the rig's present calibration.
    #[must_use]
    pub fn new(camera: CameraRole, board: Board, options: Options, present: KnownLenses) -> Self {
        Self {
            camera,
            board,
            options,
            present,
            collector: ViewCollector::new(board),
            sharpness: SharpnessGatherer::default(),
            response: Response::srgb(),
            pictures: 0,
            last: None,
            intermediate: None,
            next: MIN_VIEWS,
        }
    }

    /// Measures the sharpness in the tone curve of the rig's camera; by default sRGB.
    #[must_use]
    pub fn with_rig(mut self, rig: &RigDocument) -> Self {
        let scene = &rig.calibration.scene_camera.response;
        let environment = rig.calibration.environment.as_ref();
        let response = match self.camera {
            CameraRole::Scene => Some(scene),
            CameraRole::Environment => environment.map(|e| &e.response),
        };
        self.response.clone_from(response.unwrap_or(scene));
        self
    }

    /// Detects the board in a picture and keeps it as a view; `name` identifies the view in the
    /// report.
    pub fn add_picture(&mut self, name: &str, picture: &Picture) {
        self.pictures += 1;
        let grey = Grey::from_picture(picture);
        let result = self.collector.add_picture(name, &grey);
        if let (PictureResult::Added { .. }, Some(view)) = (result, self.collector.views().last()) {
            let points = &view.points;
            self.sharpness
                .add(&grey, points, &self.board, &self.response);
        }
        self.last = Some(result);
        let views = self.collector.views().len();
        if views >= self.next {
            self.intermediate = self.collector.intermediate(&self.options);
            // After a quarter more views: hints change slowly, and estimates take time.
            self.next = (views + 1).max(views * 5 / 4);
        }
    }

    /// Returns every corner kept as CSV with a header: view, position on the board in metres,
    /// pixel.
    #[must_use]
    pub fn corners(&self) -> String {
        let mut out = String::from("view,board_x_m,board_y_m,pixel_x,pixel_y\n");
        for view in self.collector.views() {
            let name = view.name.replace([',', '\n', '\r'], " ");
            for c in &view.points {
                let _ = writeln!(
                    out,
                    "{name},{:.9},{:.9},{:.5},{:.5}",
                    c.point.x, c.point.y, c.pixel.x, c.pixel.y
                );
            }
        }
        out
    }

    fn hint(&self) -> String {
        let views = self.collector.views().len();
        match self.last {
            Some(PictureResult::NotSeen) if views == 0 => {
                "show the complete board in good light".to_owned()
            }
            Some(PictureResult::OtherBoard) => {
                format!("this board is not {}; correct --board", self.board)
            }
            Some(PictureResult::OtherSize) => {
                "the picture size changed; use one mode only".to_owned()
            }
            Some(PictureResult::Similar) if views < MIN_VIEWS => {
                "this view was already taken; move and tilt the board".to_owned()
            }
            _ if views < MIN_VIEWS => {
                "hold the board still, tilted, in several positions".to_owned()
            }
            _ => self.assessment_hint(),
        }
    }

    /// Returns the most useful hint of the intermediate lens.
    fn assessment_hint(&self) -> String {
        let Some((_, assessment)) = &self.intermediate else {
            return "tilt the board to all sides".to_owned();
        };
        let hint = assessment.hints.first().cloned();
        hint.unwrap_or_else(|| match assessment.grade {
            Grade::Good => String::new(),
            _ => assessment
                .findings
                .first()
                .map_or_else(String::new, |f| f.1.to_string()),
        })
    }

    /// Returns the progress: 1 if the lens is good with enough views; before, number of views,
    /// covered cells and tilted sides contribute a third each.
    fn share(&self) -> f64 {
        let intermediate = self.intermediate.as_ref();
        let good = intermediate.is_some_and(|(_, assessment)| assessment.grade == Grade::Good);
        if good && self.collector.views().len() as f64 >= ENOUGH_VIEWS {
            return 1.0;
        }
        let views = (self.collector.views().len() as f64 / ENOUGH_VIEWS).min(1.0);
        let quality = self.intermediate.as_ref().map_or(0.0, |(assessed, _)| {
            let tilt = &assessed.tilt;
            let sides = [tilt.left, tilt.right, tilt.up, tilt.down];
            let enough = |angle: &f64| (angle / 20_f64.to_radians()).clamp(0.0, 1.0) / 4.0;
            (assessed.coverage.share / 0.8).min(1.0) + sides.iter().map(enough).sum::<f64>()
        });
        ((views + quality) / 3.0).min(0.99)
    }

    /// Returns the result without the report.
    fn found(&self, outcome: &Outcome, made: &CalibrationProvenance) -> Finished {
        let mut findings: Findings = outcome
            .assessment
            .findings
            .iter()
            .chain(&inconsistencies(
                outcome,
                &self.present,
                self.camera,
                &self.options,
            ))
            .map(|(grade, finding)| (*grade, finding.to_string()))
            .collect();
        let grade = grade(&mut findings);
        let points: usize = self.collector.views().iter().map(|v| v.points.len()).sum();
        let mut lines = vec![format!(
            "{} pictures, {} views of {}, {points} corners",
            outcome.pictures, outcome.views, self.board
        )];
        lines.extend(outcome.result.iter().flat_map(report::lines));
        let sharpness = self.sharpness.finish();
        lines.extend(sharpness.as_ref().map(Sharpness::line));
        Finished {
            grade,
            lines,
            file: self.file(outcome, &findings, sharpness, made),
            findings,
            hints: outcome.assessment.hints.clone(),
            report: String::new(),
        }
    }

    fn file(
        &self,
        outcome: &Outcome,
        findings: &[(Grade, String)],
        sharpness: Option<Sharpness>,
        made: &CalibrationProvenance,
    ) -> Option<String> {
        if findings.first().is_some_and(|f| f.0 == Grade::Refused) {
            return None;
        }
        let board = self.board.to_string();
        let record = outcome.record(self.camera.name(), &board, made.date.clone())?;
        let quality = record.quality.map(|mut quality| {
            let worst = findings.first().map_or(Grade::Good, |f| f.0);
            worst.name().clone_into(&mut quality.verdict);
            quality.findings = findings.iter().map(|f| f.1.clone()).collect();
            quality
        });
        let record = LensRecord {
            device: made.device.as_ref().map(|name| DeviceRecord {
                name: name.clone(),
                serial: made.serial.clone(),
            }),
            source: made.source.clone(),
            sharpness: sharpness.map(|s| s.record()),
            quality,
            ..record
        };
        serde_json::to_string_pretty(&record).ok()
    }
}

impl Step for IntrinsicsStep {
    fn name(&self) -> &'static str {
        "intrinsics"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: self.camera == CameraRole::Scene,
            environment: self.camera == CameraRole::Environment,
            brackets: false,
            poses: false,
            spacing: MIN_SPACING * (1.0 + (self.pictures as f64 / SLOWDOWN_PICTURES).floor()),
        }
    }

    fn observe(&mut self, shown: &StepInput) {
        if let StepInput::Picture(shown) = shown
            && shown.camera == self.camera
            && shown.bracket_ev == 0.0
        {
            self.add_picture(&format!("{:.2} s", shown.seconds), shown.picture);
        }
    }

    fn progress(&self) -> Progress {
        let views = self.collector.views();
        let points: usize = views.iter().map(|v| v.points.len()).sum();
        Progress {
            share: self.share(),
            message: format!("{} views, {points} corners", views.len()),
            hint: self.hint(),
            overlay_points: self.collector.last_points().to_vec(),
            camera: Some(self.camera),
        }
    }

    fn finish(&mut self, made: &CalibrationProvenance) -> Finished {
        let outcome = self.collector.finish(&self.options);
        let mut found = self.found(&outcome, made);
        let facts = [
            format!("{}, from {}", made.date, made.source),
            format!("board {}", self.board),
        ];
        let title = format!("Lens of the {} camera", self.camera.name());
        found.report = report::page(&found, &outcome, self.collector.views(), &title, &facts);
        found
    }
}

#[cfg(test)]
mod tests;
