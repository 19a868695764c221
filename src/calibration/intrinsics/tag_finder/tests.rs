use super::*;
use crate::intrinsics::estimate::tests::{fisheye, pinhole, poses_of};
use crate::intrinsics::synthetic::{BoardRenderer, pose};
use crate::intrinsics::{Finding, Options, PictureResult, ViewCollector};
use glam::DVec3;
use penumbra_camera::{Lens, LensModel};
use penumbra_interface::RigidTransform;
use penumbra_rig_model::Grade;

fn board(text: &str) -> Board {
    Board::parse(text).unwrap()
}

/// Returns the root-mean-square and maximum error of the points found, pixels.
fn errors(lens: &Lens, pose: RigidTransform, points: &[Correspondence]) -> (f64, f64) {
    let error = |c: &Correspondence| {
        let expected = lens
            .project(pose.transform_point(c.point.extend(0.0)))
            .unwrap();
        expected.distance(c.pixel)
    };
    let squares: f64 = points.iter().map(|c| error(c).powi(2)).sum();
    let worst = points.iter().map(error).fold(0.0, f64::max);
    ((squares / points.len() as f64).sqrt(), worst)
}

#[test]
fn finds_april_grid_through_fisheye() {
    let lens = fisheye();
    let grid = board("aprilgrid:6x6:0.03:0.3");
    let renderer = BoardRenderer::new(&lens);
    for (centre, tilt) in [
        (DVec3::new(0.0, 0.0, 0.14), DVec2::new(0.2, -0.1)),
        (DVec3::new(0.13, 0.02, 0.1), DVec2::new(0.1, 0.9)),
    ] {
        let at = pose(&grid, centre, tilt, 0.3);
        let picture = renderer.render(&grid, at, 0.6, 1.5);
        let found = TagFinder::new(&grid).unwrap().find(&picture);
        let (rms, worst) = errors(&lens, at, &found.points);
        let each = found.points.iter().map(|c| errors(&lens, at, &[*c]).0);
        let middle = penumbra_numerics::median(each).unwrap();
        println!(
            "{} tags, {} corners: {middle} {rms} {worst}",
            found.tags,
            found.points.len()
        );
        assert!(found.tags >= 34 && found.points.len() >= 110, "{found:?}");
        // The outermost tags, 80° from the axis, are foreshortened to a few pixels.
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
    let mut picture = BoardRenderer::new(&lens).render(&charuco, at, 0.6, 1.5);
    let mut finder = TagFinder::new(&charuco).unwrap();
    let complete = finder.find(&picture);
    let (rms, worst) = errors(&lens, at, &complete.points);
    assert_eq!((complete.tags, complete.points.len()), (24, 35));
    assert!(rms < 0.06 && worst < 0.2, "{rms} {worst}");
    // Occludes part of the board.
    for y in 0..300 {
        picture.data[y * 640 + 330..y * 640 + 640].fill(120.0);
    }
    let partial = finder.find(&picture);
    assert!(
        (12..30).contains(&partial.points.len()),
        "{}",
        partial.points.len()
    );
    // Corners at the edge of the occlusion are rejected.
    let (_, worst) = errors(&lens, at, &partial.points);
    assert!(worst < 0.2, "{worst}");
}

fn outcome(rendered: &str, given: &str) -> (Grade, Finding) {
    let (lens, rendered) = (pinhole(), board(rendered));
    let renderer = BoardRenderer::new(&lens);
    let mut collector = ViewCollector::new(board(given));
    for pose in poses_of(&rendered, 4, (0.45, 0.1), 3) {
        let add_picture = collector.add_picture("", &renderer.render(&rendered, pose, 0.6, 1.0));
        assert_eq!(add_picture, PictureResult::OtherBoard);
    }
    let options = Options {
        model: LensModel::Brown,
        square_pixels: true,
    };
    let assessment = collector.finish(&options).assessment;
    (assessment.grade, assessment.findings[0].1.clone())
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
            .contains("of the family 6x6_1000, not 4x4_50"),
        "{finding}"
    );
    let (_, finding) = outcome("aprilgrid:5x4:0.03:0.3", "aprilgrid:5x4:0.03:0.3:4x4_50");
    assert!(
        finding.to_string().contains("of the family kalibr36h11"),
        "{finding}"
    );
    let (grade, finding) = outcome("charuco:7x5:0.03:0.022", "charuco:6x5:0.03:0.022");
    assert_eq!(grade, Grade::Refused);
    assert!(
        finding.to_string().contains("but has 7 columns"),
        "{finding}"
    );
    let (_, finding) = outcome("aprilgrid:5x4:0.03:0.3", "aprilgrid:6x4:0.03:0.3");
    assert!(
        finding.to_string().contains("but has 5 columns"),
        "{finding}"
    );
}

#[test]
fn board_with_more_rows_is_used_with_a_finding() {
    let rendered = board("charuco:7x6:0.03:0.022");
    let renderer = BoardRenderer::new(&pinhole());
    let mut collector = ViewCollector::new(board("charuco:7x5:0.03:0.022"));
    for pose in poses_of(&rendered, 6, (0.45, 0.1), 3) {
        collector.add_picture("", &renderer.render(&rendered, pose, 0.6, 1.0));
    }
    let options = Options {
        model: LensModel::Brown,
        square_pixels: true,
    };
    let assessment = collector.finish(&options).assessment;
    let mut findings = assessment.findings.iter().map(|f| f.1.to_string());
    assert!(findings.any(|f| f.contains("more rows")), "{assessment:?}");
}
