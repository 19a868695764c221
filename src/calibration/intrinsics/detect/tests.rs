use super::*;
use crate::intrinsics::Board;
use crate::intrinsics::synthetic::{BoardRenderer, pose};
use glam::{DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_picture::Picture;
use std::path::PathBuf;

const BOARD: Board = Board::Chess {
    columns: 9,
    rows: 6,
    square: 0.025,
};

fn camera() -> Lens {
    let mut lens = Lens::ideal(
        LensModel::Brown,
        (640, 480),
        DVec2::new(535.0, 537.0),
        DVec2::new(328.0, 236.0),
    );
    lens.coefficients[..4].copy_from_slice(&[-0.27, 0.08, 0.001, -0.0005]);
    lens
}

fn fisheye() -> Lens {
    let mut lens = Lens::ideal(
        LensModel::KannalaBrandt,
        (600, 600),
        DVec2::splat(165.0),
        DVec2::new(302.0, 297.0),
    );
    lens.coefficients[..4].copy_from_slice(&[0.003, 0.001, -0.002, 0.0002]);
    lens
}

/// Returns the maximum and root-mean-square error of the corners found, pixels.
fn errors(
    lens: &Lens,
    found: &ChessboardDetection,
    pose: penumbra_interface::RigidTransform,
) -> (f64, f64) {
    let all: Vec<f64> = found
        .correspondences(0.025)
        .iter()
        .map(|c| {
            let expected = lens
                .project(pose.transform_point(c.point.extend(0.0)))
                .unwrap();
            expected.distance(c.pixel)
        })
        .collect();
    let rms = (all.iter().map(|e| e * e).sum::<f64>() / all.len() as f64).sqrt();
    (all.iter().fold(0.0, |a: f64, &b| a.max(b)), rms)
}

#[test]
fn complete_board_is_accurate_to_hundredths_of_a_pixel() {
    let lens = camera();
    let renderer = BoardRenderer::new(&lens);
    for (centre, tilt, roll, blur, noise, max_rms) in [
        (DVec3::new(0.0, 0.0, 0.4), DVec2::ZERO, 0.0, 0.5, 0.0, 0.03),
        (
            DVec3::new(0.02, 0.01, 0.45),
            DVec2::new(0.5, 0.0),
            0.3,
            0.6,
            2.0,
            0.05,
        ),
        (
            DVec3::new(-0.03, 0.0, 0.5),
            DVec2::new(-0.3, 0.7),
            1.9,
            0.6,
            2.0,
            0.05,
        ),
        (
            DVec3::new(0.0, 0.02, 0.5),
            DVec2::new(0.2, -0.5),
            3.0,
            2.0,
            3.0,
            0.07,
        ),
        (
            DVec3::new(0.0, 0.02, 0.9),
            DVec2::new(0.2, -0.5),
            3.0,
            0.8,
            6.0,
            0.1,
        ),
        (
            DVec3::new(0.1, 0.05, 1.2),
            DVec2::new(0.2, -0.3),
            0.1,
            0.5,
            2.0,
            0.06,
        ),
    ] {
        let pose = pose(&BOARD, centre, tilt, roll);
        let picture = renderer.render(&BOARD, pose, blur, noise);
        let found = find_chessboard(&picture, 9, 6).unwrap();
        assert_eq!(found.placement, Placement::Known);
        assert_eq!(found.corners.len(), 54);
        let (worst, rms) = errors(&lens, &found, pose);
        assert!(
            rms < max_rms && worst < 4.0 * max_rms,
            "{centre} {roll}: {rms} {worst}"
        );
    }
}

#[test]
fn finds_board_through_fisheye_beyond_ninety_degrees() {
    let lens = fisheye();
    let renderer = BoardRenderer::new(&lens);
    for (centre, tilt) in [
        (DVec3::new(0.0, 0.0, 0.12), DVec2::ZERO),
        (DVec3::new(0.15, 0.0, 0.1), DVec2::new(0.0, 1.1)),
        (DVec3::new(-0.05, -0.14, 0.02), DVec2::new(1.3, 0.0)),
    ] {
        let pose = pose(&BOARD, centre, tilt, 0.0);
        let picture = renderer.render(&BOARD, pose, 0.5, 1.0);
        let found = find_chessboard(&picture, 9, 6).unwrap();
        assert_eq!(found.corners.len(), 54, "{centre}");
        let (worst, rms) = errors(&lens, &found, pose);
        assert!(rms < 0.06 && worst < 0.2, "{centre}: {rms} {worst}");
    }
}

#[test]
fn partly_visible_board_is_reported_as_part() {
    let lens = camera();
    let renderer = BoardRenderer::new(&lens);
    let pose = pose(
        &BOARD,
        DVec3::new(0.13, 0.08, 0.3),
        DVec2::new(0.1, 0.3),
        0.2,
    );
    let picture = renderer.render(&BOARD, pose, 0.5, 1.0);
    let found = find_chessboard(&picture, 9, 6).unwrap();
    assert_eq!(found.placement, Placement::Unknown);
    let count = found.corners.len();
    assert!((12..54).contains(&count), "{count}");
    // The corners are in order nevertheless: some translation of the board explains them.
    let shifts = (0..9).flat_map(|i| (0..6).map(move |j| (i, j)));
    let best = shifts
        .map(|(i, j)| {
            let shift = DVec2::new(f64::from(i), f64::from(j)) * 0.025;
            let error = |c: &crate::intrinsics::Correspondence| {
                let expected = pose.transform_point((c.point + shift).extend(0.0));
                lens.project(expected).map_or(1e9, |p| p.distance(c.pixel))
            };
            found
                .correspondences(0.025)
                .iter()
                .map(error)
                .fold(0.0, f64::max)
        })
        .fold(f64::MAX, f64::min);
    assert!(best < 0.2, "{best}");
}

#[test]
fn larger_board_is_reported_with_its_size() {
    let renderer = BoardRenderer::new(&camera());
    let pose = pose(&BOARD, DVec3::new(0.0, 0.0, 0.4), DVec2::new(0.2, 0.1), 0.0);
    let picture = renderer.render(&BOARD, pose, 0.5, 1.0);
    let larger = NoChessboard::Larger {
        columns: 9,
        rows: 6,
    };
    assert_eq!(find_chessboard(&picture, 8, 5), Err(larger));
    assert_eq!(find_chessboard(&picture, 7, 7), Err(larger));
    let smaller = find_chessboard(&picture, 10, 7).unwrap();
    assert_eq!(smaller.placement, Placement::Unknown);
    assert_eq!(smaller.extent, (9, 6));
}

#[test]
fn pictures_without_board_give_no_chessboard() {
    let mut random = penumbra_numerics::Random::new(7);
    let mut noise = Grey::from_bytes(320, 240, &[]);
    noise
        .data
        .iter_mut()
        .for_each(|v| *v = (128.0 + 40.0 * random.normal()) as f32);
    assert_eq!(find_chessboard(&noise, 9, 6), Err(NoChessboard::NotSeen));
    for size in [(0, 0), (1, 1), (15, 400), (64, 64)] {
        let flat = Grey::from_bytes(size.0, size.1, &[]);
        assert_eq!(find_chessboard(&flat, 9, 6), Err(NoChessboard::NotSeen));
    }
}

/// Returns the folder of the photographs; `None` if it is missing.
fn photographs() -> Option<PathBuf> {
    penumbra_test_data::shared("data/calibration/opencv_stereo_chess")
}

#[test]
fn finds_54_corners_in_every_opencv_photograph() {
    let Some(folder) = photographs() else {
        return;
    };
    for side in ["left", "right"] {
        for n in (1..=14).filter(|n| *n != 10) {
            let bytes = std::fs::read(folder.join(format!("{side}{n:02}.jpg"))).unwrap();
            let grey = Grey::from_picture(&Picture::from_file_bytes(&bytes).unwrap());
            let found = find_chessboard(&grey, 9, 6).unwrap();
            assert_eq!(found.corners.len(), 54, "{side}{n:02}");
            assert_eq!(found.placement, Placement::Known, "{side}{n:02}");
        }
    }
}
