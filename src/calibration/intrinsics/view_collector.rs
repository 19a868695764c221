//! Collects views of a board from pictures and estimates the lens: selects the views to keep, and
//! the number of coefficients that they determine.

use super::assessment::Assessment;
use super::board::{Board, Correspondence, View};
use super::coverage::{Coverage, Tilt, Uncertainty};
use super::detect::{Grey, NoChessboard, find_chessboard};
use super::estimate::{Estimate, Options, estimate_some};
use super::evidence::{ChessEvidence, TagEvidence};
use super::findings::Finding;
use super::mixture::two_cameras;
use super::rim::{Light, Rim};
use super::tag_finder::TagFinder;
use glam::DVec2;
use penumbra_camera::LensModel;
use penumbra_rig_model::Grade;
use penumbra_rig_model::VERSION;
use penumbra_rig_model::lens_record::LensRecord;
use penumbra_rig_model::lens_record::QualityRecord;
use std::collections::BTreeMap;

/// Maximum mean distance of the points of two similar views, as a share of the picture's width: a
/// second view from the same pose adds no information, and would count twice.
const SIMILAR: f64 = 0.02;
/// Maximum number of views; more slow the search down without improving the lens.
const MAX_VIEWS: usize = 120;
/// Ratio of the angle of light to the largest angle of corners above which a finding is reported.
const MAX_RIM_RATIO: f64 = 1.05;

/// Maximum ratio of RMS errors at which a lens with fewer coefficients is preferred.
const MAX_SIMPLER_RATIO: f64 = 1.02;

/// Result of adding a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureResult {
    /// A new view.
    Added {
        /// Points found.
        points: usize,
    },
    /// Similar to a view that was kept.
    Similar,
    /// No board, or too small a part of it.
    NotSeen,
    /// A board with more corners than the given one.
    OtherBoard,
    /// A picture of another size than the previous ones.
    OtherSize,
}

/// Collects views of one camera.
#[derive(Clone, Debug)]
pub struct ViewCollector {
    board: Board,
    size: Option<(u32, u32)>,
    views: Vec<View>,
    pictures: usize,
    other_size: usize,
    chess: ChessEvidence,
    finder: Option<TagFinder>,
    light: Light,
    last_points: Vec<DVec2>,
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
    pub result: Option<AssessedLens>,
    /// Grade of the lens, with findings.
    pub assessment: Assessment,
}

impl Outcome {
    /// The calibration file of the lens; `None` if no lens was found.
    #[must_use]
    pub fn record(&self, camera: &str, board: &str, date: String) -> Option<LensRecord> {
        let assessed = self.result.as_ref()?;
        let estimate = &assessed.estimate;
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
            max_theta: assessed.rim.map(|rim| rim.known),
            sigma,
            sharpness: None,
            quality: Some(QualityRecord {
                verdict: self.assessment.grade.name().to_owned(),
                findings: self
                    .assessment
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
                coverage: assessed.coverage.share,
                projection_sigma: [assessed.uncertainty.median, assessed.uncertainty.worst],
            }),
        })
    }
}

/// A lens and its quality.
#[derive(Clone, Debug)]
pub struct AssessedLens {
    /// The lens.
    pub estimate: Estimate,
    /// Coverage of the picture by corners.
    pub coverage: Coverage,
    /// Tilt of the board.
    pub tilt: Tilt,
    /// Uncertainty of the lens in each part of the picture.
    pub uncertainty: Uncertainty,
    /// Angles to which the lens is determined; `None` if it is not a fisheye.
    pub rim: Option<Rim>,
}

