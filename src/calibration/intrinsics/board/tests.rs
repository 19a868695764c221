use super::*;

#[test]
fn written_board_parses_back_unchanged() {
    for text in [
        "chess:9x6:0.025",
        "aprilgrid:6x6:0.088:0.3",
        "charuco:8x5:0.03:0.022:4x4_50",
        "charuco:8x5:0.03:0.022:aruco_original",
        "aprilgrid:6x6:0.088:0.3:tag36h11",
    ] {
        assert_eq!(Board::parse(text).unwrap().to_string(), text);
    }
    assert_eq!(Board::parse("chess:9x6:0.025").unwrap().point_count(), 54);
    let charuco = Board::parse("charuco:8x5:0.03:0.022:DICT_6X6_250").unwrap();
    assert_eq!((charuco.point_count(), charuco.tag_count()), (28, 20));
    assert_eq!(charuco.family(), Some(Family::Aruco6x6(250)));
    let default = Board::parse("charuco:14x9:0.03:0.022").unwrap();
    assert_eq!(default.family(), Some(Family::Aruco4x4(100)));
}

#[test]
fn invalid_board_gives_one_line_error() {
    for (text, message) in [
        ("", "write chess:"),
        ("chess", "write chess:"),
        ("chess:9x6", "write chess:"),
        ("chess:9by6:0.02", "write chess:"),
        ("chess:9x6:25", "metres"),
        ("chess:9x6:-0.1", "metres"),
        ("chess:9x6:nan", "metres"),
        ("chess:1x6:0.02", "3 to 100"),
        ("chess:9x4000000000:0.02", "3 to 100"),
        ("aprilgrid:6x6:0.088:3", "gap"),
        ("charuco:6x6:0.03:0.03", "marker"),
        ("charuco:8x5:0.03:0.022:4x4_51", "4x4_50 (100"),
        ("charuco:12x12:0.03:0.022:4x4_50", "more tags"),
        ("aprilgrid:30x30:0.088:0.3", "more tags"),
        ("chess:9x6:0.02:0.03:4x4_50", "write chess:"),
        ("circles:6x6:0.03", "write chess:"),
    ] {
        let error = Board::parse(text).unwrap_err().to_string();
        assert!(error.contains(message) && !error.contains('\n'), "{error}");
    }
}
