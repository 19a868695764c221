//! Removes the lens distortion from the camera's picture, as the compositor does, so that it can be
//! compared with an undistorted composite. On the processor, and only while somebody compares.

use glam::DVec2;
use penumbra_camera::PinholeCamera;
use penumbra_picture::Picture;

/// Steps between two pixels.
const STEPS: u32 = 256;
/// Mark of a pixel that the camera does not show.
const NOWHERE: u32 = u32::MAX;

/// Where each pixel of the undistorted picture lies in the camera's.
pub(super) struct Rectifier {
    size: (u32, u32),
    taps: Vec<Tap>,
}

/// A place between four pixels.
#[derive(Clone, Copy)]
struct Tap {
    /// Index of the pixel at the top left, or [`NOWHERE`].
    index: u32,
    /// Shares of the right and of the lower pixels, of [`STEPS`].
    right: u16,
    below: u16,
}

impl Rectifier {
    /// Prepares the undistorted picture with the camera's own focal lengths and size.
    pub fn new(camera: &PinholeCamera) -> Self {
        let (width, height) = (camera.width, camera.height);
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let tap = |(x, y): (u32, u32)| {
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            let ray = ((pixel - camera.centre) / camera.focal).extend(1.0);
            let place = camera.project(ray);
            place.map_or(Tap::NONE, |place| Tap::new(place, (width, height)))
        };
        Self {
            size: (width, height),
            taps: pixels.map(tap).collect(),
        }
    }

    /// Appends the undistorted picture to `out`, RGBA; the picture itself if it has another size.
    pub fn append(&self, picture: &Picture, out: &mut Vec<u8>) {
        if (picture.width, picture.height) != self.size {
            out.extend_from_slice(&picture.rgba);
            return;
        }
        let row = 4 * self.size.0 as usize;
        for tap in &self.taps {
            let at = 4 * tap.index as usize;
            let corners = (tap.index != NOWHERE).then(|| picture.rgba.get(at..at + row + 8));
            out.extend(match corners.flatten() {
                Some(codes) => tap.blend(codes, row),
                None => [0, 0, 0, 255],
            });
        }
    }
}

impl Tap {
    const NONE: Self = Self {
        index: NOWHERE,
        right: 0,
        below: 0,
    };

    fn new(place: DVec2, (width, height): (u32, u32)) -> Self {
        // The last row and column are reached by the full share of their neighbours.
        let last = DVec2::new(f64::from(width), f64::from(height)) - 2.0;
        if !(place.cmpge(DVec2::splat(-0.5)) & place.cmple(last + 1.5)).all()
            || last.min_element() < 0.0
        {
            return Self::NONE;
        }
        let corner = place.floor().clamp(DVec2::ZERO, last);
        let share = ((place - corner).clamp(DVec2::ZERO, DVec2::ONE) * f64::from(STEPS)).round();
        Self {
            index: corner.y as u32 * width + corner.x as u32,
            right: share.x as u16,
            below: share.y as u16,
        }
    }

    /// Interpolates between the codes from the top left pixel to the lower right one.
    fn blend(self, codes: &[u8], row: usize) -> [u8; 4] {
        let (right, below) = (u32::from(self.right), u32::from(self.below));
        std::array::from_fn(|c| {
            let code = |at: usize| u32::from(codes[at + c]);
            let above = code(0) * (STEPS - right) + code(4) * right;
            let under = code(row) * (STEPS - right) + code(row + 4) * right;
            let sum = above * (STEPS - below) + under * below;
            ((sum + STEPS * STEPS / 2) / (STEPS * STEPS)) as u8
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(k1: f64) -> PinholeCamera {
        PinholeCamera {
            width: 80,
            height: 60,
            focal: DVec2::splat(60.0),
            centre: DVec2::new(39.5, 29.5),
            distortion: [k1, 0.0, 0.0, 0.0, 0.0],
        }
    }

    /// A picture whose red is the column and whose green is the row.
    fn coordinates() -> Picture {
        let pixels = (0..60u8).flat_map(|y| (0..80u8).flat_map(move |x| [3 * x, 4 * y, 0, 255]));
        Picture {
            width: 80,
            height: 60,
            rgba: pixels.collect(),
        }
    }

    fn rectified(camera: &PinholeCamera, picture: &Picture) -> Vec<u8> {
        let mut out = Vec::new();
        Rectifier::new(camera).append(picture, &mut out);
        out
    }

    #[test]
    fn without_distortion_the_picture_stays() {
        let picture = coordinates();
        assert_eq!(rectified(&camera(0.0), &picture), picture.rgba);
    }

    #[test]
    fn each_pixel_shows_what_the_camera_has_at_its_ray() {
        let camera = camera(-0.2);
        let out = rectified(&camera, &coordinates());
        for (x, y) in [(40, 30), (10, 10), (70, 20), (60, 50)] {
            let ray = ((DVec2::new(f64::from(x), f64::from(y)) - camera.centre) / camera.focal)
                .extend(1.0);
            let place = camera.project(ray).unwrap();
            let at = 4 * (y * 80 + x) as usize;
            assert!((f64::from(out[at]) - 3.0 * place.x).abs() < 0.6, "{x} {y}");
            assert!(
                (f64::from(out[at + 1]) - 4.0 * place.y).abs() < 0.6,
                "{x} {y}"
            );
        }
    }

    #[test]
    fn other_sizes_and_places_outside_do_no_harm() {
        let picture = Picture {
            width: 1,
            height: 1,
            rgba: vec![9; 4],
        };
        assert_eq!(rectified(&camera(0.1), &picture), [9; 4]);
        // With strong pincushion distortion the corners are outside of the camera's picture.
        let out = rectified(&camera(2.0), &coordinates());
        assert_eq!((out.len(), &out[..4]), (4 * 80 * 60, &[0, 0, 0, 255][..]));
    }
}
