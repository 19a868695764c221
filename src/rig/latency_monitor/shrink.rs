//! Small grey copies of pictures.

use penumbra_calibration::intrinsics::Grey;
use penumbra_picture::Picture;

/// Small pictures are no longer than this, pixels,
const LONGEST: usize = 160;
/// and each of their pixels is the mean of at most so many, squared.
const TAPS: usize = 4;

/// Luma (Rec.601) of a picture, smaller by a whole number: means of a grid of at most
/// [`TAPS`]² pixels in each cell, so that a large picture costs what a small one does.
pub(super) fn shrink(picture: &Picture, small: &mut Grey) {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let cell = width.max(height).div_ceil(LONGEST).max(1);
    (small.width, small.height) = (width / cell, height / cell);
    small.data.clear();
    let taps = cell.min(TAPS);
    let tap = |i: usize| (2 * i + 1) * cell / (2 * taps);
    let luma = |x: usize, y: usize| {
        let at = 4 * (y * width + x);
        let rgb = picture.rgba.get(at..at + 3).unwrap_or(&[0, 0, 0]);
        0.299 * f32::from(rgb[0]) + 0.587 * f32::from(rgb[1]) + 0.114 * f32::from(rgb[2])
    };
    for y in 0..small.height {
        for x in 0..small.width {
            let mut sum = 0.0;
            for j in 0..taps {
                for i in 0..taps {
                    sum += luma(x * cell + tap(i), y * cell + tap(j));
                }
            }
            small.data.push(sum / (taps * taps) as f32);
        }
    }
}
