//! The step `intrinsics`: calibrates one camera's lens from a board shown to it.

use super::board::Board;
use super::detect::Grey;
use super::estimate::Options;
use super::gather::{Gatherer, Judged, Offer, Outcome};
use super::report;
use super::verdict::Verdict;
use crate::intrinsics::KnownLenses;
use crate::intrinsics::consistency_checks::contradictions;
use crate::step::{
    CalibrationProvenance, CameraRole, Finished, Progress, Step, StepInput, StepInputs,
};
use penumbra_picture::Picture;
use penumbra_rig_model::DeviceRecord;
use penumbra_rig_model::Grade;
use penumbra_rig_model::lens_record::LensRecord;
use std::fmt::Write;

/// Minimum interval between two pictures, seconds.
const SPACING: f64 = 0.2;
/// Number of pictures after which the rate of examined pictures is halved.
const MANY: f64 = 300.0;
/// Sufficient number of views.
const ENOUGH_VIEWS: f64 = 15.0;
/// Minimum number of views for an intermediate estimate, which shows what is missing.
const LEAST_VIEWS: usize = 4;

/// Collects views of a board in one camera's pictures and judges the lens.
#[derive(Clone, Debug)]
pub struct IntrinsicsStep {
    eye: CameraRole,
    board: Board,
    options: Options,
    said: KnownLenses,
    gatherer: Gatherer,
    pictures: usize,
    last: Option<Offer>,
    so_far: Option<(Judged, Verdict)>,
    /// The lens is tried again when there are so many views.
    next: usize,
}

impl IntrinsicsStep {
    /// Of one camera; `said` is what the rig has of both lenses so far.
    #[must_use]
    pub fn new(eye: CameraRole, board: Board, options: Options, said: KnownLenses) -> Self {
        Self {
            eye,
            board,
            options,
            said,
            gatherer: Gatherer::new(board),
            pictures: 0,
            last: None,
            so_far: None,
            next: LEAST_VIEWS,
        }
    }

    /// Looks for the board in a picture; `name` is told where that view contradicts others.
    pub fn look_at(&mut self, name: &str, picture: &Picture) {
        self.pictures += 1;
        let offer = self.gatherer.offer(name, &Grey::from_picture(picture));
        self.last = Some(offer);
        let views = self.gatherer.views().len();
        if views >= self.next {
            self.so_far = self.gatherer.so_far(&self.options);
            // A quarter more views: what is missing changes slowly, and lenses cost time.
            self.next = (views + 1).max(views * 5 / 4);
        }
    }

