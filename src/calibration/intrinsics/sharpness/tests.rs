use super::*;
use crate::intrinsics::synthetic::BoardRenderer;
use crate::intrinsics::view_collector::ViewCollector;
use glam::{DQuat, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_interface::RigidTransform;

/// Views of a board through a lens, filtered by `spread`, in linear codes.
fn measured(board: &str, spread: PointSpread, noise: f64) -> Sharpness {
    let board = Board::parse(board).unwrap();
    let focal = DVec2::splat(620.0);
    let lens = Lens::ideal(
        LensModel::Brown,
        (640, 480),
        focal,
        DVec2::new(320.2, 238.9),
    );
    let renderer = BoardRenderer::new(&lens);
    let mut collector = ViewCollector::new(board);
    let mut gatherer = SharpnessGatherer::default();
    for i in 0..4 {
        let i = f64::from(i);
        let tilt = DQuat::from_euler(glam::EulerRot::XYZ, 0.2 - 0.1 * i, 0.1 * i, 0.07 + 0.03 * i);
        let corner = DVec3::new(-0.1, -0.07, 0.36 + 0.02 * i);
        let pose = RigidTransform::new(tilt, corner);
        let mut picture = renderer.render(&board, pose, 0.0, 0.0);
        spread_by(&mut picture, spread);
        let mut random = penumbra_numerics::Random::new(i as u64);
        for value in &mut picture.data {
            let noisy = f64::from(*value) + noise * random.normal();
            *value = noisy.round().clamp(0.0, 255.0) as f32;
        }
        collector.add_picture("view", &picture);
        let points = &collector.views().last().unwrap().points;
        gatherer.add(&picture, points, &board, &Response::linear());
    }
    gatherer.finish().unwrap()
}

fn spread_by(picture: &mut Grey, spread: PointSpread) {
    for (weights, (dx, dy)) in [(spread.across, (1, 0)), (spread.down, (0, 1))] {
        let before = picture.clone();
        for y in 0..picture.height as isize {
            for x in 0..picture.width as isize {
                let pair = |k: isize| {
                    before.at(x + k * dx, y + k * dy) + before.at(x - k * dx, y - k * dy)
                };
                let [a, b, c] = weights.map(|w| w as f32);
                let value = a * before.at(x, y) + b * pair(1) + c * pair(2);
                picture.data[y as usize * picture.width + x as usize] = value;
            }
        }
    }
}

#[test]
fn recovers_the_spread_of_a_camera() {
    let soft = PointSpread {
        across: [0.46, 0.24, 0.03],
        down: [0.6, 0.19, 0.01],
    };
    let sharpened = PointSpread {
        across: [0.9, 0.12, -0.07],
        down: [0.9, 0.12, -0.07],
    };
    for (spread, noise) in [(PointSpread::NONE, 0.0), (soft, 1.0), (sharpened, 1.0)] {
        let found = measured("chess:7x5:0.03", spread, noise);
        assert!(found.edges > 10, "{found:?}");
        for frequency in [0.1, 0.2, 0.3, 0.4, 0.5] {
            let pairs = [
                (found.spread.across, spread.across),
                (found.spread.down, spread.down),
            ];
            for (found, wanted) in pairs {
                let found = PointSpread::mtf(&found, frequency);
                let wanted = PointSpread::mtf(&wanted, frequency);
                assert!(
                    (found - wanted).abs() < 0.05,
                    "{spread:?} {frequency}: {found} {wanted}"
                );
            }
        }
    }
}

#[test]
fn sharpest_views_count() {
    let board = Board::parse("chess:7x5:0.03").unwrap();
    let focal = DVec2::splat(620.0);
    let lens = Lens::ideal(
        LensModel::Brown,
        (640, 480),
        focal,
        DVec2::new(320.2, 238.9),
    );
    let renderer = BoardRenderer::new(&lens);
    let mut collector = ViewCollector::new(board);
    let mut gatherer = SharpnessGatherer::default();
    for (i, blur) in [0.8, 0.0, 1.5].into_iter().enumerate() {
        let turn = DQuat::from_rotation_z(0.05 + 0.05 * i as f64);
        let pose = RigidTransform::new(turn, DVec3::new(-0.1, -0.07, 0.36 + 0.03 * i as f64));
        let picture = renderer.render(&board, pose, blur, 0.3);
        collector.add_picture("view", &picture);
        let points = &collector.views().last().unwrap().points;
        gatherer.add(&picture, points, &board, &Response::linear());
    }
    let found = gatherer.finish().unwrap();
    assert_eq!(found.views[0], 1);
    assert!(found.spread.across[0] > 0.85, "{found:?}");
}

#[test]
fn picture_without_large_edges_has_no_sharpness() {
    let board = Board::parse("chess:7x5:0.03").unwrap();
    let mut gatherer = SharpnessGatherer::default();
    let picture = Grey::from_bytes(64, 48, &[]);
    gatherer.add(&picture, &[], &board, &Response::srgb());
    assert_eq!(gatherer.finish(), None);
}