impl ViewCollector {
    /// Creates a collector without views of `board`.
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
            last_points: Vec::new(),
            tags: TagEvidence::default(),
        }
    }

    /// Detects the board in a picture.
    pub fn add_picture(&mut self, name: &str, picture: &Grey) -> PictureResult {
        let size = (picture.width as u32, picture.height as u32);
        if self.size.is_none_or(|known| known == size) {
            self.light.add(picture);
        }
        if let Some(finder) = &mut self.finder {
            let found = finder.find(picture);
            self.tags.add(&found);
            let result = self.add_points(name, size, found.points);
            let is_other = found.is_inconsistent || found.other_family.is_some();
            return if is_other {
                PictureResult::OtherBoard
            } else {
                result
            };
        }
        let Board::Chess {
            columns,
            rows,
            square,
        } = self.board
        else {
            return PictureResult::NotSeen;
        };
        let detection = find_chessboard(picture, columns, rows);
        self.chess.add(&detection);
        let points = detection
            .as_ref()
            .map_or_else(|_| Vec::new(), |board| board.correspondences(square));
        let result = self.add_points(name, size, points);
        match (result, detection) {
            (PictureResult::NotSeen, Err(NoChessboard::Larger { .. })) => PictureResult::OtherBoard,
            (result, _) => result,
        }
    }

    /// Adds points that were detected in a picture of `size`.
    pub fn add_points(
        &mut self,
        name: &str,
        size: (u32, u32),
        points: Vec<Correspondence>,
    ) -> PictureResult {
        self.pictures += 1;
        self.last_points.clear();
        self.last_points.extend(points.iter().map(|c| c.pixel));
        if *self.size.get_or_insert(size) != size {
            self.other_size += 1;
            return PictureResult::OtherSize;
        }
        if points.len() < super::outliers::MIN_POINTS {
            return PictureResult::NotSeen;
        }
        let near = SIMILAR * f64::from(size.0);
        if self
            .views
            .iter()
            .any(|v| distance(&v.points, &points) < near)
        {
            return PictureResult::Similar;
        }
        if self.views.len() >= MAX_VIEWS {
            return PictureResult::Similar;
        }
        let added = PictureResult::Added {
            points: points.len(),
        };
        self.views.push(View {
            name: name.to_owned(),
            points,
        });
        added
    }

    /// Returns the views kept so far.
    #[must_use]
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// Returns the points found in the last picture, pixels.
    #[must_use]
    pub fn last_points(&self) -> &[DVec2] {
        &self.last_points
    }

    /// Estimates the lens from the views so far; its assessment shows which views are missing.
    #[must_use]
    pub fn intermediate(&self, options: &Options) -> Option<(AssessedLens, Assessment)> {
        let all = options.model.coefficients().len();
        self.assessed_with(options, all).ok()
    }

    /// Returns the pictures' size; `None` before the first picture.
    #[must_use]
    pub const fn size(&self) -> Option<(u32, u32)> {
        self.size
    }

    /// Estimates the lens and assesses it.
    #[must_use]
    pub fn finish(&self, options: &Options) -> Outcome {
        let (result, assessment) = match self.assessed(options) {
            Ok((assessed, assessment)) => (Some(assessed), assessment),
            Err(finding) => (None, Assessment::refused(finding)),
        };
        Outcome {
            pictures: self.pictures,
            views: self.views.len(),
            result,
            assessment,
        }
    }

    fn assessed(&self, options: &Options) -> Result<(AssessedLens, Assessment), Finding> {
        self.check_board()?;
        let all = options.model.coefficients().len();
        let mut best = self.assessed_with(options, all)?;
        // Undetermined high-order coefficients distort the picture's rim arbitrarily. A lens
        // without them is preferred if it fits the views equally well.
        for fewer in (min_coefficients(options.model)..all).rev() {
            if best.1.grade < Grade::Refused {
                break;
            }
            let Ok(simpler) = self.assessed_with(options, fewer) else {
                break;
            };
            let fits_equally = simpler.0.estimate.rms <= MAX_SIMPLER_RATIO * best.0.estimate.rms;
            if fits_equally && simpler.1.grade < best.1.grade {
                best = simpler;
            }
        }
        let simplest = min_coefficients(options.model);
        if let Some(finding) = two_cameras(&best.0.estimate, &self.views, options, simplest) {
            best.1.add(Grade::Refused, finding);
        }
        Ok(best)
    }

    fn assessed_with(
        &self,
        options: &Options,
        coefficients: usize,
    ) -> Result<(AssessedLens, Assessment), Finding> {
        let size = self.size.unwrap_or_default();
        let estimate = estimate_some(size, &self.views, options, coefficients)?;
        let coverage = Coverage::new(&estimate.lens, &estimate.views, &self.light);
        let tilt = Tilt::from_views(&estimate.views);
        let uncertainty = Uncertainty::from_estimate(&estimate);
        let rim = Rim::from_estimate(&estimate, &self.light);
        let mut assessment = Assessment::from_estimate(&estimate, &coverage, &tilt, &uncertainty);
        if let Some((rim, lit)) = rim.and_then(|rim| Some((rim, rim.lit?)))
            && lit > rim.known.max(MAX_RIM_RATIO * rim.seen)
        {
            let [seen, lit, known] = [rim.seen, lit, rim.known].map(f64::to_degrees);
            assessment.add(Grade::Usable, Finding::RimNotCovered { seen, lit, known });
        }
        if let Some(finding) = self.tags.foreign_tags_finding() {
            assessment.add(Grade::Usable, finding);
        }
        if let Some(finding) = self.mixed_sizes() {
            assessment.add(Grade::Usable, finding);
        }
        let assessed = AssessedLens {
            rim,
            estimate,
            coverage,
            tilt,
            uncertainty,
        };
        Ok((assessed, assessment))
    }

    /// Returns a finding if pictures were left out because of their size.
    fn mixed_sizes(&self) -> Option<Finding> {
        let (width, height) = self.size?;
        (self.other_size > 0).then_some(Finding::SizesMixed {
            other: self.other_size,
            pictures: self.pictures,
            width,
            height,
        })
    }

    /// Checks that the board is the given one and that the pictures are from one camera.
    fn check_board(&self) -> Result<(), Finding> {
        let pictures = self.pictures;
        if 2 * self.other_size >= pictures && self.other_size > 0 {
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

/// Returns the minimum number of coefficients of a model: k1, k2, p1, p2; k1, k2 for a fisheye.
const fn min_coefficients(model: LensModel) -> usize {
    match model {
        LensModel::Brown => 4,
        LensModel::KannalaBrandt => 2,
        LensModel::BrownRational => 8,
    }
}

/// Returns the mean distance between the same points of two views, pixels; infinite if the views
/// share fewer than half of their points.
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
