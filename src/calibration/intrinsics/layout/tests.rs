use super::*;

/// Projects the tags of a board in perspective, according to their layout.
fn projected_tags(layout: Layout, ids: impl Iterator<Item = u32>, step: f64) -> Vec<DetectedTag> {
    let around = [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y];
    ids.map(|id| {
        let cell = layout.cell(id).unwrap().as_dvec2() * step;
        let corners = around.map(|c| {
            let p = cell + c;
            DVec2::new(100.0 + 40.0 * p.x + 5.0 * p.y, 80.0 + 38.0 * p.y) / (1.0 + 0.02 * p.x)
        });
        DetectedTag { id, corners }
    })
    .collect()
}

fn layout(board: &str) -> (Board, Layout) {
    let board = Board::parse(board).unwrap();
    (board, Layout::from_board(&board).unwrap())
}

#[test]
fn white_squares_are_counted_row_by_row() {
    let (_, eight) = layout("charuco:8x5:0.03:0.02");
    let (_, five) = layout("charuco:5x8:0.03:0.02");
    for layout in [eight, five, five.alternative().unwrap()] {
        let first = i32::from(!layout.white_first);
        let all = (0..layout.rows as i32)
            .flat_map(|y| (0..layout.columns as i32).map(move |x| IVec2::new(x, y)));
        let white = all.filter(|c| (c.x + c.y) % 2 == first);
        for (id, cell) in white.enumerate() {
            assert_eq!(layout.cell(id as u32), Some(cell), "{layout:?} {id}");
        }
    }
    assert_eq!(eight.alternative(), None);
    assert_eq!(eight.cell(20), None);
}

#[test]
fn given_board_is_distinguished_from_others() {
    let (board, given) = layout("aprilgrid:6x6:0.088:0.3");
    let fine = fit(&board, &projected_tags(given, 0..36, 1.3), given);
    assert!(!fine.is_inconsistent && fine.tags.len() == 36, "{fine:?}");
    let five = Layout {
        columns: 5,
        rows: 7,
        ..given
    };
    let other = fit(&board, &projected_tags(five, 0..35, 1.3), given);
    assert!(other.is_inconsistent);
    assert_eq!(other.other_columns, Some(5));
}

#[test]
fn older_charuco_layout_is_recognised_by_markers() {
    let (board, given) = layout("charuco:5x8:0.03:0.02:4x4_50");
    let older = given.alternative().unwrap();
    let found = fit(&board, &projected_tags(older, 3..9, 1.5), given);
    assert_eq!((found.layout, found.is_inconsistent), (older, false));
    // A single marker leaves the default layout.
    let one = fit(&board, &projected_tags(older, 3..4, 1.5), older);
    assert_eq!((one.layout, one.pairs), (older, 0));
    let wide = Layout {
        columns: 7,
        ..given
    };
    let other = fit(&board, &projected_tags(wide, 0..20, 1.5), given);
    assert_eq!(other.other_columns, Some(7));
}

#[test]
fn misread_and_foreign_tags_are_excluded() {
    let (board, given) = layout("aprilgrid:4x4:0.088:0.3");
    let mut tags = projected_tags(given, 0..16, 1.3);
    tags[5].id = 14;
    tags.push(DetectedTag {
        id: 400,
        corners: [DVec2::ZERO, DVec2::X, DVec2::ONE, DVec2::Y].map(|c| 30.0 * c + 1000.0),
    });
    let found = fit(&board, &tags, given);
    assert!(!found.is_inconsistent);
    let ids: Vec<u32> = found.tags.iter().map(|t| t.id).collect();
    assert_eq!(ids.len(), 15);
    assert!(!ids.contains(&5) && !ids.contains(&400));
    let fourteen = found.tags.iter().find(|t| t.id == 14).unwrap();
    assert_eq!(
        fourteen.corners,
        projected_tags(given, 14..15, 1.3)[0].corners
    );
}
