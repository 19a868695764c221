//! Lines in a picture, to show what was found in it.

use crate::Picture;

impl Picture {
    /// Draws a line through points (x, y; pixels, (0, 0) is the centre of the top-left one), about
    /// one 800th of the picture's width wide. A point that is missing interrupts it.
    pub fn draw_line(
        &mut self,
        points: impl IntoIterator<Item = Option<[f64; 2]>>,
        colour: [u8; 3],
    ) {
        let mut last: Option<[f64; 2]> = None;
        for point in points {
            if let (Some(a), Some(b)) = (last, point) {
                self.draw_segment(a, b, colour);
            }
            last = point;
        }
    }

    fn draw_segment(&mut self, a: [f64; 2], b: [f64; 2], colour: [u8; 3]) {
        let (width, height) = (f64::from(self.width), f64::from(self.height));
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        // A line that leaves the picture far away is not followed for ever.
        if length.is_nan() || length > 4.0 * width.hypot(height) {
            return;
        }
        let half = ((width / 800.0).max(1.0) / 2.0).ceil() as i64;
        let steps = (2.0 * length).ceil().max(1.0) as u32;
        for i in 0..=steps {
            let t = f64::from(i) / f64::from(steps);
            let [x, y] = [0, 1].map(|k| (a[k] + (b[k] - a[k]) * t).round() as i64);
            for (dx, dy) in (-half..half).flat_map(|dx| (-half..half).map(move |dy| (dx, dy))) {
                self.paint(x + dx, y + dy, colour);
            }
        }
    }

    /// Colours a pixel, unless it is outside.
    pub(crate) fn paint(&mut self, x: i64, y: i64, colour: [u8; 3]) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else {
            return;
        };
        if x < self.width && y < self.height {
            let at = 4 * (y as usize * self.width as usize + x as usize);
            if let Some(pixel) = self.rgba.get_mut(at..at + 3) {
                pixel.copy_from_slice(&colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_stay_inside_and_are_interrupted() {
        let mut picture = Picture {
            width: 20,
            height: 10,
            rgba: vec![0; 800],
        };
        let red = [255, 0, 0];
        picture.draw_line([Some([-5.0, 5.0]), Some([8.0, 5.0]), None], red);
        picture.draw_line([Some([12.0, 5.0]), Some([30.0, 5.0])], red);
        picture.draw_line([Some([f64::NAN, 5.0]), Some([10.0, 5.0])], red);
        picture.draw_line([Some([0.0, 0.0]), Some([1e300, 1e300])], red);
        assert_eq!(picture.rgb(0, 5), red);
        assert_eq!(picture.rgb(19, 5), red);
        assert_eq!(picture.rgb(10, 5), [0; 3]);
        assert_eq!(picture.rgb(5, 1), [0; 3]);
    }
}
