#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use crate::intrinsics::drawn::{BoardRenderer, pose};
use crate::intrinsics::estimate::tests::{fisheye, pinhole, poses_of};
use crate::intrinsics::{Finding, Gatherer, Offer, Options};
use glam::DVec3;
use penumbra_camera::{Lens, LensModel};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Grade;

fn board(text: &str) -> Board {
    Board::parse(text).unwrap()
}

/// Root mean square distance of what was found from where it is, and the worst, pixels.
fn off(lens: &Lens, pose: RigidTransform, points: &[Correspondence]) -> (f64, f64) {
    let off = |c: &Correspondence| {
        let there = lens
            .project(pose.transform_point(c.point.extend(0.0)))
            .unwrap();
        there.distance(c.pixel)
    };
    let squares: f64 = points.iter().map(|c| off(c).powi(2)).sum();
    let worst = points.iter().map(off).fold(0.0, f64::max);
    ((squares / points.len() as f64).sqrt(), worst)
}

#[test]
fn an_april_grid_is_found_through_a_fisheye() {
    let lens = fisheye();
    let grid = board("aprilgrid:6x6:0.03:0.3");
    let draughtsman = BoardRenderer::new(&lens);
    for (centre, tilt) in [
        (DVec3::new(0.0, 0.0, 0.14), DVec2::new(0.2, -0.1)),
        (DVec3::new(0.13, 0.02, 0.1), DVec2::new(0.1, 0.9)),
    ] {
        let at = pose(&grid, centre, tilt, 0.3);
        let picture = draughtsman.draw(&grid, at, 0.6, 1.5);
        let seen = TagFinder::new(&grid).unwrap().find(&picture);
        let (rms, worst) = off(&lens, at, &seen.points);
        let each = seen.points.iter().map(|c| off(&lens, at, &[*c]).0);
        let middle = penumbra_numerics::median(each).unwrap();
        println!(
            "{} tags, {} corners: {middle} {rms} {worst}",
            seen.tags,
            seen.points.len()
        );
        assert!(seen.tags >= 34 && seen.points.len() >= 110, "{seen:?}");
        // The outermost, at 80° from the axis, are slanted to a few pixels.
        assert!(rms < 0.1 && worst < 0.5, "{middle} {rms} {worst}");
    }
}

#[test]
fn finds_visible_part_of_charuco_board() {
    let (lens, charuco) = (pinhole(), board("charuco:8x6:0.03:0.022:6x6_250"));
    let at = pose(
        &charuco,
        DVec3::new(0.0, 0.0, 0.4),
        DVec2::new(0.3, -0.4),
        0.2,
    );
    let mut picture = BoardRenderer::new(&lens).draw(&charuco, at, 0.6, 1.5);
    let mut finder = TagFinder::new(&charuco).unwrap();
    let whole = finder.find(&picture);
    let (rms, worst) = off(&lens, at, &whole.points);
    assert_eq!((whole.tags, whole.points.len()), (24, 35));
    assert!(rms < 0.06 && worst < 0.2, "{rms} {worst}");
    // A hand before it.
    for y in 0..300 {
        picture.data[y * 640 + 330..y * 640 + 640].fill(120.0);
    }
    let rest = finder.find(&picture);
    assert!(
        (12..30).contains(&rest.points.len()),
        "{}",
        rest.points.len()
    );
    // Those that its edge touches are not taken.
    let (_, worst) = off(&lens, at, &rest.points);
    assert!(worst < 0.2, "{worst}");
}

fn outcome(drawn: &str, said: &str) -> (Grade, Finding) {
    let (lens, drawn) = (pinhole(), board(drawn));
    let draughtsman = BoardRenderer::new(&lens);
    let mut gatherer = Gatherer::new(board(said));
    for pose in poses_of(&drawn, 4, (0.45, 0.1), 3) {
        let offer = gatherer.offer("", &draughtsman.draw(&drawn, pose, 0.6, 1.0));
        assert_eq!(offer, Offer::OtherBoard);
    }
    let options = Options {
        model: LensModel::Brown,
        square_pixels: true,
    };
    let verdict = gatherer.finish(&options).verdict;
    (verdict.grade, verdict.findings[0].1.clone())
}

#[test]
fn other_dictionary_and_other_layout_are_reported() {
    let (grade, finding) = outcome(
        "charuco:7x5:0.03:0.022:6x6_250",
        "charuco:7x5:0.03:0.022:4x4_50",
    );
    assert_eq!(grade, Grade::Refused);
    assert!(
        finding
            .to_string()
            .contains("of 6x6_1000, the board was said to be of 4x4_50"),
        "{finding}"
    );
    let (_, finding) = outcome("aprilgrid:5x4:0.03:0.3", "aprilgrid:5x4:0.03:0.3:4x4_50");
    assert!(finding.to_string().contains("of kalibr36h11"), "{finding}");
    let (grade, finding) = outcome("charuco:7x5:0.03:0.022", "charuco:6x5:0.03:0.022");
    assert_eq!(grade, Grade::Refused);
    assert!(
        finding.to_string().contains("as on one with 7 in a row"),
        "{finding}"
    );
    let (_, finding) = outcome("aprilgrid:5x4:0.03:0.3", "aprilgrid:6x4:0.03:0.3");
    assert!(
        finding.to_string().contains("as on one with 5 in a row"),
        "{finding}"
    );
}

#[test]
fn a_board_with_more_rows_is_used_and_the_doubt_told() {
    let drawn = board("charuco:7x6:0.03:0.022");
    let draughtsman = BoardRenderer::new(&pinhole());
    let mut gatherer = Gatherer::new(board("charuco:7x5:0.03:0.022"));
    for pose in poses_of(&drawn, 6, (0.45, 0.1), 3) {
        gatherer.offer("", &draughtsman.draw(&drawn, pose, 0.6, 1.0));
    }
    let options = Options {
        model: LensModel::Brown,
        square_pixels: true,
    };
    let verdict = gatherer.finish(&options).verdict;
    let mut told = verdict.findings.iter().map(|f| f.1.to_string());
    assert!(told.any(|f| f.contains("more rows")), "{verdict:?}");
}
