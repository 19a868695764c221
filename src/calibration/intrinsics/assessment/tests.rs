use super::*;
use crate::intrinsics::coverage::cell_middle;
use crate::intrinsics::estimate::tests::{fisheye, pinhole, poses, simulated_views};
use crate::intrinsics::synthetic::pose;
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

fn assessed(lens: &Lens, views: &[View]) -> Result<(Estimate, Assessment), NoEstimate> {
    let options = Options {
        model: lens.model,
        square_pixels: false,
    };
    let found = estimate((lens.width, lens.height), views, &options)?;
    let coverage = Coverage::new(&found.lens, &found.views, &Light::default());
    let uncertainty = Uncertainty::from_estimate(&found);
    let assessment = Assessment::from_estimate(
        &found,
        &coverage,
        &Tilt::from_views(&found.views),
        &uncertainty,
    );
    Ok((found, assessment))
}

fn has(assessment: &Assessment, kind: fn(&Finding) -> bool) -> bool {
    assessment.findings.iter().any(|f| kind(&f.1))
}

#[test]
fn views_from_all_sides_give_good_grade_and_correct_uncertainty() {
    let mut random = Random::new(11);
    for (lens, distance, lateral) in [(pinhole(), 0.4, 0.4), (fisheye(), 0.12, 0.9)] {
        let views = simulated_views(&lens, &poses(40, distance, lateral, 5), 0.15, &mut random);
        let (found, assessment) = assessed(&lens, &views).unwrap();
        assert_eq!(assessment.grade, Grade::Good, "{:?}", assessment.findings);
        let uncertainty = Uncertainty::from_estimate(&found);
        assert!(
            uncertainty.worst < 1.0 && uncertainty.median < 0.2,
            "{uncertainty:?}"
        );
        // The errors of the projection, after compensation by a camera rotation, are consistent
        // with it.
        let errors = errors_after_rotation(&lens, &found.lens);
        for (error, sigma) in errors.iter().zip(&uncertainty.by_cell) {
            if let (Some(error), Some(sigma)) = (error, sigma) {
                assert!(*error < 5.0 * sigma, "{error} {sigma}");
            }
        }
    }
}

/// Returns the error of the found lens by cell, after the best camera rotation, pixels.
fn errors_after_rotation(ground_truth: &Lens, found: &Lens) -> Vec<Option<f64>> {
    let error = |rotation: DQuat, cell: usize| {
        let ray = ground_truth.unproject(cell_middle(ground_truth, cell))?;
        let p = found.project_with_derivatives(rotation * ray)?;
        Some((p, rotation * ray, cell_middle(ground_truth, cell)))
    };
    let radius = 0.45 * f64::from(ground_truth.height);
    let near =
        |&cell: &usize| cell_middle(ground_truth, cell).distance(ground_truth.centre) < radius;
    let rotation = minimise(
        DQuat::IDENTITY,
        20,
        |&rotation| {
            let mut normal = NormalEquations::new(3);
            for cell in (0..48).filter(near) {
                let (p, ray, expected) = error(rotation, cell)?;
                let by = crate::intrinsics::pose::by_pose(&p.by_point, ray);
                for axis in 0..2 {
                    let row: Vec<f64> = by[..3].iter().map(|d| d[axis]).collect();
                    normal.add((p.pixel - expected)[axis], &row, 1.0);
                }
            }
            Some(normal)
        },
        |rotation, step| DQuat::from_scaled_axis(DVec3::from_slice(step)) * *rotation,
    );
    let rotation = rotation.unwrap().state;
    (0..48)
        .map(|cell| error(rotation, cell).map(|(p, _, expected)| p.pixel.distance(expected)))
        .collect()
}

#[test]
fn board_without_tilt_is_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let flat: Vec<_> = (0..20)
        .map(|i| {
            let x = f64::from(i % 5) * 0.04 - 0.08;
            let y = f64::from(i / 5) * 0.04 - 0.06;
            pose(&BOARD, DVec3::new(x, y, 0.4), DVec2::ZERO, 0.0)
        })
        .collect();
    match assessed(&lens, &simulated_views(&lens, &flat, 0.1, &mut random)) {
        Err(e) => assert_eq!(e, NoEstimate::Undetermined),
        Ok((_, assessment)) => assert_eq!(assessment.grade, Grade::Refused, "{assessment:?}"),
    }
}

