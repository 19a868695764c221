use super::*;
use crate::synthetic::{camera, render, tag};
use glam::{DQuat, DVec3};
use penumbra_interface::RigidTransform;

fn detector() -> Detector {
    Detector::new(&[Family::Tag36h11], &Response::srgb())
}

/// Rendered tags, frontal and slanted, near and far.
#[test]
fn finds_corners_to_a_twentieth_of_a_pixel() {
    let camera = camera();
    let tag = tag(341, 0.06, DVec3::ZERO);
    let mut errors = Vec::new();
    for (angle, z) in [(0.0, 0.3), (0.5, 0.4), (-0.8, 0.5), (1.0, 0.6), (0.2, 0.9)] {
        let rotation = DQuat::from_rotation_z(0.3 + angle) * DQuat::from_rotation_x(angle);
        let pose = RigidTransform::new(rotation, DVec3::new(0.021, -0.013, z));
        let codes = render(&camera, pose, &[tag], 1.0);
        let mut detector = detector();
        let seen = detector.detect_grey(&codes, 640, 480, Some(&camera));
        assert_eq!(seen.len(), 1, "{angle} {z}");
        assert_eq!((seen[0].id, seen[0].wrong_bits), (341, 0));
        for (point, pixel) in tag.corners().into_iter().zip(seen[0].corners) {
            errors.push(
                camera
                    .project(pose.transform_point(point))
                    .unwrap()
                    .distance(pixel),
            );
        }
    }
    let rms = (errors.iter().map(|o| o * o).sum::<f64>() / errors.len() as f64).sqrt();
    let worst = errors.iter().copied().fold(0.0, f64::max);
    assert!(rms < 0.05 && worst < 0.15, "{rms} {worst}");
}

#[test]
fn lens_distortion_does_not_shift_corners() {
    let mut camera = camera();
    camera.distortion = [-0.35, 0.1, 0.0, 0.0, 0.0];
    let tag = tag(7, 0.12, DVec3::ZERO);
    let pose = RigidTransform::new(DQuat::from_rotation_x(0.3), DVec3::new(0.08, 0.05, 0.4));
    let codes = render(&camera, pose, &[tag], 0.0);
    let off = |detector: &mut Detector, camera_known: bool| {
        let seen = detector.detect_grey(&codes, 640, 480, camera_known.then_some(&camera));
        assert_eq!(seen.len(), 1);
        let pairs = tag.corners().into_iter().zip(seen[0].corners);
        let errors =
            pairs.map(|(p, c)| camera.project(pose.transform_point(p)).unwrap().distance(c));
        errors.fold(0.0, f64::max)
    };
    let (known, unknown) = (off(&mut detector(), true), off(&mut detector(), false));
    assert!(known < 0.08 && known < 0.3 * unknown, "{known} {unknown}");
}

#[test]
fn finds_nothing_in_uniform_empty_and_noisy_pictures() {
    let mut detector = detector();
    assert!(
        detector
            .detect_grey(&[0; 640 * 480], 640, 480, None)
            .is_empty()
    );
    assert!(detector.detect_grey(&[0; 100], 640, 480, None).is_empty());
    assert!(detector.detect_grey(&[], 0, 0, None).is_empty());
    let mut state = 1_u32;
    let noise: Vec<u8> = (0..640 * 480)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    assert!(detector.detect_grey(&noise, 640, 480, None).is_empty());
}

#[test]
fn corners_rotate_with_the_tag() {
    let camera = camera();
    let tag = tag(11, 0.06, DVec3::ZERO);
    for quarter in 0..4 {
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2 * f64::from(quarter) + 0.1);
        let pose = RigidTransform::new(turn, DVec3::new(0.0, 0.0, 0.5));
        let codes = render(&camera, pose, &[tag], 0.0);
        let mut detector = detector();
        let seen = detector.detect_grey(&codes, 640, 480, None);
        let first = camera
            .project(pose.transform_point(tag.corners()[0]))
            .unwrap();
        assert!(seen[0].corners[0].distance(first) < 0.2, "{quarter}");
    }
}

/// A grid of small squares with a tag in front.
fn texture(width: usize, height: usize, tag: &[u8]) -> Vec<u8> {
    let mut codes: Vec<u8> = (0..width * height)
        .map(|i| {
            let (x, y) = (i % width, i / width);
            if x % 16 < 11 && y % 16 < 11 { 30 } else { 210 }
        })
        .collect();
    for (y, row) in tag.chunks_exact(640).enumerate().skip(100).take(280) {
        codes[y * width + 180..y * width + 460].copy_from_slice(&row[180..460]);
    }
    codes
}

#[test]
fn largest_outlines_are_decoded_first_in_textured_picture() {
    let pose = RigidTransform::new(DQuat::from_rotation_x(0.2), DVec3::new(0.0, 0.0, 0.3));
    let tag = render(&camera(), pose, &[tag(5, 0.06, DVec3::ZERO)], 1.0);
    let codes = texture(1920, 1080, &tag);
    let mut detector = detector();
    let looked = |detector: &mut Detector| {
        let start = std::time::Instant::now();
        let seen = detector.detect_grey(&codes, 1920, 1080, None);
        let ids: Vec<u32> = seen.iter().map(|t| t.id).collect();
        (ids, start.elapsed().as_secs_f64() * 1e3)
    };
    let (ids, capped) = looked(&mut detector);
    assert_eq!(ids, [5]);
    let mut all = detector.with_max_candidates(100_000);
    let (ids, uncapped) = looked(&mut all);
    assert_eq!(ids, [5]);
    println!("{capped:.1} ms with the cap, {uncapped:.1} ms without");
    assert!(capped < uncapped, "{capped} {uncapped}");
}
