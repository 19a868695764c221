//! Sharpness of a camera from the edges of a board: the slanted-edge method (ISO 12233), with many
//! short edges in place of one long one.
//!
//! ```text
//!  Across an edge, the picture of a camera whose pixels are unit squares (box filter) rises like
//!      H(t) = clamp(t + 1/2, 0, 1),
//!  t pixels from the edge. Lens, demosaicing and sharpening spread each pixel over its neighbours:
//!      E(t) = H(t) + w1 (H(t-1) + H(t+1) - 2 H(t)) + w2 (H(t-2) + H(t+2) - 2 H(t)),
//!  linear in w1 and w2. Edges lie at all positions between pixels, so that E is sampled densely.
//!  Each edge is first aligned by its own moment: if the spread is symmetric, the step is at
//!      t0 = r - integral from -r to r of E.
//! ```

use super::board::{Board, Correspondence};
use super::detect::Grey;
use glam::DVec2;
use penumbra_camera::{PointSpread, Response};
use penumbra_rig_model::lens_record::SharpnessRecord;

/// Pixels across an edge that are examined on each side.
const REACH: f64 = 5.0;
/// Bins per pixel.
const PER_PIXEL: usize = 8;
/// Number of bins.
const BINS: usize = 2 * 5 * PER_PIXEL;
/// Minimum distance from an edge, pixels, at which a surface counts as even.
const EVEN_FROM: f64 = 3.0;
/// Minimum contrast of an edge, linear.
const MIN_CONTRAST: f64 = 0.15;
/// Linear values beyond which the picture may be clipped.
const UNCLIPPED: std::ops::RangeInclusive<f64> = 0.003..=0.97;
/// Maximum tangent of an edge's angle to the rows or columns.
const MAX_SLANT: f64 = 0.45;
/// Maximum standard deviation of the even parts of an edge, relative to its contrast.
const MAX_UNEVEN: f64 = 0.1;
/// Minimum number of edges of a view.
const MIN_EDGES: usize = 4;
/// Share of the views, the sharpest ones, that are used: the others may be moved or out of focus.
const SHARPEST: f64 = 0.3;

/// Mean profile across the edges of one direction in one view.
#[derive(Clone, Debug)]
struct Profile {
    sum: [f64; BINS],
    count: [f64; BINS],
    edges: usize,
}

impl Default for Profile {
    fn default() -> Self {
        Self {
            sum: [0.0; BINS],
            count: [0.0; BINS],
            edges: 0,
        }
    }
}

/// Collects the edges of a board: profiles across columns and across rows, by view.
#[derive(Clone, Debug, Default)]
pub struct SharpnessGatherer {
    views: Vec<[Profile; 2]>,
}

/// The sharpness of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Sharpness {
    /// The spread of a pixel.
    pub spread: PointSpread,
    /// Standard errors of the weights of the first and second neighbour, across and down.
    pub sigma: [[f64; 2]; 2],
    /// Number of edges used.
    pub edges: usize,
    /// Number of views used, and of all.
    pub views: [usize; 2],
}

impl Sharpness {
    /// Returns the entry of the calibration file.
    #[must_use]
    pub fn record(&self) -> SharpnessRecord {
        SharpnessRecord {
            across: self.spread.across,
            down: self.spread.down,
            mtf50: self.mtf50(),
            edges: self.edges,
        }
    }

    /// Returns the sharpness as a line of text.
    pub(crate) fn line(&self) -> String {
        let [across, down] = self.mtf50();
        let [views, all] = self.views;
        format!(
            "sharpness: half of the contrast at {across:.2} cycles a pixel across, {down:.2} down, \
             from {} edges in the sharpest {views} of {all} views",
            self.edges
        )
    }

    fn mtf50(&self) -> [f64; 2] {
        [self.spread.across, self.spread.down].map(|w| PointSpread::mtf50(&w))
    }
}

