use super::*;
use crate::intrinsics::estimate::tests::{pinhole, poses, simulated_views};
use crate::intrinsics::synthetic::{BoardRenderer, pose};
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
    let renderer = BoardRenderer::new(&pinhole());
    let render =
        |&pose: &penumbra_interface::RigidTransform| renderer.render(&board, pose, 0.6, 1.0);
    poses(5, 0.45, 0.05, 8).iter().map(render).collect()
}

fn collected(board: &str, pictures: &[Grey]) -> ViewCollector {
    let mut collector = ViewCollector::new(Board::parse(board).unwrap());
    for (i, picture) in pictures.iter().enumerate() {
        collector.add_picture(&i.to_string(), picture);
    }
    collector
}

#[test]
fn board_of_wrong_size_is_reported_with_its_size() {
    let pictures = pictures();
    for wrong in ["chess:8x5:0.025", "chess:10x7:0.025", "chess:7x7:0.025"] {
        let outcome = collected(wrong, &pictures).finish(&OPTIONS);
        let other = Finding::OtherBoard {
            columns: 9,
            rows: 6,
        };
        assert_eq!(outcome.assessment.findings[0].1, other, "{wrong}");
        assert_eq!(outcome.assessment.grade, Grade::Refused);
    }
    let right = collected("chess:9x6:0.025", &pictures).finish(&OPTIONS);
    assert!(right.result.is_some(), "{:?}", right.assessment);
}

#[test]
fn repeated_view_counts_once() {
    let board = Board::parse("chess:9x6:0.025").unwrap();
    let at = pose(&board, DVec3::new(0.0, 0.0, 0.4), DVec2::new(0.3, 0.1), 0.0);
    let picture = BoardRenderer::new(&pinhole()).render(&board, at, 0.5, 1.0);
    let mut collector = ViewCollector::new(board);
    assert_eq!(
        collector.add_picture("1", &picture),
        PictureResult::Added { points: 54 }
    );
    assert_eq!(collector.add_picture("2", &picture), PictureResult::Similar);
    let small = Grey::from_bytes(320, 240, &[]);
    assert_eq!(collector.add_picture("3", &small), PictureResult::OtherSize);
    let grey = Grey::from_bytes(640, 480, &[]);
    assert_eq!(collector.add_picture("4", &grey), PictureResult::NotSeen);
    assert_eq!(
        (collector.views().len(), collector.size()),
        (1, Some((640, 480)))
    );
}

#[test]
fn no_board_is_refused() {
    let outcome = collected("chess:9x6:0.025", &[Grey::from_bytes(64, 64, &[])]).finish(&OPTIONS);
    let finding = &outcome.assessment.findings[0].1;
    assert_eq!(*finding, Finding::BoardNotSeen { pictures: 1 });
}

/// Corners near the picture's centre do not determine k3; the lens without it fits equally well and
/// stays invertible.
#[test]
fn undetermined_coefficient_is_omitted() {
    let ground_truth = {
        let mut lens = pinhole();
        lens.coefficients = [0.0; 8];
        lens.coefficients[0] = -0.15;
        lens
    };
    let mut random = Random::new(3);
    let (mut simpler, mut sound) = (0, 0);
    for seed in 0..8 {
        let views = simulated_views(
            &ground_truth,
            &poses(14, 0.6, 0.16, seed),
            0.15,
            &mut random,
        );
        let mut collector = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in views {
            collector.add_points("", (640, 480), view.points);
        }
        let outcome = collector.finish(&OPTIONS);
        let lens = &outcome.result.as_ref().unwrap().estimate.lens;
        simpler += usize::from(lens.coefficients[4] == 0.0);
        if outcome.assessment.grade < Grade::Refused {
            sound += 1;
            assert!(
                (lens.focal.x / ground_truth.focal.x - 1.0).abs() < 0.01,
                "{lens:?}"
            );
        }
    }
    assert!(simpler > 0 && sound > 0, "{simpler} {sound}");
}

#[test]
fn pictures_of_another_size_are_named() {
    let views = |seed| {
        let mut random = Random::new(seed);
        simulated_views(&pinhole(), &poses(20, 0.4, 0.2, seed), 0.1, &mut random)
    };
    let finish = |others: usize| {
        let mut collector = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap());
        for view in views(5) {
            collector.add_points("", (640, 480), view.points);
        }
        for view in views(6).into_iter().take(others) {
            collector.add_points("", (1280, 960), view.points);
        }
        collector.finish(&OPTIONS).assessment
    };
    let mixed = Finding::SizesMixed {
        other: 9,
        pictures: 29,
        width: 640,
        height: 480,
    };
    let some = finish(9);
    assert!(
        some.findings.contains(&(Grade::Usable, mixed)),
        "{:?}",
        some.findings
    );
    assert_eq!(
        finish(20).findings,
        [(Grade::Refused, Finding::SizesDiffer)]
    );
}
