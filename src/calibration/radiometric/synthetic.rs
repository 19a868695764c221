//! Synthetic pictures of charts from a known camera, for tests.

use super::reference::{COLUMNS, Edition, ROWS};
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_picture::Picture;

/// Parameters of a synthetic picture.
#[derive(Clone, Debug)]
pub(crate) struct SyntheticChart {
    pub size: (u32, u32),
    /// Pixels of the centres of dark skin, bluish green, black and white.
    pub corners: [DVec2; 4],
    /// Linear values of white.
    pub gains: DVec3,
    pub response: Response,
    /// Standard deviation of the noise, linear.
    pub noise: f64,
    /// Illumination of a point of the chart (columns, rows), by channel.
    pub light: fn(DVec2) -> DVec3,
    /// Seed of the noise.
    pub seed: u64,
}

impl SyntheticChart {
    pub fn new(size: (u32, u32), corners: [(f64, f64); 4]) -> Self {
        Self {
            size,
            corners: corners.map(DVec2::from),
            gains: DVec3::splat(0.9),
            response: Response::srgb(),
            noise: 0.002,
            light: |_| DVec3::ONE,
            seed: 1,
        }
    }

    /// Renders the chart over a wooden table with a white sheet on it.
    pub fn picture(&self) -> Picture {
        let mut picture = Picture {
            width: self.size.0,
            height: self.size.1,
            rgba: vec![255; 4 * self.size.0 as usize * self.size.1 as usize],
        };
        for y in 0..self.size.1 {
            for x in 0..self.size.0 {
                let p = DVec2::new(f64::from(x), f64::from(y));
                let wood = 0.25 + 0.05 * (0.21 * p.x + 2.0 * (0.03 * p.y).sin()).sin();
                let colour = if p.x > 0.7 * f64::from(self.size.0) {
                    DVec3::splat(0.8)
                } else {
                    DVec3::new(wood, 0.7 * wood, 0.45 * wood)
                };
                self.set(&mut picture, x, y, colour, DVec3::ONE);
            }
        }
        self.draw_over(&mut picture);
        picture
    }

    /// Renders the chart over a picture.
    pub fn draw_over(&self, picture: &mut Picture) {
        let map = map(&self.corners).inverse();
        let reference = Edition::default().linear();
        for y in 0..picture.height {
            for x in 0..picture.width {
                let q = map * DVec3::new(f64::from(x), f64::from(y), 1.0);
                let p = q.truncate() / q.z;
                if let Some(colour) = colour_at(&reference, p) {
                    self.set(picture, x, y, colour, (self.light)(p));
                }
            }
        }
    }

    fn set(&self, picture: &mut Picture, x: u32, y: u32, colour: DVec3, light: DVec3) {
        let i = 4 * (y as usize * picture.width as usize + x as usize);
        let value = self.gains * light * colour.max(DVec3::ZERO);
        for c in 0..3 {
            let noise = self.noise * normal(self.seed, (i + c) as u64);
            picture.rgba[i + c] = self.response.code_from_linear((value[c] + noise) as f32);
        }
    }
}

fn colour_at(reference: &[DVec3; COLUMNS * ROWS], p: DVec2) -> Option<DVec3> {
    let (columns, rows) = (COLUMNS as f64, ROWS as f64);
    let framed = p.x > -0.8 && p.y > -0.8 && p.x < columns - 0.2 && p.y < rows - 0.2;
    let nearest = p.round();
    let within = nearest.cmpge(DVec2::ZERO).all() && nearest.x < columns && nearest.y < rows;
    let on_patch = within && (p - nearest).abs().max_element() < 0.43;
    framed.then(|| {
        if on_patch {
            reference[nearest.x as usize + COLUMNS * nearest.y as usize]
        } else {
            DVec3::splat(0.025)
        }
    })
}

/// Returns the homography from columns and rows to pixels.
fn map(corners: &[DVec2; 4]) -> DMat3 {
    let at = [(0.0, 0.0), (5.0, 0.0), (5.0, 3.0), (0.0, 3.0)].map(DVec2::from);
    let pairs: Vec<(DVec2, DVec3)> = at
        .into_iter()
        .zip(corners.map(|c| (c / 500.0).extend(1.0)))
        .collect();
    let h = crate::intrinsics::homography::from_rays(&pairs).unwrap_or_default();
    DMat3::from_diagonal(DVec3::new(500.0, 500.0, 1.0)) * h
}

/// Returns a standard normal deviate that depends on `seed` and `i` alone.
pub(crate) fn normal(seed: u64, i: u64) -> f64 {
    let start = mixed(seed).wrapping_add(i.wrapping_mul(12));
    let sum: f64 = (0..12)
        .map(|k| (mixed(start.wrapping_add(k)) >> 11) as f64 / (1u64 << 53) as f64)
        .sum();
    sum - 6.0
}

/// SplitMix64 (Steele, Lea & Flood 2014).
fn mixed(x: u64) -> u64 {
    let z = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
