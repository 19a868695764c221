#![allow(clippy::unwrap_used, clippy::panic)]
use super::*;
use crate::intrinsics::coverage::cell_middle;
use crate::intrinsics::drawn::pose;
use crate::intrinsics::estimate::tests::{fisheye, pinhole, poses, seen};
use crate::intrinsics::{Board, Light, NoEstimate, Options, View, estimate};
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_numerics::Random;
use penumbra_numerics::{NormalEquations, minimise};
use penumbra_rig_model::Grade;

const BOARD: Board = Board::Chess {
    columns: 9,
    rows: 6,
    square: 0.025,
};

fn judged(lens: &Lens, views: &[View]) -> Result<(Estimate, Verdict), NoEstimate> {
    let options = Options {
        model: lens.model,
        square_pixels: false,
    };
    let found = estimate((lens.width, lens.height), views, &options)?;
    let coverage = Coverage::of(&found.lens, &found.views, &Light::default());
    let uncertainty = Uncertainty::of(&found);
    let verdict = Verdict::of(&found, &coverage, &Tilt::of(&found.views), &uncertainty);
    Ok((found, verdict))
}

fn has(verdict: &Verdict, kind: fn(&Finding) -> bool) -> bool {
    verdict.findings.iter().any(|f| kind(&f.1))
}

#[test]
fn views_from_all_sides_are_good_with_correct_uncertainty() {
    let mut random = Random::new(11);
    for (lens, distance, spread) in [(pinhole(), 0.4, 0.4), (fisheye(), 0.12, 0.9)] {
        let views = seen(&lens, &poses(40, distance, spread, 5), 0.15, &mut random);
        let (found, verdict) = judged(&lens, &views).unwrap();
        assert_eq!(verdict.grade, Grade::Good, "{:?}", verdict.findings);
        let said = Uncertainty::of(&found);
        assert!(said.worst < 1.0 && said.median < 0.2, "{said:?}");
        // The projection is as near to the truth as that, but for a turn of the camera.
        let errors = errors_but_for_a_turn(&lens, &found.lens);
        for (error, said) in errors.iter().zip(&said.by_cell) {
            if let (Some(error), Some(said)) = (error, said) {
                assert!(*error < 5.0 * said, "{error} {said}");
            }
        }
    }
}

/// By cell, how far the found lens is from the truth, pixels.
fn errors_but_for_a_turn(truth: &Lens, found: &Lens) -> Vec<Option<f64>> {
    let error = |turn: DQuat, cell: usize| {
        let ray = truth.unproject(cell_middle(truth, cell))?;
        let p = found.project_with_derivatives(turn * ray)?;
        Some((p, turn * ray, cell_middle(truth, cell)))
    };
    let radius = 0.45 * f64::from(truth.height);
    let near = |&cell: &usize| cell_middle(truth, cell).distance(truth.centre) < radius;
    let turn = minimise(
        DQuat::IDENTITY,
        20,
        |&turn| {
            let mut normal = NormalEquations::new(3);
            for cell in (0..48).filter(near) {
                let (p, ray, seen) = error(turn, cell)?;
                let by = crate::intrinsics::pose::by_pose(&p.by_point, ray);
                for axis in 0..2 {
                    let row: Vec<f64> = by[..3].iter().map(|d| d[axis]).collect();
                    normal.add((p.pixel - seen)[axis], &row, 1.0);
                }
            }
            Some(normal)
        },
        |turn, step| DQuat::from_scaled_axis(DVec3::from_slice(step)) * *turn,
    );
    let turn = turn.unwrap().state;
    (0..48)
        .map(|cell| error(turn, cell).map(|(p, _, seen)| p.pixel.distance(seen)))
        .collect()
}

#[test]
fn a_board_that_is_never_tilted_is_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let flat: Vec<_> = (0..20)
        .map(|i| {
            let x = f64::from(i % 5) * 0.04 - 0.08;
            let y = f64::from(i / 5) * 0.04 - 0.06;
            pose(&BOARD, DVec3::new(x, y, 0.4), DVec2::ZERO, 0.0)
        })
        .collect();
    match judged(&lens, &seen(&lens, &flat, 0.1, &mut random)) {
        Err(e) => assert_eq!(e, NoEstimate::Undetermined),
        Ok((_, verdict)) => assert_eq!(verdict.grade, Grade::Refused, "{verdict:?}"),
    }
}