    /// Every corner that was kept: a line each, comma-separated, with a head: the view, the
    /// corner's place on the board in metres, its pixel.
    #[must_use]
    pub fn corners(&self) -> String {
        let mut out = String::from("view,board_x_m,board_y_m,pixel_x,pixel_y\n");
        for view in self.gatherer.views() {
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
        let views = self.gatherer.views().len();
        match self.last {
            Some(Offer::NotSeen) if views == 0 => {
                "show the board: all of it, in good light".to_owned()
            }
            Some(Offer::OtherBoard) => {
                format!("this is another board than {}; see --board", self.board)
            }
            Some(Offer::OtherSize) => "the pictures' size changed; keep one mode".to_owned(),
            Some(Offer::Alike) if views < LEAST_VIEWS => {
                "move on: this view is known; tilt the board".to_owned()
            }
            _ if views < LEAST_VIEWS => {
                "hold the board still, tilted, in several places".to_owned()
            }
            _ => self.missing(),
        }
    }

    /// Returns a hint for what the intermediate lens lacks most.
    fn missing(&self) -> String {
        let Some((_, verdict)) = &self.so_far else {
            return "tilt the board to all sides".to_owned();
        };
        let hint = verdict.hints.first().cloned();
        hint.unwrap_or_else(|| match verdict.grade {
            Grade::Good => String::new(),
            _ => verdict
                .findings
                .first()
                .map_or_else(String::new, |f| f.1.to_string()),
        })
    }

    /// Whole when the lens is good by enough views; until then views, cells with corners and sides
    /// tilted to count a third each.
    fn share(&self) -> f64 {
        let so_far = self.so_far.as_ref();
        let good = so_far.is_some_and(|(_, verdict)| verdict.grade == Grade::Good);
        if good && self.gatherer.views().len() as f64 >= ENOUGH_VIEWS {
            return 1.0;
        }
        let views = (self.gatherer.views().len() as f64 / ENOUGH_VIEWS).min(1.0);
        let seen = self.so_far.as_ref().map_or(0.0, |(judged, _)| {
            let tilt = &judged.tilt;
            let sides = [tilt.left, tilt.right, tilt.up, tilt.down];
            let enough = |angle: &f64| (angle / 20_f64.to_radians()).clamp(0.0, 1.0) / 4.0;
            (judged.coverage.share / 0.8).min(1.0) + sides.iter().map(enough).sum::<f64>()
        });
        ((views + seen) / 3.0).min(0.99)
    }

    /// Returns the result without the report.
    fn found(&self, outcome: &Outcome, made: &CalibrationProvenance) -> Finished {
        let mut findings: Vec<(Grade, String)> = outcome
            .verdict
            .findings
            .iter()
            .chain(&contradictions(
                outcome,
                &self.said,
                self.eye,
                &self.options,
            ))
            .map(|(grade, finding)| (*grade, finding.to_string()))
            .collect();
        findings.sort_by_key(|f| std::cmp::Reverse(f.0));
        let grade = findings.first().map_or(Grade::Good, |f| f.0);
        let points: usize = self.gatherer.views().iter().map(|v| v.points.len()).sum();
        let mut lines = vec![format!(
            "{} pictures, {} views of {}, {points} corners",
            outcome.pictures, outcome.views, self.board
        )];
        lines.extend(outcome.result.iter().flat_map(report::lines));
        Finished {
            grade,
            lines,
            file: self.file(outcome, &findings, made),
            findings,
            hints: outcome.verdict.hints.clone(),
            report: String::new(),
        }
    }

    fn file(
        &self,
        outcome: &Outcome,
        findings: &[(Grade, String)],
        made: &CalibrationProvenance,
    ) -> Option<String> {
        if findings.first().is_some_and(|f| f.0 == Grade::Refused) {
            return None;
        }
        let board = self.board.to_string();
        let record = outcome.record(self.eye.name(), &board, made.date.clone())?;
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
            scene: self.eye == CameraRole::Scene,
            environment: self.eye == CameraRole::Environment,
            brackets: false,
            poses: false,
            spacing: SPACING * (1.0 + (self.pictures as f64 / MANY).floor()),
        }
    }

    fn observe(&mut self, shown: &StepInput) {
        if let StepInput::Picture(shown) = shown
            && shown.camera == self.eye
            && shown.bracket_ev == 0.0
        {
            self.look_at(&format!("{:.2} s", shown.seconds), shown.picture);
        }
    }

    fn progress(&self) -> Progress {
        let views = self.gatherer.views();
        let points: usize = views.iter().map(|v| v.points.len()).sum();
        Progress {
            share: self.share(),
            message: format!("{} views, {points} corners", views.len()),
            hint: self.hint(),
            overlay_points: self.gatherer.marks().to_vec(),
            camera: Some(self.eye),
        }
    }

    fn finish(&mut self, made: &CalibrationProvenance) -> Finished {
        let outcome = self.gatherer.finish(&self.options);
        let mut found = self.found(&outcome, made);
        let facts = [
            format!("{}, from {}", made.date, made.source),
            format!("board {}", self.board),
        ];
        let title = format!("Lens of the {} camera", self.eye.name());
        found.report = report::page(&found, &outcome, self.gatherer.views(), &title, &facts);
        found
    }
}

#[cfg(test)]
mod tests;
