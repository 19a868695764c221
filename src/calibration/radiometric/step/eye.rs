//! What one camera has shown.

use crate::radiometric::chart::{FoundChart, find_charts};
use crate::radiometric::curve::SeriesGatherer;
use crate::radiometric::noise::NoiseGatherer;
use crate::radiometric::vignetting;
use crate::radiometric::vignetting::Reading;
use crate::step::ShownPicture;
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_camera::vignetting::frame;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::{Patch, read_codes};

/// A chart as a camera has shown it.
#[derive(Clone, Debug)]
pub struct ChartSeen {
    /// Where in `picture`.
    pub chart: FoundChart,
    /// The part of the camera's picture with the chart.
    pub picture: Picture,
    /// Since the first of all pictures.
    pub seconds: f64,
    /// Exposure time × gain, seconds.
    pub exposure: Option<f64>,
    /// Charts in that picture.
    pub charts: usize,
}

/// Everything kept of one camera.
#[derive(Debug, Default)]
pub(super) struct EyeState {
    pub size: (u32, u32),
    pub pictures: usize,
    pub charts: Vec<ChartSeen>,
    /// What a grey card reads: codes of its pixels, the last picture's.
    pub grey: Option<Vec<[u8; 3]>>,
    pub series: SeriesGatherer,
    pub noise: NoiseGatherer,
    /// Pictures whose neighbour in time was taken from elsewhere.
    pub moved: usize,
    /// Middles of the patches found last.
    pub marks: Vec<DVec2>,
    pub exposure: Option<f64>,
    /// The fall-off found while the camera moved.
    pub moving: Option<vignetting::Fit>,
    flats: Vec<Reading>,
    flat_pictures: usize,
    before: Option<(Picture, f64, Option<f64>)>,
    bracket: Vec<(Picture, f64, i64)>,
    next_search: Option<f64>,
    searches: usize,
}

/// A chart is looked for no more often, seconds.
const SEARCH_EVERY: f64 = 0.5;
/// After so many pictures without a chart it is looked for more and more seldom.
const PATIENCE: usize = 24;
/// Pictures of a chart that are kept.
const CHARTS: usize = 6;
/// Pictures further apart in time may show different light, seconds.
const NEIGHBOURS: f64 = 1.0;
/// Brackets of one instant, nanoseconds.
const INSTANT: i64 = 60_000_000;
/// Exposures this close are the same, stops.
const SAME_EXPOSURE: f64 = 0.05;

impl EyeState {
    pub fn look(&mut self, shown: &ShownPicture, grey: Option<[u32; 4]>) {
        self.size = (shown.picture.width, shown.picture.height);
        self.take_bracket(shown);
        if shown.bracket_ev != 0.0 {
            return;
        }
        self.pictures += 1;
        self.exposure = shown.exposure.or(self.exposure);
        if let Some(rect) = grey {
            self.grey = codes_in(shown.picture, rect);
        }
        self.search(shown);
        self.compare(shown);
    }

    fn search(&mut self, shown: &ShownPicture) {
        if self.next_search.is_some_and(|next| shown.seconds < next) || self.charts.len() >= CHARTS
        {
            return;
        }
        let found = find_charts(shown.picture);
        self.searches += 1;
        let seldom = (self.searches / PATIENCE) as i32;
        let wait = if found.is_empty() { seldom } else { 0 };
        self.next_search = Some(shown.seconds + SEARCH_EVERY * f64::from(wait + 1));
        self.marks.clear();
        let Some(chart) = found.first() else { return };
        self.marks.extend((0..24).map(|i| chart.middle(i)));
        let (picture, corner) = cropped(shown.picture, chart);
        self.charts.push(ChartSeen {
            chart: chart.shifted(-corner),
            picture,
            seconds: shown.seconds,
            exposure: shown.exposure,
            charts: found.len(),
        });
    }

    /// With the picture before: noise if nothing moved, a step of exposure if that changed.
    fn compare(&mut self, shown: &ShownPicture) {
        if let Some((before, seconds, exposure)) = &self.before
            && shown.seconds - seconds < NEIGHBOURS
            && (before.width, before.height) == self.size
        {
            let step = match (shown.exposure, exposure) {
                (Some(now), Some(then)) => (now / then).log2(),
                _ => 0.0,
            };
            if step.abs() > SAME_EXPOSURE {
                let now = shown.exposure.unwrap_or(1.0).ln();
                let then = exposure.unwrap_or(1.0).ln();
                self.series.add(&[(shown.picture, now), (before, then)]);
            } else if at_rest(before, shown.picture) {
                self.noise.add(before, shown.picture);
            } else {
                self.moved += 1;
            }
        }
        let (picture, seconds, exposure) = self.before.get_or_insert_default();
        picture.copy_from(shown.picture);
        (*seconds, *exposure) = (shown.seconds, shown.exposure);
    }

    fn take_bracket(&mut self, shown: &ShownPicture) {
        let at = shown.captured_at.as_nanos();
        if shown.bracket_ev == 0.0 || self.bracket.iter().any(|b| (b.2 - at).abs() > INSTANT) {
            self.flush();
        }
        let log = shown.bracket_ev * std::f64::consts::LN_2;
        self.bracket.push((shown.picture.clone(), log, at));
    }

    /// Uses the brackets of one instant together.
    pub fn flush(&mut self) {
        if self.bracket.len() > 1 {
            let series: Vec<(&Picture, f64)> =
                self.bracket.iter().map(|(p, log, _)| (p, *log)).collect();
            self.series.add(&series);
        }
        self.bracket.clear();
    }

