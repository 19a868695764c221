//! Gathers views of a board from pictures and estimates the lens: selects the views to keep, and
//! the model with the coefficients that they determine.

use super::board::{Board, Correspondence, View};
use super::coverage::{Coverage, Tilt, Uncertainty};
use super::detect::{Grey, NoChessboard, find_chessboard};
use super::estimate::{Estimate, Options, estimate_some};
use super::evidence::{ChessEvidence, TagEvidence};
use super::finding::Finding;
use super::rim::{Light, Rim};
use super::tag_finder::TagFinder;
use super::verdict::Verdict;
use glam::DVec2;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;
use penumbra_rig_model::VERSION;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_rig_model::lens_record::QualityRecord;
use std::collections::BTreeMap;

/// Maximum mean distance of the points of two similar views, as a share of the picture's width: a
/// second view from the same pose adds no information, and would count twice.
const ALIKE: f64 = 0.02;
/// Maximum number of views; more slow the search down without improving the lens.
const MOST_VIEWS: usize = 120;
/// Ratio of the angle of light to the largest angle of corners from which a finding is reported.
const RIM: f64 = 1.05;

/// Maximum ratio of the errors at which a lens with fewer coefficients is preferred.
const SIMPLER: f64 = 1.02;

/// Result of offering a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// A new view.
    Taken {
        /// Points found.
        points: usize,
    },
    /// Similar to a view that was kept.
    Alike,
    /// No board, or too small a part of it.
    NotSeen,
    /// A board with more corners than the given one.
    OtherBoard,
    /// Another size than that of the previous pictures.
    OtherSize,
}

/// Collects views of one camera.
#[derive(Clone, Debug)]
pub struct Gatherer {
    board: Board,
    size: Option<(u32, u32)>,
    views: Vec<View>,
    pictures: usize,
    other_size: usize,
    chess: ChessEvidence,
    finder: Option<TagFinder>,
    light: Light,
    marks: Vec<DVec2>,
    tags: TagEvidence,
}

/// Result of a lens calibration.
#[derive(Clone, Debug)]
pub struct Outcome {
    /// Number of pictures examined.
    pub pictures: usize,
    /// Number of views kept.
    pub views: usize,
    /// The lens and its quality; `None` if none was found.
    pub result: Option<Judged>,
    /// Grade of the lens, with findings.
    pub verdict: Verdict,
}

impl Outcome {
    /// The calibration file of the lens; `None` if no lens was found.
    #[must_use]
    pub fn record(&self, camera: &str, board: &str, date: String) -> Option<LensRecord> {
        let judged = self.result.as_ref()?;
        let estimate = &judged.estimate;
        let lens = &estimate.lens;
        let names = lens.model.coefficients();
        let named = |values: &[f64]| -> BTreeMap<String, f64> {
            let pairs = names.iter().zip(values);
            pairs.map(|(name, v)| ((*name).to_owned(), *v)).collect()
        };
        let mut sigma = named(&estimate.sigma[4..]);
        for (name, value) in ["fx", "fy", "cx", "cy"].iter().zip(estimate.sigma) {
            sigma.insert((*name).to_owned(), value);
        }
        let points = || estimate.views.iter().flat_map(|v| &v.points);
        Some(LensRecord {
            penumbra_calibration: VERSION,
            camera: camera.to_owned(),
            date,
            device: None,
            source: String::new(),
            board: board.to_owned(),
            model: lens.model.name().to_owned(),
            image_size: [lens.width, lens.height],
            focal: lens.focal.to_array(),
            centre: lens.centre.to_array(),
            distortion: named(&lens.coefficients),
            max_theta: judged.rim.map(|rim| rim.known),
            sigma,
            quality: Some(QualityRecord {
                verdict: self.verdict.grade.name().to_owned(),
                findings: self
                    .verdict
                    .findings
                    .iter()
                    .map(|f| f.1.to_string())
                    .collect(),
                rms: estimate.rms,
                views: [
                    estimate.views.iter().filter(|v| v.used).count(),
                    estimate.views.len(),
                ],
                corners: [points().filter(|p| p.used).count(), points().count()],
                coverage: judged.coverage.share,
                projection_sigma: [judged.uncertainty.median, judged.uncertainty.worst],
            }),
        })
    }
}