impl SharpnessGatherer {
    /// Adds a view of `board` whose points were found in `picture`, in codes of `response`.
    pub fn add(
        &mut self,
        picture: &Grey,
        points: &[Correspondence],
        board: &Board,
        response: &Response,
    ) {
        let mut view: [Profile; 2] = Default::default();
        for (a, b) in neighbours(points, board.pitch()) {
            let direction = b.pixel - a.pixel;
            let pixels_per_metre = direction.length() / board.pitch();
            if margin(board) * pixels_per_metre < REACH + 1.0 {
                continue;
            }
            let is_steep = direction.y.abs() > direction.x.abs();
            let (long, short) = (direction.abs().max_element(), direction.abs().min_element());
            if short <= MAX_SLANT * long
                && let Some(edge) = Edge::read(picture, a.pixel, b.pixel, response)
            {
                // A steep edge shows the spread across.
                view[usize::from(!is_steep)].add(&edge);
            }
        }
        if view.iter().any(|profile| profile.edges >= MIN_EDGES) {
            self.views.push(view);
        }
    }

    /// Fits the spread to the sharpest views; `None` if no edge was large and even enough.
    #[must_use]
    pub fn finish(&self) -> Option<Sharpness> {
        let fits = [0, 1].map(|axis| self.fit(axis));
        let [across, down] = match fits {
            [Some(a), Some(b)] => [a, b],
            [Some(a), None] => [a.clone(), a],
            [None, Some(b)] => [b.clone(), b],
            [None, None] => return None,
        };
        let used = across.views.max(down.views);
        Some(Sharpness {
            spread: PointSpread {
                across: across.weights,
                down: down.weights,
            },
            sigma: [across.sigma, down.sigma],
            edges: across.edges + down.edges,
            views: [used, self.views.len()],
        })
    }

    /// Fits one direction.
    fn fit(&self, axis: usize) -> Option<AxisFit> {
        let profiles = self.views.iter().map(|view| &view[axis]);
        let mut ranked: Vec<(f64, &Profile)> = profiles
            .filter(|profile| profile.edges >= MIN_EDGES)
            .filter_map(|profile| Some((profile.fit()?.width(), profile)))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = (SHARPEST * ranked.len() as f64).ceil() as usize;
        let mut all = Profile::default();
        for (_, profile) in ranked.iter().take(count) {
            all.join(profile);
        }
        Some(AxisFit {
            views: count,
            ..all.fit()?
        })
    }
}

/// Weights of one direction.
#[derive(Clone, Debug)]
struct AxisFit {
    weights: [f64; 3],
    sigma: [f64; 2],
    edges: usize,
    views: usize,
}

impl AxisFit {
    /// Upper limit of the variance of the spread, pixels²: views with few edges are uncertain.
    fn width(&self) -> f64 {
        let variance = 2.0 * self.weights[1] + 8.0 * self.weights[2];
        variance + 2.0 * (2.0 * self.sigma[0]).hypot(8.0 * self.sigma[1])
    }
}

impl Profile {
    fn add(&mut self, edge: &Edge) {
        for (t, value) in &edge.samples {
            let bin = ((t + REACH) * PER_PIXEL as f64).floor();
            if (0.0..BINS as f64).contains(&bin) {
                self.sum[bin as usize] += value;
                self.count[bin as usize] += 1.0;
            }
        }
        self.edges += 1;
    }

    fn join(&mut self, other: &Self) {
        for bin in 0..BINS {
            self.sum[bin] += other.sum[bin];
            self.count[bin] += other.count[bin];
        }
        self.edges += other.edges;
    }

