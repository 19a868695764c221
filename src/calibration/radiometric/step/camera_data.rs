//! The data gathered from one camera.

use crate::radiometric::chart::{FoundChart, find_charts};
use crate::radiometric::curve::SeriesGatherer;
use crate::radiometric::noise::NoiseGatherer;
use crate::radiometric::noise_texture::NoiseTextureGatherer;
use crate::radiometric::vignetting;
use crate::radiometric::vignetting::Reading;
use crate::step::PictureInput;
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_camera::vignetting::default_frame;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::{Patch, read_codes};

/// A chart in a picture of a camera.
#[derive(Clone, Debug)]
pub(super) struct ChartPicture {
    /// Position of the chart in `picture`.
    pub chart: FoundChart,
    /// The part of the camera's picture with the chart.
    pub picture: Picture,
    /// Seconds since the first picture of all.
    pub seconds: f64,
    /// Exposure time × gain, seconds.
    pub exposure: Option<f64>,
    /// Number of charts in the camera's picture.
    pub charts: usize,
}

/// The data gathered from one camera.
#[derive(Debug, Default)]
pub(super) struct CameraData {
    pub size: (u32, u32),
    pub pictures: usize,
    pub charts: Vec<ChartPicture>,
    /// Codes of the grey card's pixels in the last picture.
    pub grey: Option<Vec<[u8; 3]>>,
    pub series: SeriesGatherer,
    pub noise: NoiseGatherer,
    pub noise_texture: NoiseTextureGatherer,
    /// Number of pictures that show motion since the previous one.
    pub moved: usize,
    /// Centres of the patches found last, pixels.
    pub overlay_points: Vec<DVec2>,
    pub exposure: Option<f64>,
    /// Vignetting found from a moving camera.
    pub moving: Option<vignetting::VignettingFit>,
    flats: Vec<Reading>,
    flat_pictures: usize,
    before: Option<(Picture, f64, Option<f64>)>,
    bracket: Vec<(Picture, f64, i64)>,
    next_search: Option<f64>,
    searches: usize,
}

/// Minimum interval between searches for a chart, seconds.
const SEARCH_INTERVAL: f64 = 0.5;
/// Number of searches without a chart after which the interval increases.
const SEARCHES_PER_INTERVAL: usize = 24;
/// Maximum number of pictures of a chart.
const MAX_CHARTS: usize = 6;
/// Maximum interval between two pictures for the light to count as equal, seconds.
const MAX_GAP: f64 = 1.0;
/// Maximum interval between pictures of one bracket, nanoseconds.
const MAX_BRACKET_NANOS: i64 = 60_000_000;
/// Maximum difference of equal exposures, stops.
const EXPOSURE_TOLERANCE: f64 = 0.05;

impl CameraData {
    /// Adds a picture; `grey` is the grey card's x, y, width and height, pixels.
    pub fn add(&mut self, input: &PictureInput, grey: Option<[u32; 4]>) {
        self.size = (input.picture.width, input.picture.height);
        self.add_to_bracket(input);
        if input.bracket_ev != 0.0 {
            return;
        }
        self.pictures += 1;
        self.exposure = input.exposure.or(self.exposure);
        if let Some(rect) = grey {
            self.grey = codes_in(input.picture, rect);
        }
        self.search(input);
        self.compare(input);
    }

    fn search(&mut self, input: &PictureInput) {
        if self.next_search.is_some_and(|next| input.seconds < next)
            || self.charts.len() >= MAX_CHARTS
        {
            return;
        }
        let found = find_charts(input.picture);
        self.searches += 1;
        let slowdown = (self.searches / SEARCHES_PER_INTERVAL) as i32;
        let wait = if found.is_empty() { slowdown } else { 0 };
        self.next_search = Some(input.seconds + SEARCH_INTERVAL * f64::from(wait + 1));
        self.overlay_points.clear();
        let Some(chart) = found.first() else { return };
        self.overlay_points.extend((0..24).map(|i| chart.centre(i)));
        let (picture, corner) = cropped(input.picture, chart);
        self.charts.push(ChartPicture {
            chart: chart.shifted(-corner),
            picture,
            seconds: input.seconds,
            exposure: input.exposure,
            charts: found.len(),
        });
    }

