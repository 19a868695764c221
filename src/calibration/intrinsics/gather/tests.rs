#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use crate::intrinsics::drawn::{BoardRenderer, pose};
use crate::intrinsics::estimate::tests::{pinhole, poses, seen};
use glam::DVec3;
use penumbra_camera::LensModel;
use penumbra_numerics::Random;
use penumbra_rig_model::Grade;

const OPTIONS: Options = Options {
    model: LensModel::Brown,
    square_pixels: false,
};

fn pictures() -> Vec<Grey> {
    let board = Board::parse("chess:9x6:0.025").unwrap();
    let draughtsman = BoardRenderer::new(&pinhole());
    let draw =
        |&pose: &penumbra_interface::RigidTransform| draughtsman.draw(&board, pose, 0.6, 1.0);
    poses(5, 0.45, 0.05, 8).iter().map(draw).collect()
}

fn gathered(board: &str, pictures: &[Grey]) -> Gatherer {
    let mut gatherer = Gatherer::new(Board::parse(board).unwrap());
    for (i, picture) in pictures.iter().enumerate() {
        gatherer.offer(&i.to_string(), picture);
    }
    gatherer
}

#[test]
fn board_of_wrong_size_is_reported_with_its_size() {
    let pictures = pictures();
    for wrong in ["chess:8x5:0.025", "chess:10x7:0.025", "chess:7x7:0.025"] {
        let outcome = gathered(wrong, &pictures).finish(&OPTIONS);
        let other = Finding::OtherBoard {
            columns: 9,
            rows: 6,
        };
        assert_eq!(outcome.verdict.findings[0].1, other, "{wrong}");
        assert_eq!(outcome.verdict.grade, Grade::Refused);
    }
    let right = gathered("chess:9x6:0.025", &pictures).finish(&OPTIONS);
    assert!(right.result.is_some(), "{:?}", right.verdict);
}

#[test]
fn repeated_view_counts_once() {
    let board = Board::parse("chess:9x6:0.025").unwrap();
    let at = pose(&board, DVec3::new(0.0, 0.0, 0.4), DVec2::new(0.3, 0.1), 0.0);
    let picture = BoardRenderer::new(&pinhole()).draw(&board, at, 0.5, 1.0);
    let mut gatherer = Gatherer::new(board);
    assert_eq!(gatherer.offer("1", &picture), Offer::Taken { points: 54 });
    assert_eq!(gatherer.offer("2", &picture), Offer::Alike);
    let small = Grey::from_bytes(320, 240, &[]);
    assert_eq!(gatherer.offer("3", &small), Offer::OtherSize);
    let grey = Grey::from_bytes(640, 480, &[]);
    assert_eq!(gatherer.offer("4", &grey), Offer::NotSeen);
    assert_eq!(
        (gatherer.views().len(), gatherer.size()),
        (1, Some((640, 480)))
    );
}

#[test]
fn no_board_is_refused() {
    let outcome = gathered("chess:9x6:0.025", &[Grey::from_bytes(64, 64, &[])]).finish(&OPTIONS);
    let finding = &outcome.verdict.findings[0].1;
    assert_eq!(*finding, Finding::BoardNotSeen { pictures: 1 });
}

/// Corners near the picture's middle leave k3 open; the lens without it is as good there, and
/// folds nothing over.
#[test]
fn undetermined_coefficient_is_omitted() {
    let truth = {
        let mut lens = pinhole();
        lens.coefficients = [0.0; 8];
        lens.coefficients[0] = -0.15;
        lens
    };
    let mut random = Random::new(3);
    let (mut simpler, mut sound) = (0, 0);
    for seed in 0..8 {
        let views = seen(&truth, &poses(14, 0.6, 0.16, seed), 0.15, &mut random);
        let mut gatherer = Gatherer::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in views {
            gatherer.offer_points("", (640, 480), view.points);
        }
        let outcome = gatherer.finish(&OPTIONS);
        let lens = &outcome.result.as_ref().unwrap().estimate.lens;
        simpler += usize::from(lens.coefficients[4] == 0.0);
        if outcome.verdict.grade < Grade::Refused {
            sound += 1;
            assert!(
                (lens.focal.x / truth.focal.x - 1.0).abs() < 0.01,
                "{lens:?}"
            );
        }
    }
    assert!(simpler > 0 && sound > 0, "{simpler} {sound}");
}
