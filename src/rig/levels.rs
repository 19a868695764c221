//! Brightness of the scene camera's picture, for the status.

use penumbra_picture::Picture;
use penumbra_status::Levels;

/// Distance of the pixels that are counted, across and down.
const STEP: u32 = 16;

/// Returns mean and clipped share of a picture, from one pixel in 256.
pub(crate) fn levels(picture: &Picture) -> Levels {
    let (mut sum, mut clipped, mut count) = (0.0, 0.0, 0.0);
    let half = STEP / 2;
    for y in (half..picture.height).step_by(STEP as usize) {
        for x in (half..picture.width).step_by(STEP as usize) {
            let codes = picture.rgb(x, y);
            sum += codes.iter().map(|&c| f64::from(c)).sum::<f64>() / 3.0;
            clipped += f64::from(u8::from(codes.contains(&255)));
            count += 1.0;
        }
    }
    let share = |total: f64| (count > 0.0).then_some(total / count);
    Levels {
        mean_code: share(sum),
        clipped: share(clipped),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dark_and_clipped_pictures_are_told_apart() {
        let grey = |code: u8| Picture {
            width: 40,
            height: 40,
            rgba: [code, code, code, 255].repeat(1600),
        };
        assert_eq!(levels(&grey(20)).mean_code, Some(20.0));
        assert_eq!(levels(&grey(20)).clipped, Some(0.0));
        assert_eq!(levels(&grey(255)).clipped, Some(1.0));
        assert_eq!(levels(&Picture::default()).mean_code, None);
    }
}
