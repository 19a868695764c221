use super::*;
use crate::intrinsics::Grey;
use crate::intrinsics::detect::{Placement, find_chessboard};
use crate::intrinsics::tag_finder::TagFinder;
use crate::sheet::SheetError;

fn sheet() -> Sheet {
    sheet_of(&Board::parse("chess:9x6:0.025").unwrap())
}

#[test]
fn corners_are_detected_at_printed_positions() {
    let (pixels, width, height) = sheet().raster(100).unwrap();
    let picture = Grey::from_bytes(width as usize, height as usize, &pixels);
    let found = find_chessboard(&picture, 9, 6).unwrap();
    assert_eq!(
        (found.placement, found.corners.len()),
        (Placement::Known, 54)
    );
    // Margin and square put the first corner at 37.5 mm.
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
fn pdf_has_true_size_and_valid_cross_reference_table() {
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
        let offset: usize = line[..10].parse().unwrap();
        assert!(text[offset..].starts_with(&format!("{} 0 obj", i + 1)));
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
fn raster_of_impossible_size_is_an_error() {
    assert!(matches!(
        sheet().raster(100_000),
        Err(SheetError::TooLarge { .. })
    ));
    assert!(matches!(
        sheet().raster(0),
        Err(SheetError::TooLarge { .. })
    ));
    let small = sheet_of(&Board::parse("chess:3x3:0.005").unwrap());
    assert!(small.texts[0].text.contains("20 mm long"));
}

#[test]
fn tag_boards_are_detected_at_printed_positions() {
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
        let (pixels, width, height) = sheet_of(&board).raster(200).unwrap();
        let picture = Grey::from_bytes(width as usize, height as usize, &pixels);
        let found = TagFinder::new(&board).unwrap().find(&picture);
        assert_eq!(
            (found.tags, found.points.len()),
            (tags, board.point_count()),
            "{text}"
        );
        let dots = 200.0 / 0.0254;
        for c in found.points {
            let expected = (c.point + glam::DVec2::from(first)) * dots - 0.5;
            assert!(
                c.pixel.distance(expected) < 0.8,
                "{text} {} {expected}",
                c.pixel
            );
        }
    }
}