/// A lens and its quality.
#[derive(Clone, Debug)]
pub struct Judged {
    /// The lens.
    pub estimate: Estimate,
    /// Where corners were seen.
    pub coverage: Coverage,
    /// To which sides the board was tilted.
    pub tilt: Tilt,
    /// How sure the lens is in each part of the picture.
    pub uncertainty: Uncertainty,
    /// Angles to which a fisheye is known.
    pub rim: Option<Rim>,
}

impl Gatherer {
    /// Of views of that board.
    #[must_use]
    pub fn new(board: Board) -> Self {
        Self {
            board,
            size: None,
            views: Vec::new(),
            pictures: 0,
            other_size: 0,
            chess: ChessEvidence::default(),
            finder: TagFinder::new(&board),
            light: Light::default(),
            marks: Vec::new(),
            tags: TagEvidence::default(),
        }
    }

    /// Detects the board in a picture.
    pub fn offer(&mut self, name: &str, picture: &Grey) -> Offer {
        let size = (picture.width as u32, picture.height as u32);
        if self.size.is_none_or(|known| known == size) {
            self.light.look(picture);
        }
        if let Some(finder) = &mut self.finder {
            let seen = finder.find(picture);
            self.tags.note(&seen);
            let offer = self.offer_points(name, size, seen.points);
            let other = seen.contradicts || seen.other_family.is_some();
            return if other { Offer::OtherBoard } else { offer };
        }
        let Board::Chess {
            columns,
            rows,
            square,
        } = self.board
        else {
            return Offer::NotSeen;
        };
        let found = find_chessboard(picture, columns, rows);
        self.chess.note(&found);
        let points = found
            .as_ref()
            .map_or_else(|_| Vec::new(), |sighting| sighting.correspondences(square));
        let offer = self.offer_points(name, size, points);
        match (offer, found) {
            (Offer::NotSeen, Err(NoChessboard::Larger { .. })) => Offer::OtherBoard,
            (offer, _) => offer,
        }
    }

    /// Adds points that were detected in a picture of `size`.
    pub fn offer_points(
        &mut self,
        name: &str,
        size: (u32, u32),
        points: Vec<Correspondence>,
    ) -> Offer {
        self.pictures += 1;
        self.marks.clear();
        self.marks.extend(points.iter().map(|c| c.pixel));
        if *self.size.get_or_insert(size) != size {
            self.other_size += 1;
            return Offer::OtherSize;
        }
        if points.len() < super::outliers::LEAST_POINTS {
            return Offer::NotSeen;
        }
        let near = ALIKE * f64::from(size.0);
        if self
            .views
            .iter()
            .any(|v| distance(&v.points, &points) < near)
        {
            return Offer::Alike;
        }
        if self.views.len() >= MOST_VIEWS {
            return Offer::Alike;
        }
        let taken = Offer::Taken {
            points: points.len(),
        };
        self.views.push(View {
            name: name.to_owned(),
            points,
        });
        taken
    }

    /// Views so far.
    #[must_use]
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Returns the points found in the last picture, pixels.
    #[must_use]
    pub fn marks(&self) -> &[DVec2] {
        &self.marks
    }

    /// The lens as the views so far have it, to know what is missing.
    #[must_use]
    pub fn so_far(&self, options: &Options) -> Option<(Judged, Verdict)> {
        let all = options.model.coefficients().len();
        self.judged_with(options, all).ok()
    }

