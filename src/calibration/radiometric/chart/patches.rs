//! Reads the patches of a chart.

use super::FoundChart;
use glam::DVec2;
use penumbra_camera::Response;
use penumbra_picture::Picture;
use penumbra_white_balance::chart::{Patch, read_codes};

/// Half the width of the part of a patch that is read, in pitches: patches are 0.8 to 0.9 of a pitch
/// wide.
pub(in crate::radiometric) const HALF: f64 = 0.24;
/// Maximum number of pixels read of a patch.
const MAX_PIXELS: f64 = 4000.0;

/// Reads the linear values of the 24 patches of `chart`.
#[must_use]
pub fn read(chart: &FoundChart, picture: &Picture, response: &Response) -> Vec<Patch> {
    let codes = (0..24).map(|i| codes_of(chart, picture, i));
    codes
        .map(|codes| {
            let channel = |c: usize| codes.iter().map(|rgb| rgb[c]).collect::<Vec<u8>>();
            Patch([0, 1, 2].map(|c| read_codes(&channel(c), response)))
        })
        .collect()
}

/// Returns the codes of the inner part of a patch.
fn codes_of(chart: &FoundChart, picture: &Picture, patch: usize) -> Vec<[u8; 3]> {
    let [a, b, c, d] = chart.corners(patch, HALF);
    let right = b.distance(a).max(c.distance(d));
    let down = d.distance(a).max(c.distance(b));
    let thin = (right * down / MAX_PIXELS).sqrt().max(1.0);
    let steps = |length: f64| (length / thin).floor().max(2.0) as u32;
    let (columns, rows) = (steps(right), steps(down));
    let mut codes = Vec::with_capacity((columns * rows) as usize);
    for j in 0..rows {
        for i in 0..columns {
            let (u, v) = (
                (f64::from(i) + 0.5) / f64::from(columns),
                (f64::from(j) + 0.5) / f64::from(rows),
            );
            let p = a.lerp(b, u).lerp(d.lerp(c, u), v).round();
            if inside(picture, p) {
                codes.push(picture.rgb(p.x as u32, p.y as u32));
            }
        }
    }
    codes
}

fn inside(picture: &Picture, p: DVec2) -> bool {
    p.x >= 0.0 && p.y >= 0.0 && p.x < f64::from(picture.width) && p.y < f64::from(picture.height)
}