    /// The middle of an evenly lit surface is as bright as its edge.
    pub fn add_flat(&mut self, picture: &Picture, response: &Response, centre: Option<DVec2>) {
        const BLOCK: u32 = 8;
        self.size = (picture.width, picture.height);
        let (centre, radius) = frame(self.size, centre);
        let group = self.flat_pictures;
        self.flat_pictures += 1;
        let step = (picture.width / 48).max(BLOCK);
        for y in (0..picture.height.saturating_sub(BLOCK)).step_by(step as usize) {
            for x in (0..picture.width.saturating_sub(BLOCK)).step_by(step as usize) {
                let Some(codes) = codes_in(picture, [x, y, BLOCK, BLOCK]) else {
                    continue;
                };
                let green: Vec<u8> = codes.iter().map(|c| c[1]).collect();
                let Some(reading) = read_codes(&green, response) else {
                    continue;
                };
                let middle = DVec2::new(f64::from(x), f64::from(y)) + 0.5 * f64::from(BLOCK - 1);
                let relative = reading.variance_of_mean / (reading.mean * reading.mean);
                self.flats.push(Reading {
                    group,
                    picture: 0,
                    q: (middle - centre).length_squared() / (radius * radius),
                    log: reading.mean.ln(),
                    variance: relative + 0.003f64.powi(2),
                });
            }
        }
    }

    /// The fall-off, and whether flat pictures tell it.
    pub fn fall_off(&self) -> Option<(vignetting::Fit, bool)> {
        let flat = vignetting::fit(&self.flats).map(|fit| (fit, true));
        flat.or_else(|| Some((self.moving.clone()?, false)))
    }

    /// What the chart's patches read under a tone curve, of each picture of it.
    pub fn patches(&self, response: &Response) -> Vec<Vec<Patch>> {
        let read = |seen: &ChartSeen| {
            crate::radiometric::chart::patches::read(&seen.chart, &seen.picture, response)
        };
        self.charts.iter().map(read).collect()
    }
}

/// Codes within a rectangle; `None` if it is not inside the picture.
pub(super) fn codes_in(picture: &Picture, [x, y, w, h]: [u32; 4]) -> Option<Vec<[u8; 3]>> {
    let inside = |start: u32, length: u32, limit: u32| {
        length > 0 && start.checked_add(length).is_some_and(|end| end <= limit)
    };
    if !inside(x, w, picture.width) || !inside(y, h, picture.height) {
        return None;
    }
    let rows = y..y + h;
    Some(
        rows.flat_map(|v| (x..x + w).map(move |u| picture.rgb(u, v)))
            .collect(),
    )
}

/// The part of the picture around a chart, and its corner.
fn cropped(picture: &Picture, chart: &FoundChart) -> (Picture, DVec2) {
    let corners = [0, 5, 18, 23].map(|i| chart.corners(i, 0.9));
    let all = || corners.iter().flatten();
    let low = all()
        .fold(DVec2::MAX, |a, b| a.min(*b))
        .floor()
        .max(DVec2::ZERO);
    let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
    let high = all().fold(DVec2::MIN, |a, b| a.max(*b)).ceil().min(size);
    let (x, y) = (low.x as u32, low.y as u32);
    let (width, height) = ((high.x - low.x) as u32, (high.y - low.y) as u32);
    let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
    for v in y..y + height {
        let start = 4 * (v as usize * picture.width as usize + x as usize);
        rgba.extend_from_slice(&picture.rgba[start..start + 4 * width as usize]);
    }
    let part = Picture {
        width,
        height,
        rgba,
    };
    (part, low)
}

/// Whether edges are where they were: where the picture is steepest it differs from the one before
/// hardly more than where it is even and as bright, as noise does and motion does not; and there
/// hardly more than neighbouring pixels do, as where a texture moved.
fn at_rest(a: &Picture, b: &Picture) -> bool {
    let (w, h) = (a.width as usize, a.height as usize);
    // Slope, difference and noise by brightness, which noise depends on.
    let mut bins: [Vec<[i32; 3]>; 16] = Default::default();
    for y in (1..h.saturating_sub(1)).step_by(3) {
        for x in (1..w.saturating_sub(1)).step_by(3) {
            let i = 4 * (y * w + x) + 1;
            let code = |k: usize| i32::from(a.rgba[k]);
            let (up, down) = (i - 4 * w, i + 4 * w);
            let slope = (code(i + 4) - code(i - 4)).abs();
            let slope = slope.max((code(down) - code(up)).abs());
            let difference = (code(i) - i32::from(b.rgba[i])).abs();
            let row = |k: usize| code(k - 4) - 2 * code(k) + code(k + 4);
            let noise = (row(up) - 2 * row(i) + row(down)).abs();
            bins[code(i) as usize / 16].push([slope, difference, noise]);
        }
    }
    let mean = |part: &[[i32; 3]], k: usize| {
        part.iter().map(|p| f64::from(p[k])).sum::<f64>() / part.len() as f64
    };
    let (mut steep, mut even, mut within, mut count) = (0.0, 0.0, 0.0, 0.0);
    for bin in bins.iter_mut().filter(|bin| bin.len() >= 60) {
        bin.sort_unstable_by_key(|p| p[0]);
        let n = bin.len();
        let top = (n / 12) as f64;
        steep += top * mean(&bin[n - n / 12..], 1);
        even += top * mean(&bin[..n / 2], 1);
        within += top * mean(&bin[..n / 2], 2);
        count += top;
    }
    // J. Immerkær: Fast noise variance estimation, CVIU 64(2), 1996: by how much two pictures
    // differ whose noise is that of neighbours.
    let expected = std::f64::consts::SQRT_2 / 6.0 * within;
    count > 0.0 && steep < 1.4 * even + 0.8 * count && even < 1.7 * expected + 0.7 * count
}
