//! Small grey copies of pictures.

use penumbra_calibration::intrinsics::Grey;
use penumbra_picture::Picture;

/// Maximum side of a small picture, pixels.
const MAX_SIDE: usize = 160;
/// Maximum number of pixels averaged per cell in x and in y.
const TAPS: usize = 4;

/// Computes the luma (Rec. 601) of a picture, reduced by an integer factor: means of a grid of at
/// most [`TAPS`]² pixels in each cell, so that the cost is independent of the picture's size.
pub(super) fn shrink(picture: &Picture, small: &mut Grey) {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let cell = width.max(height).div_ceil(MAX_SIDE).max(1);
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
