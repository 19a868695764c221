//! Gathers codes of the same surface points under different exposures.

use penumbra_picture::Picture;

/// Side of the blocks whose means are compared, pixels.
const BLOCK: usize = 5;
/// Maximum range of codes within a block: a larger one indicates an edge.
const MAX_RANGE: u8 = 40;
/// Smallest code that may be clipped.
const CLIPPED: u8 = 251;
/// Error of a block's mean by compression and rounding, codes: it does not average out.
const SYSTEMATIC: f64 = 0.7;
/// Maximum number of samples for a pair of exposures, a channel and four codes of the brighter picture.
const MAX_SAMPLES: usize = 40;
/// A prime, whose multiples visit all of a picture's blocks.
const SCATTER: usize = 104_729;

/// Mean codes of one block under two exposures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Pair of exposures: indices into [`SeriesGatherer::exposures`], longer first.
    pub pair: (usize, usize),
    /// Channel: red, green or blue.
    pub channel: usize,
    /// Mean code and its variance under the longer exposure.
    pub longer: (f64, f64),
    /// Mean code and its variance under the shorter exposure.
    pub shorter: (f64, f64),
}

/// Gathers samples from exposure series of static scenes.
#[derive(Clone, Debug, Default)]
pub struct SeriesGatherer {
    /// Natural logarithms of the exposures.
    pub exposures: Vec<f64>,
    samples: Vec<Sample>,
    counts: std::collections::BTreeMap<(usize, usize, usize, u8), u32>,
    /// Number of series.
    pub series: usize,
}

impl SeriesGatherer {
    /// Adds pictures of a static scene, each with the natural logarithm of its exposure.
    pub fn add(&mut self, series: &[(&Picture, f64)]) {
        let mut all: Vec<(&Picture, f64)> = series.to_vec();
        all.sort_by(|a, b| b.1.total_cmp(&a.1));
        let Some(first) = all.first() else { return };
        let size = (first.0.width, first.0.height);
        all.retain(|(picture, log)| (picture.width, picture.height) == size && log.is_finite());
        self.series += usize::from(all.len() > 1);
        let indices: Vec<usize> = all.iter().map(|(_, log)| self.index(*log)).collect();
        let step = step(size);
        let along = |length: u32| (length as usize).saturating_sub(BLOCK).div_ceil(step);
        let (columns, rows) = (along(size.0), along(size.1));
        // In scattered order, so that the samples of a brightness are not all from one surface.
        for k in 0..columns * rows {
            let i = (k * SCATTER + self.series * 7919) % (columns * rows);
            let at = (step * (i % columns), step * (i / columns));
            for c in 0..3 {
                self.add_block(&all, &indices, at, c);
            }
        }
    }

    fn index(&mut self, log: f64) -> usize {
        let known = self.exposures.iter().position(|e| (e - log).abs() < 1e-3);
        known.unwrap_or_else(|| {
            self.exposures.push(log);
            self.exposures.len() - 1
        })
    }

    fn add_block(
        &mut self,
        all: &[(&Picture, f64)],
        indices: &[usize],
        at: (usize, usize),
        channel: usize,
    ) {
        let mut before = None;
        for ((picture, _), &index) in all.iter().zip(indices) {
            let here = block(picture, at, channel);
            if let (Some((longer, i)), Some(shorter)) = (before, here)
                && i != index
            {
                self.keep(Sample {
                    pair: (i, index),
                    channel,
                    longer,
                    shorter,
                });
            }
            before = here.map(|block| (block, index));
        }
    }

    /// Keeps the first [`MAX_SAMPLES`] of each brightness: dark points would outnumber all others.
    fn keep(&mut self, sample: Sample) {
        let (a, b) = sample.pair;
        let bin = (sample.longer.0 / 4.0) as u8;
        let count = self.counts.entry((a, b, sample.channel, bin)).or_insert(0);
        *count += 1;
        if *count as usize <= MAX_SAMPLES {
            self.samples.push(sample);
        }
    }

    /// Returns the samples.
    #[must_use]
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }
}

/// Returns the distance of blocks, pixels, for some ten thousand blocks.
fn step((width, height): (u32, u32)) -> usize {
    let area = f64::from(width) * f64::from(height);
    ((area / 12_000.0).sqrt() as usize).max(BLOCK)
}

/// Returns the mean code of a block and its variance; `None` on edges and where it is clipped.
fn block(picture: &Picture, (x, y): (usize, usize), channel: usize) -> Option<(f64, f64)> {
    let width = picture.width as usize;
    let (mut low, mut high) = (u8::MAX, 0);
    let (mut sum, mut squares) = (0.0, 0.0);
    for v in y..y + BLOCK {
        for u in x..x + BLOCK {
            let code = picture.rgba[4 * (v * width + u) + channel];
            (low, high) = (low.min(code), high.max(code));
            sum += f64::from(code);
            squares += f64::from(code) * f64::from(code);
        }
    }
    let n = (BLOCK * BLOCK) as f64;
    let mean = sum / n;
    let variance = (squares / n - mean * mean).max(0.0);
    // A condition on the darkest pixel would select the brighter of noisy blocks.
    let unclipped = high < CLIPPED && mean > 5.0 * variance.sqrt() && mean > 4.0;
    (unclipped && high - low < MAX_RANGE).then_some((mean, variance / n + SYSTEMATIC * SYSTEMATIC))
}