    /// The pictures' size, once there was one.
    #[must_use]
    pub const fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    /// Estimates the lens and assesses it.
    #[must_use]
    pub fn finish(&self, options: &Options) -> Outcome {
        let (result, verdict) = match self.judged(options) {
            Ok((judged, verdict)) => (Some(judged), verdict),
            Err(finding) => (None, Verdict::refused(finding)),
        };
        Outcome {
            pictures: self.pictures,
            views: self.views.len(),
            result,
            verdict,
        }
    }

    fn judged(&self, options: &Options) -> Result<(Judged, Verdict), Finding> {
        self.check_board()?;
        let all = options.model.coefficients().len();
        let mut best = self.judged_with(options, all)?;
        // Undetermined coefficients of high powers distort the picture's rim arbitrarily. Without them
        // the lens has less uncertainty, if it fits the views as well.
        for fewer in (fewest_coefficients(options.model)..all).rev() {
            if best.1.grade < Grade::Refused {
                break;
            }
            let Ok(simpler) = self.judged_with(options, fewer) else {
                break;
            };
            let as_well = simpler.0.estimate.rms <= SIMPLER * best.0.estimate.rms;
            if as_well && simpler.1.grade < best.1.grade {
                best = simpler;
            }
        }
        Ok(best)
    }

    fn judged_with(
        &self,
        options: &Options,
        coefficients: usize,
    ) -> Result<(Judged, Verdict), Finding> {
        let size = self.size.unwrap_or_default();
        let estimate = estimate_some(size, &self.views, options, coefficients)?;
        let coverage = Coverage::of(&estimate.lens, &estimate.views, &self.light);
        let tilt = Tilt::of(&estimate.views);
        let uncertainty = Uncertainty::of(&estimate);
        let rim = Rim::of(&estimate, &self.light);
        let mut verdict = Verdict::of(&estimate, &coverage, &tilt, &uncertainty);
        if let Some((rim, lit)) = rim.and_then(|rim| Some((rim, rim.lit?)))
            && lit > rim.known.max(RIM * rim.seen)
        {
            let [seen, lit, known] = [rim.seen, lit, rim.known].map(f64::to_degrees);
            verdict.add(Grade::Usable, Finding::RimUnseen { seen, lit, known });
        }
        if let Some(doubt) = self.tags.doubt() {
            verdict.add(Grade::Usable, doubt);
        }
        let judged = Judged {
            rim,
            estimate,
            coverage,
            tilt,
            uncertainty,
        };
        Ok((judged, verdict))
    }

    /// That the board is the one that was said, and the pictures those of one camera.
    fn check_board(&self) -> Result<(), Finding> {
        let pictures = self.pictures;
        if 2 * self.other_size > pictures {
            return Err(Finding::SizesDiffer);
        }
        self.tags.check(&self.board)?;
        self.chess.check()?;
        if self.views.is_empty() {
            return Err(Finding::BoardNotSeen { pictures });
        }
        Ok(())
    }
}

/// Below which the model is another one: k1, k2, p1, p2; k1, k2 of a fisheye.
const fn fewest_coefficients(model: LensModel) -> usize {
    match model {
        LensModel::Brown => 4,
        LensModel::KannalaBrandt => 2,
        LensModel::BrownRational => 8,
    }
}

/// Mean distance between the same points of two views, pixels; infinite if fewer than half
/// of them are in both.
fn distance(a: &[Correspondence], b: &[Correspondence]) -> f64 {
    let key = |p: DVec2| ((p.x * 1e5).round() as i64, (p.y * 1e5).round() as i64);
    let known: BTreeMap<_, DVec2> = a.iter().map(|c| (key(c.point), c.pixel)).collect();
    let distances: Vec<f64> = b
        .iter()
        .filter_map(|c| Some(known.get(&key(c.point))?.distance(c.pixel)))
        .collect();
    if 2 * distances.len() < a.len().max(b.len()) {
        return f64::INFINITY;
    }
    distances.iter().sum::<f64>() / distances.len() as f64
}

#[cfg(test)]
mod tests;
