//! Follows the outlines of black areas along the cracks between pixels.

use super::threshold::Black;
use glam::DVec2;

/// Minimum length of an outline, cracks: that of a square with sides of eight pixels.
const MIN_CRACKS: usize = 32;

/// Finds outer outlines. Reuses its buffers.
#[derive(Clone, Debug, Default)]
pub(super) struct Walker {
    seen: Vec<bool>,
    corners: Vec<(u16, u16)>,
}

/// Direction of a step along a crack.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Direction {
    Up,
    Right,
    Down,
    Left,
}

impl Direction {
    const fn to_the_right(self) -> Self {
        match self {
            Self::Up => Self::Right,
            Self::Right => Self::Down,
            Self::Down => Self::Left,
            Self::Left => Self::Up,
        }
    }

    const fn to_the_left(self) -> Self {
        self.to_the_right().to_the_right().to_the_right()
    }
}

impl Walker {
    /// Calls `found` with the centres of the cracks (pixels) of every outer outline that is long
    /// enough, in clockwise order on the screen. Black pixels that touch only at a corner belong
    /// to different outlines, which separates the tags of boards whose tags touch.
    pub fn walk(
        &mut self,
        black: &Black,
        outline: &mut Vec<DVec2>,
        mut found: impl FnMut(&[DVec2]),
    ) {
        let stride = black.width + 2;
        self.seen.clear();
        self.seen.resize(black.pixels.len(), false);
        for start in stride + 1..black.pixels.len() {
            if black.pixels[start] && !black.pixels[start - 1] && !self.seen[start] {
                let area = self.follow(&black.pixels, stride, start);
                if area > 0 && self.corners.len() >= MIN_CRACKS {
                    self.middles(outline);
                    found(outline);
                }
            }
        }
    }

    /// Follows one outline with black on the right; returns twice the enclosed area, negative for
    /// the outline of a hole.
    fn follow(&mut self, black: &[bool], stride: usize, start: usize) -> i64 {
        self.corners.clear();
        let first = (start % stride, start / stride + 1);
        let (mut x, mut y) = first;
        let mut direction = Direction::Up;
        let mut area = 0;
        loop {
            self.corners.push((x as u16, y as u16));
            let before = (x as i64, y as i64);
            match direction {
                Direction::Up => {
                    y -= 1;
                    self.seen[y * stride + x] = true;
                }
                Direction::Right => x += 1,
                Direction::Down => y += 1,
                Direction::Left => x -= 1,
            }
            area += before.0 * y as i64 - x as i64 * before.1;
            if (x, y) == first {
                return area;
            }
            direction = next_direction(black, stride, (x, y), direction);
        }
    }

    fn middles(&self, outline: &mut Vec<DVec2>) {
        outline.clear();
        let n = self.corners.len();
        outline.extend((0..n).map(|i| {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % n]);
            let sum = |a: u16, b: u16| f64::from(a) + f64::from(b);
            // The margin is one pixel wide; a pixel's top-left corner lies half a pixel before its
            // centre.
            DVec2::new(sum(a.0, b.0), sum(a.1, b.1)) / 2.0 - 1.5
        }));
    }
}

fn next_direction(
    black: &[bool],
    stride: usize,
    (x, y): (usize, usize),
    direction: Direction,
) -> Direction {
    let at = |dx: usize, dy: usize| black[(y - dy) * stride + x - dx];
    let (left, right) = match direction {
        Direction::Up => (at(1, 1), at(0, 1)),
        Direction::Right => (at(0, 1), at(0, 0)),
        Direction::Down => (at(0, 0), at(1, 0)),
        Direction::Left => (at(1, 0), at(1, 1)),
    };
    match (left, right) {
        (_, false) => direction.to_the_right(),
        (false, true) => direction,
        (true, true) => direction.to_the_left(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outlines(picture: &[&str]) -> Vec<Vec<DVec2>> {
        let (width, height) = (picture[0].len(), picture.len());
        let grey: Vec<u8> = picture
            .iter()
            .flat_map(|row| row.bytes().map(|b| if b == b'#' { 0 } else { 200 }))
            .collect();
        let mut black = Black::default();
        black.binarise(&grey, (width, height), 128);
        let mut all = Vec::new();
        Walker::default().walk(&black, &mut Vec::new(), |o| all.push(o.to_vec()));
        all
    }

    #[test]
    fn squares_that_touch_at_a_corner_have_separate_clockwise_outlines() {
        let row = |from: usize, to: usize| -> String {
            (0..40)
                .map(|x| if (from..to).contains(&x) { '#' } else { '.' })
                .collect()
        };
        let mut rows: Vec<String> = Vec::new();
        for y in 0..32 {
            rows.push(match y {
                4..14 => row(4, 16),
                14..26 => row(16, 26),
                _ => row(0, 0),
            });
        }
        let rows: Vec<&str> = rows.iter().map(String::as_str).collect();
        let found = outlines(&rows);
        assert_eq!(found.iter().map(Vec::len).collect::<Vec<_>>(), [44, 44]);
        let lowest = found[0].iter().copied().reduce(DVec2::min);
        let highest = found[0].iter().copied().reduce(DVec2::max);
        assert_eq!(lowest, Some(DVec2::new(3.5, 3.5)));
        assert_eq!(highest, Some(DVec2::new(15.5, 13.5)));
        let area: f64 = (0..44)
            .map(|i| found[0][i].perp_dot(found[0][(i + 1) % 44]))
            .sum();
        assert!(area > 0.0);
    }
}