#[test]
fn too_few_views_are_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    for count in 0..3 {
        let views = simulated_views(&lens, &poses(count, 0.4, 0.2, 5), 0.1, &mut random);
        let error = assessed(&lens, &views).unwrap_err();
        assert_eq!(error, NoEstimate::TooFewViews { usable: count });
    }
    let views = simulated_views(&lens, &poses(4, 0.4, 0.1, 5), 0.1, &mut random);
    let (_, assessment) = assessed(&lens, &views).unwrap();
    assert!(
        assessment.grade > Grade::Good
            && has(&assessment, |f| matches!(f, Finding::FewViews { .. }))
    );
}

#[test]
fn views_in_one_corner_only_are_not_good() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let corner: Vec<_> = poses(20, 0.9, 0.1, 5)
        .into_iter()
        .map(|mut p| {
            p.translation += DVec3::new(-0.3, -0.2, 0.0);
            p
        })
        .collect();
    let (_, assessment) =
        assessed(&lens, &simulated_views(&lens, &corner, 0.15, &mut random)).unwrap();
    assert!(assessment.grade > Grade::Good);
    assert!(
        has(&assessment, |f| matches!(f, Finding::PoorCoverage { .. })),
        "{assessment:?}"
    );
    assert!(
        assessment.hints.iter().any(|h| h.starts_with("cover the ")),
        "{:?}",
        assessment.hints
    );
}

#[test]
fn wrong_number_of_squares_is_not_good() {
    // A wrong number of columns puts the points on a skewed lattice.
    let mut random = Random::new(1);
    let lens = pinhole();
    let mut views = simulated_views(&lens, &poses(20, 0.4, 0.1, 5), 0.1, &mut random);
    for view in &mut views {
        for (i, c) in view.points.iter_mut().enumerate() {
            c.point = DVec2::new((i % 8) as f64, (i / 8) as f64) * 0.025;
        }
    }
    if let Ok((_, assessment)) = assessed(&lens, &views) {
        assert_eq!(assessment.grade, Grade::Refused, "{assessment:?}");
    }
}

#[test]
fn views_of_another_camera_are_rejected_or_refused() {
    let mut random = Random::new(1);
    let lens = pinhole();
    let mut other = pinhole();
    other.focal *= 1.6;
    other.coefficients = [0.0; 8];
    let mixed = |count: usize, random: &mut Random| {
        let mut views = simulated_views(&lens, &poses(20, 0.4, 0.2, 5), 0.1, random);
        views.extend(simulated_views(
            &other,
            &poses(count, 0.6, 0.1, 6),
            0.1,
            random,
        ));
        views
    };
    let (found, assessment) = assessed(&lens, &mixed(3, &mut random)).unwrap();
    assert!(
        (found.lens.focal.x / lens.focal.x - 1.0).abs() < 0.005,
        "{:?}",
        found.lens
    );
    assert!(assessment.grade < Grade::Refused, "{assessment:?}");
    assert!(found.views[20..].iter().all(|v| !v.used));
    // With equal shares it is undetermined which camera is meant.
    if let Ok((_, assessment)) = assessed(&lens, &mixed(20, &mut random)) {
        assert!(assessment.grade > Grade::Good, "{assessment:?}");
    }
}

#[test]
fn outlying_corners_are_rejected() {
    let mut random = Random::new(9);
    for (lens, distance, lateral) in [(pinhole(), 0.4, 0.4), (fisheye(), 0.12, 0.9)] {
        let mut views = simulated_views(&lens, &poses(40, distance, lateral, 5), 0.15, &mut random);
        for view in &mut views {
            for c in view.points.iter_mut().step_by(17) {
                c.pixel += DVec2::new(random.normal(), random.normal()) * 12.0;
            }
        }
        let (found, assessment) = assessed(&lens, &views).unwrap();
        let deviation = (found.lens.focal / lens.focal - 1.0).abs().max_element();
        assert!(deviation < 0.005, "{deviation}");
        assert!(
            found.rms < 0.26 && assessment.grade < Grade::Refused,
            "{} {assessment:?}",
            found.rms
        );
    }
}

#[test]
fn pure_noise_is_refused() {
    let mut random = Random::new(4);
    let lens = pinhole();
    let mut views = simulated_views(&lens, &poses(12, 0.4, 0.2, 5), 0.1, &mut random);
    for view in &mut views {
        for c in &mut view.points {
            c.pixel = DVec2::new(random.between(0.0, 640.0), random.between(0.0, 480.0));
        }
    }
    if let Ok((_, assessment)) = assessed(&lens, &views) {
        assert_eq!(assessment.grade, Grade::Refused, "{assessment:?}");
    }
}
