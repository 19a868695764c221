//! Text in a picture, to say what was found in it.

use crate::Picture;

/// Width and height of a character, dots; the eighth row is below the line.
const SIZE: [usize; 2] = [5, 8];
/// Distance of two characters' left edges, dots.
const STEP: usize = 6;

/// The characters that can be drawn, and their dots.
const SHEETS: [(&str, [&str; SIZE[1]]); 3] = [
    (
        "0123456789%.,:-'",
        [
            ".###....#....###...###.....#..#####...##..#####..###...###..##..............................#..",
            "#...#..##...#...#.#...#...##..#......#........#.#...#.#...#.##..#...............##..........#..",
            "#..##...#.......#.....#..#.#..####..#........#..#...#.#...#....#................##..........#..",
            "#.#.#...#.....##....##..#..#......#.####....#....###...####...#.....................#####......",
            "##..#...#....#........#.#####.....#.#...#..#....#...#.....#..#..................##.............",
            "#...#...#...#.....#...#....#..#...#.#...#..#....#...#....#..#..##...##....##....##.............",
            ".###...###..#####..###.....#...###...###...#.....###...##......##...##....#....................",
            ".........................................................................#.....................",
        ],
    ),
    (
        "abcdefghijklm",
        [
            "......#...............#.........##........#.......#......#..#......##........",
            "......#...............#........#..#.......#.................#.......#........",
            ".###..#.##...###...##.#..###...#.....####.#.##...##.....##..#..#....#...##.#.",
            "....#.##..#.#...#.#..##.#...#.###...#...#.##..#...#......#..#.#.....#...#.#.#",
            ".####.#...#.#.....#...#.#####..#....#...#.#...#...#......#..##......#...#.#.#",
            "#...#.#...#.#...#.#...#.#......#.....####.#...#...#......#..#.#.....#...#.#.#",
            ".####.####...###...####..###...#........#.#...#..###..#..#..#..#...###..#.#.#",
            ".....................................###...............##....................",
        ],
    ),
    (
        "nopqrstuvwxyz",
        [
            ".....................................#.......................................",
            ".....................................#.......................................",
            "#.##...###..####...####.#.##...####.###...#...#.#...#.#...#.#...#.#...#.#####",
            "##..#.#...#.#...#.#...#.##..#.#......#....#...#.#...#.#...#..#.#..#...#....#.",
            "#...#.#...#.#...#.#...#.#......###...#....#...#.#...#.#.#.#...#...#...#...#..",
            "#...#.#...#.####...####.#.........#..#..#.#..##..#.#..#.#.#..#.#...####..#...",
            "#...#..###..#.........#.#.....####....##...##.#...#....#.#..#...#.....#.#####",
            "............#.........#............................................###.......",
        ],
    ),
];

impl Picture {
    /// Draws a line of text, light on a dark plate whose upper edge is centred at `at` (x, y; pixels). It is moved
    /// into the picture if it does not fit there. Lower-case letters, digits, spaces and `%.,:-'` can be drawn;
    /// others are left out. A character is about a 70th of the picture's width wide.
    pub fn draw_label(&mut self, at: [f64; 2], text: &str, colour: [u8; 3]) {
        let dot = i64::from((self.width / 400).max(2));
        let size = |dots: usize| dots as i64 * dot;
        let plate = [size(STEP * text.chars().count() + 1), size(SIZE[1] + 2)];
        let space = [self.width, self.height].map(i64::from);
        // What is far outside counts as beside the picture; no number as 0.
        let [x, y] = at.map(|p| p.clamp(-1e9, 1e9) as i64);
        let corner = [x - plate[0] / 2, y];
        let [left, top] = [0, 1].map(|k| corner[k].min(space[k] - plate[k]).max(0));
        self.fill([left, top], plate, [0; 3]);
        for (k, character) in text.chars().enumerate() {
            let x = left + size(STEP * k + 1);
            for [column, row] in dots(character) {
                self.fill([x + size(column), top + size(row + 1)], [dot; 2], colour);
            }
        }
    }

    /// Colours a rectangle of `size` pixels.
    fn fill(&mut self, corner: [i64; 2], size: [i64; 2], colour: [u8; 3]) {
        for y in corner[1]..corner[1] + size[1] {
            for x in corner[0]..corner[0] + size[0] {
                self.paint(x, y, colour);
            }
        }
    }
}

/// Returns columns and rows of a character's dots.
fn dots(character: char) -> impl Iterator<Item = [usize; 2]> {
    let place = |(characters, sheet): &(&str, [&'static str; SIZE[1]])| {
        Some((characters.chars().position(|c| c == character)?, *sheet))
    };
    let found = SHEETS.iter().find_map(place);
    found.into_iter().flat_map(|(k, sheet)| {
        sheet.into_iter().enumerate().flat_map(move |(row, dots)| {
            let own = dots.bytes().skip(STEP * k).take(SIZE[0]).enumerate();
            own.filter_map(move |(column, dot)| (dot == b'#').then_some([column, row]))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_character_has_its_own_dots() {
        let all = |c: char| dots(c).collect::<Vec<_>>();
        let known: Vec<char> = SHEETS.iter().flat_map(|(c, _)| c.chars()).collect();
        for (i, &c) in known.iter().enumerate() {
            assert!(!all(c).is_empty(), "{c}");
            assert!(known[..i].iter().all(|&other| all(other) != all(c)), "{c}");
        }
        for (characters, sheet) in SHEETS {
            let width = STEP * characters.len() - 1;
            assert!(sheet.iter().all(|row| row.len() == width), "{characters}");
        }
        assert!(all(' ').is_empty() && all('Ä').is_empty());
    }

    #[test]
    fn labels_stay_inside() {
        let green = [60, 255, 90];
        for at in [
            [100.0, 5.0],
            [-1e300, 1e300],
            [190.0, 99.0],
            [f64::NAN, 0.0],
        ] {
            let mut picture = Picture {
                width: 200,
                height: 100,
                rgba: vec![90; 4 * 200 * 100],
            };
            picture.draw_label(at, "93 %", green);
            let count = |colour| picture.rgba.chunks(4).filter(|p| p[..3] == colour).count();
            // Two pixels a dot in either direction.
            let expected: usize = "93 %".chars().map(|c| 4 * dots(c).count()).sum();
            assert_eq!(count(green), expected, "{at:?}");
        }
        let mut tiny = Picture {
            width: 3,
            height: 1,
            rgba: vec![90; 12],
        };
        tiny.draw_label([0.0, 0.0], "outline seen: 93 %", green);
    }
}