    /// Compares a picture with the one before: an exposure series if the exposure changed, noise if
    /// nothing moved.
    fn compare(&mut self, input: &PictureInput) {
        if let Some((before, seconds, exposure)) = &self.before
            && input.seconds - seconds < MAX_GAP
            && (before.width, before.height) == self.size
        {
            let step = match (input.exposure, exposure) {
                (Some(now), Some(then)) => (now / then).log2(),
                _ => 0.0,
            };
            if step.abs() > EXPOSURE_TOLERANCE {
                let now = input.exposure.unwrap_or(1.0).ln();
                let then = exposure.unwrap_or(1.0).ln();
                self.series.add(&[(input.picture, now), (before, then)]);
            } else if is_static(before, input.picture) {
                self.noise.add(before, input.picture);
                self.noise_texture.add(before, input.picture);
            } else {
                self.moved += 1;
            }
        }
        let (picture, seconds, exposure) = self.before.get_or_insert_default();
        picture.copy_from(input.picture);
        (*seconds, *exposure) = (input.seconds, input.exposure);
    }

    fn add_to_bracket(&mut self, input: &PictureInput) {
        let at = input.captured_at.as_nanos();
        if input.bracket_ev == 0.0
            || self
                .bracket
                .iter()
                .any(|b| (b.2 - at).abs() > MAX_BRACKET_NANOS)
        {
            self.flush();
        }
        let log = input.bracket_ev * std::f64::consts::LN_2;
        self.bracket.push((input.picture.clone(), log, at));
    }

    /// Adds the current bracket to the exposure series.
    pub fn flush(&mut self) {
        if self.bracket.len() > 1 {
            let series: Vec<(&Picture, f64)> =
                self.bracket.iter().map(|(p, log, _)| (p, *log)).collect();
            self.series.add(&series);
        }
        self.bracket.clear();
    }

    /// Adds readings of a picture of a uniform surface.
    pub fn add_flat(&mut self, picture: &Picture, response: &Response, centre: Option<DVec2>) {
        const BLOCK: u32 = 8;
        self.size = (picture.width, picture.height);
        let (centre, radius) = default_frame(self.size, centre);
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
                let block_centre =
                    DVec2::new(f64::from(x), f64::from(y)) + 0.5 * f64::from(BLOCK - 1);
                let relative = reading.variance_of_mean / (reading.mean * reading.mean);
                self.flats.push(Reading {
                    group,
                    picture: 0,
                    q: (block_centre - centre).length_squared() / (radius * radius),
                    log: reading.mean.ln(),
                    variance: relative + 0.003f64.powi(2),
                });
            }
        }
    }

    /// Returns the vignetting, and whether it is from pictures of a uniform surface.
    pub fn vignetting(&self) -> Option<(vignetting::VignettingFit, bool)> {
        let flat = vignetting::fit(&self.flats).map(|fit| (fit, true));
        flat.or_else(|| Some((self.moving.clone()?, false)))
    }

    /// Returns the chart's patches under a tone curve, for each of its pictures.
    pub fn patches(&self, response: &Response) -> Vec<Vec<Patch>> {
        let read = |seen: &ChartPicture| {
            crate::radiometric::chart::patches::read(&seen.chart, &seen.picture, response)
        };
        self.charts.iter().map(read).collect()
    }
}

/// Returns the codes within a rectangle; `None` if it is not inside the picture.
fn codes_in(picture: &Picture, [x, y, w, h]: [u32; 4]) -> Option<Vec<[u8; 3]>> {
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

/// Returns the part of the picture around a chart, and its upper left corner.
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

/// Returns whether two pictures show a static scene: where the gradient is largest they differ hardly
/// more than in uniform areas of equal brightness (motion of edges), and in uniform areas hardly more
/// than neighbouring pixels do (motion of texture).
fn is_static(a: &Picture, b: &Picture) -> bool {
    let (w, h) = (a.width as usize, a.height as usize);
    // Gradient, difference and noise by brightness, which noise depends on.
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
    // Expected difference of two pictures with the noise that neighbours show (J. Immerkær: Fast
    // noise variance estimation, CVIU 64(2), 1996).
    let expected = std::f64::consts::SQRT_2 / 6.0 * within;
    count > 0.0 && steep < 1.4 * even + 0.8 * count && even < 1.7 * expected + 0.7 * count
}
