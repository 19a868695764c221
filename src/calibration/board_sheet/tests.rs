#![allow(clippy::unwrap_used)]
use super::*;
use crate::intrinsics::Grey;
use crate::intrinsics::detect::{Placement, find_chessboard};
use crate::intrinsics::tag_finder::TagFinder;

fn sheet() -> BoardSheet {
    BoardSheet::of(&Board::parse("chess:9x6:0.025").unwrap())
}

#[test]
fn what_is_drawn_is_found_where_it_was_drawn() {
    let (pixels, width, height) = sheet().raster(100).unwrap();
    let picture = Grey::from_bytes(width as usize, height as usize, &pixels);
    let found = find_chessboard(&picture, 9, 6).unwrap();
    assert_eq!(
        (found.placement, found.corners.len()),
        (Placement::Known, 54)
    );
    // The first corner is a margin and a square in: 37.5 mm at 100 dpi.
    let dots = 100.0 / 0.0254;
    for (&(i, j), p) in &found.corners {
        let x = (0.0375 + 0.025 * f64::from(i)) * dots - 0.5;
        let y = (0.0375 + 0.025 * f64::from(j)) * dots - 0.5;
        assert!(
            (p.x - x).abs() < 0.6 && (p.y - y).abs() < 0.6,
            "{i} {j} {p}"
        );
    }
}

#[test]
fn the_pdf_says_its_size_and_its_table_is_right() {
    let pdf = sheet().pdf();
    let text = String::from_utf8(pdf).unwrap();
    // 10 squares and two margins of 12.5 mm: 275 mm.
    assert!(text.contains("/MediaBox [0 0 779.527559 "), "{text}");
    assert_eq!(text.matches(" re\n").count(), 35 + 12);
    let table: usize = text
        .rsplit_once("startxref\n")
        .unwrap()
        .1
        .lines()
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!(text[table..].starts_with("xref\n"));
    for (i, line) in text[table..].lines().skip(3).take(5).enumerate() {
        let place: usize = line[..10].parse().unwrap();
        assert!(text[place..].starts_with(&format!("{} 0 obj", i + 1)));
    }
    let stream = text
        .split_once("stream\n")
        .unwrap()
        .1
        .split_once("endstream")
        .unwrap()
        .0;
    assert!(text.contains(&format!("/Length {} ", stream.len())));
    assert!(sheet().svg().contains("width=\"275.0000mm\""));
}

#[test]
fn what_cannot_be_drawn_is_said() {
    assert!(matches!(
        sheet().raster(100_000),
        Err(SheetError::TooLarge { .. })
    ));
    assert!(matches!(
        sheet().raster(0),
        Err(SheetError::TooLarge { .. })
    ));
    let small = BoardSheet::of(&Board::parse("chess:3x3:0.005").unwrap());
    assert!(small.words.contains("20 mm long"));
}

/// Drawn, looked at, and every point where it was drawn.
#[test]
fn boards_of_tags_are_found_where_they_were_drawn() {
    for (text, tags, first) in [
        (
            "aprilgrid:3x2:0.03:0.3",
            6,
            (0.5 * 0.009 + 0.009, 0.5 * 0.009 + 0.009),
        ),
        ("charuco:5x4:0.02:0.015:5x5_100", 10, (0.01, 0.01)),
        ("charuco:4x5:0.02:0.014:aruco_original", 10, (0.01, 0.01)),
        ("charuco:4x5:0.03:0.024:tag36h11", 10, (0.015, 0.015)),
    ] {
        let board = Board::parse(text).unwrap();
        let (pixels, width, height) = BoardSheet::of(&board).raster(200).unwrap();
        let picture = Grey::from_bytes(width as usize, height as usize, &pixels);
        let seen = TagFinder::new(&board).unwrap().find(&picture);
        assert_eq!(
            (seen.tags, seen.points.len()),
            (tags, board.point_count()),
            "{text}"
        );
        let dots = 200.0 / 0.0254;
        for c in seen.points {
            let drawn = (c.point + glam::DVec2::from(first)) * dots - 0.5;
            assert!(c.pixel.distance(drawn) < 0.8, "{text} {} {drawn}", c.pixel);
        }
    }
}