    /// Fits w1 and w2 by least squares, weighted by the number of samples.
    fn fit(&self) -> Option<AxisFit> {
        let (mut aa, mut ab, mut bb, mut ay, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (a, b, y, n) in self.equations() {
            aa += n * a * a;
            ab += n * a * b;
            bb += n * b * b;
            ay += n * a * y;
            by += n * b * y;
        }
        let determinant = aa * bb - ab * ab;
        if determinant < 1e-6 * aa * bb || aa == 0.0 {
            return None;
        }
        let (w1, w2) = (
            (bb * ay - ab * by) / determinant,
            (aa * by - ab * ay) / determinant,
        );
        let squares = self
            .equations()
            .map(|(a, b, y, n)| n * (y - w1 * a - w2 * b).powi(2));
        let variance = squares.sum::<f64>() / (BINS as f64 - 2.0);
        let sigma = [bb, aa].map(|v| (variance * v / determinant).sqrt());
        Some(AxisFit {
            weights: [1.0 - 2.0 * (w1 + w2), w1, w2],
            sigma,
            edges: self.edges,
            views: 1,
        })
    }

    /// Coefficients of w1 and w2, what remains beside H, and the number of samples, by bin.
    fn equations(&self) -> impl Iterator<Item = (f64, f64, f64, f64)> {
        let centre = |bin: usize| (bin as f64 + 0.5) / PER_PIXEL as f64 - REACH;
        let change = |t: f64, k: f64| rise(t - k) + rise(t + k) - 2.0 * rise(t);
        let bins = (0..BINS).filter(|bin| self.count[*bin] > 0.0);
        bins.map(move |bin| {
            let (t, n) = (centre(bin), self.count[bin]);
            let mean = self.sum[bin] / n;
            (change(t, 1.0), change(t, 2.0), mean - rise(t), n)
        })
    }
}

/// Rise of an edge seen by unit pixels: H.
fn rise(t: f64) -> f64 {
    (t + 0.5).clamp(0.0, 1.0)
}

/// Pairs of points that are neighbours along a row or a column of a board.
fn neighbours(
    points: &[Correspondence],
    pitch: f64,
) -> impl Iterator<Item = (&Correspondence, &Correspondence)> {
    let tolerance = 1e-3 * pitch;
    let steps = [DVec2::X * pitch, DVec2::Y * pitch];
    points.iter().flat_map(move |a| {
        steps.into_iter().filter_map(move |step| {
            let there = |b: &&Correspondence| (b.point - a.point - step).length() < tolerance;
            points.iter().find(there).map(|b| (a, b))
        })
    })
}

/// Width of the even areas beside an edge, metres.
fn margin(board: &Board) -> f64 {
    match *board {
        Board::Chess { square, .. } => 0.5 * square,
        Board::Charuco { square, marker, .. } => 0.5 * (square - marker),
        // The border of a tag is one of at most ten cells.
        Board::AprilGrid { tag, gap, .. } => (tag / 10.0).min(gap * tag),
    }
}

/// Samples across an edge: distance towards the bright side, pixels, and value from 0 to 1.
struct Edge {
    samples: Vec<(f64, f64)>,
}

impl Edge {
    /// Reads the middle part of the edge between two corners; `None` if it is clipped, uneven or of
    /// little contrast.
    fn read(picture: &Grey, from: DVec2, to: DVec2, response: &Response) -> Option<Self> {
        let length = from.distance(to);
        let along = (to - from) / length;
        // Corners are blurred, too.
        let half = 0.5 * length - REACH;
        if half < 3.0 {
            return None;
        }
        let middle = 0.5 * (from + to);
        let mut pixels = pixels(picture, (middle, along, half), response)?;
        let levels = [-1.0, 1.0].map(|side| even(&pixels, side));
        let [low, high] = [levels[0]?, levels[1]?];
        let contrast = high - low;
        if contrast.abs() < MIN_CONTRAST {
            return None;
        }
        for (_, t, value) in &mut pixels {
            *value = (*value - low) / contrast;
            if contrast < 0.0 {
                (*t, *value) = (-*t, 1.0 - *value);
            }
        }
        align(&mut pixels);
        let samples = pixels.into_iter().map(|(_, t, value)| (t, value));
        Some(Self {
            samples: samples.collect(),
        })
    }
}

/// Position along and across the edge, pixels, and linear value of a pixel.
type Pixel = (f64, f64, f64);

/// Pixels near an edge; `None` if any is outside the picture or may be clipped.
fn pixels(
    picture: &Grey,
    (middle, along, half): (DVec2, DVec2, f64),
    response: &Response,
) -> Option<Vec<Pixel>> {
    let across = along.perp();
    let extent = (along.abs() * half + across.abs() * (REACH + 0.5)).ceil();
    let (low, high) = ((middle - extent).floor(), (middle + extent).ceil());
    if !picture.contains(low, 1.0) || !picture.contains(high, 1.0) {
        return None;
    }
    let mut out = Vec::new();
    for y in low.y as isize..=high.y as isize {
        for x in low.x as isize..=high.x as isize {
            let offset = DVec2::new(x as f64, y as f64) - middle;
            let (s, t) = (offset.dot(along), offset.dot(across));
            if s.abs() > half || t.abs() > REACH + 0.5 {
                continue;
            }
            let value = linear(picture.at(x, y), response);
            if !UNCLIPPED.contains(&value) {
                return None;
            }
            out.push((s, t, value));
        }
    }
    Some(out)
}

/// Linear value of a code between two codes.
fn linear(code: f32, response: &Response) -> f64 {
    let table = response.linear_from_code();
    let low = code.clamp(0.0, 254.0).floor();
    let (a, b) = (table[low as usize], table[low as usize + 1]);
    f64::from(a + (b - a) * (code - low))
}

/// Mean of the even area on one side of an edge; `None` if it is not even.
fn even(pixels: &[Pixel], side: f64) -> Option<f64> {
    let values = || {
        let area = pixels.iter().filter(|(_, t, _)| t * side > EVEN_FROM);
        area.map(|(_, _, value)| *value)
    };
    let count = values().count() as f64;
    let mean = values().sum::<f64>() / count;
    let variance = values().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    (count > 8.0 && variance.sqrt() < MAX_UNEVEN * MIN_CONTRAST).then_some(mean)
}

/// Moves the pixels so that the step is at 0 along the entire edge: a straight line through the
/// steps of its two halves.
fn align(pixels: &mut [Pixel]) {
    for _ in 0..2 {
        let step = |side: f64| {
            let half = || {
                pixels
                    .iter()
                    .filter(|(s, t, _)| s * side > 0.0 && t.abs() <= REACH)
            };
            let count = half().count() as f64;
            let centre = half().map(|(s, ..)| *s).sum::<f64>() / count;
            (centre, moment(half()))
        };
        let ([(s0, t0), (s1, t1)], slope) = {
            let ends = [step(-1.0), step(1.0)];
            let slope = (ends[1].1 - ends[0].1) / (ends[1].0 - ends[0].0);
            (ends, if slope.is_finite() { slope } else { 0.0 })
        };
        let (middle, offset) = (0.5 * (s0 + s1), 0.5 * (t0 + t1));
        for (s, t, _) in pixels.iter_mut() {
            *t -= offset + slope * (*s - middle);
        }
    }
}

/// Position of the step of normalised pixels: r − ∫ E, from means over bins of half a pixel.
fn moment<'a>(pixels: impl Iterator<Item = &'a Pixel>) -> f64 {
    const WIDTH: f64 = 0.5;
    let mut bins = [(0.0, 0.0); 20];
    for (_, t, value) in pixels {
        let bin = ((t + REACH) / WIDTH).floor().clamp(0.0, 19.0) as usize;
        bins[bin].0 += value;
        bins[bin].1 += 1.0;
    }
    let mean = |i: usize, (sum, count): (f64, f64)| {
        let outside = if i < 10 { 0.0 } else { 1.0 };
        if count > 0.0 { sum / count } else { outside }
    };
    let area: f64 = bins.iter().enumerate().map(|(i, b)| mean(i, *b)).sum();
    REACH - WIDTH * area
}

#[cfg(test)]
mod tests;