#[test]
fn too_few_views_are_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    for count in 0..3 {
        let views = seen(&lens, &poses(count, 0.4, 0.2, 5), 0.1, &mut random);
        let error = judged(&lens, &views).unwrap_err();
        assert_eq!(error, NoEstimate::TooFewViews { usable: count });
    }
    let views = seen(&lens, &poses(4, 0.4, 0.1, 5), 0.1, &mut random);
    let (_, verdict) = judged(&lens, &views).unwrap();
    assert!(
        verdict.grade > Grade::Good && has(&verdict, |f| matches!(f, Finding::FewViews { .. }))
    );
}

#[test]
fn views_in_one_corner_only_are_not_called_good() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let corner: Vec<_> = poses(20, 0.9, 0.1, 5)
        .into_iter()
        .map(|mut p| {
            p.translation += DVec3::new(-0.3, -0.2, 0.0);
            p
        })
        .collect();
    let (_, verdict) = judged(&lens, &seen(&lens, &corner, 0.15, &mut random)).unwrap();
    assert!(verdict.grade > Grade::Good);
    assert!(
        has(&verdict, |f| matches!(f, Finding::PoorCoverage { .. })),
        "{verdict:?}"
    );
    assert!(
        verdict.hints.iter().any(|h| h.starts_with("cover the ")),
        "{:?}",
        verdict.hints
    );
}

#[test]
fn a_wrong_number_of_squares_is_not_called_good() {
    // Columns that are counted where there is a row: the points lie on a skewed lattice.
    let mut random = Random::new(1);
    let lens = pinhole();
    let mut views = seen(&lens, &poses(20, 0.4, 0.1, 5), 0.1, &mut random);
    for view in &mut views {
        for (i, c) in view.points.iter_mut().enumerate() {
            c.point = DVec2::new((i % 8) as f64, (i / 8) as f64) * 0.025;
        }
    }
    if let Ok((_, verdict)) = judged(&lens, &views) {
        assert_eq!(verdict.grade, Grade::Refused, "{verdict:?}");
    }
}

#[test]
fn views_of_another_camera_are_told_apart_or_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let mut other = pinhole();
    other.focal *= 1.6;
    other.coefficients = [0.0; 8];
    let mixed = |count: usize, random: &mut Random| {
        let mut views = seen(&lens, &poses(20, 0.4, 0.2, 5), 0.1, random);
        views.extend(seen(&other, &poses(count, 0.6, 0.1, 6), 0.1, random));
        views
    };
    let (found, verdict) = judged(&lens, &mixed(3, &mut random)).unwrap();
    assert!(
        (found.lens.focal.x / lens.focal.x - 1.0).abs() < 0.005,
        "{:?}",
        found.lens
    );
    assert!(verdict.grade < Grade::Refused, "{verdict:?}");
    assert!(found.views[20..].iter().all(|v| !v.used));
    // Half and half nobody can tell which is meant.
    if let Ok((_, verdict)) = judged(&lens, &mixed(20, &mut random)) {
        assert!(verdict.grade > Grade::Good, "{verdict:?}");
    }
}

#[test]
fn outliers_among_the_corners_do_no_harm() {
    let mut random = Random::new(9);
    for (lens, distance, spread) in [(pinhole(), 0.4, 0.4), (fisheye(), 0.12, 0.9)] {
        let mut views = seen(&lens, &poses(40, distance, spread, 5), 0.15, &mut random);
        for view in &mut views {
            for c in view.points.iter_mut().step_by(17) {
                c.pixel += DVec2::new(random.normal(), random.normal()) * 12.0;
            }
        }
        let (found, verdict) = judged(&lens, &views).unwrap();
        let off = (found.lens.focal / lens.focal - 1.0).abs().max_element();
        assert!(off < 0.005, "{off}");
        assert!(
            found.rms < 0.26 && verdict.grade < Grade::Refused,
            "{} {verdict:?}",
            found.rms
        );
    }
}

#[test]
fn pure_noise_is_refused() {
    let mut random = Random::new(4);
    let lens = pinhole();
    let mut views = seen(&lens, &poses(12, 0.4, 0.2, 5), 0.1, &mut random);
    for view in &mut views {
        for c in &mut view.points {
            c.pixel = DVec2::new(random.between(0.0, 640.0), random.between(0.0, 480.0));
        }
    }
    if let Ok((_, verdict)) = judged(&lens, &views) {
        assert_eq!(verdict.grade, Grade::Refused, "{verdict:?}");
    }
}
