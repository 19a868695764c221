use super::*;
use crate::synthetic::camera;

fn board() -> Vec<DVec3> {
    let places = [
        DVec3::ZERO,
        DVec3::new(0.2, 0.02, 0.0),
        DVec3::new(0.1, 0.15, 0.03),
    ];
    places
        .iter()
        .flat_map(|p| square(0.03).map(|c| c + *p))
        .collect()
}

fn truth() -> RigidTransform {
    let turn = DQuat::from_rotation_x(0.7) * DQuat::from_rotation_z(0.2);
    RigidTransform::new(turn, DVec3::new(-0.1, -0.05, 0.6))
}

/// Corners with normal noise of `sigma` pixels.
fn seen(points: &[DVec3], seed: u64, sigma: f64) -> Vec<Match> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut normal = || {
        let sum: f64 = (0..12)
            .map(|_| {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                (state >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum();
        sum - 6.0
    };
    let camera = camera();
    let project = |p: &DVec3| camera.project(truth().transform_point(*p)).unwrap();
    let noisy = |p: &DVec3| project(p) + sigma * DVec2::new(normal(), normal());
    points
        .iter()
        .copied()
        .zip(points.iter().map(noisy).collect::<Vec<_>>())
        .map(|(point, pixel)| Match { point, pixel })
        .collect()
}

/// The pose is exact from a distant start. With noise, the errors match the covariance: their
/// squared Mahalanobis length has mean 6.
#[test]
fn recovers_pose_with_consistent_covariance() {
    let start = RigidTransform::new(
        truth().rotation * DQuat::from_rotation_y(0.3),
        DVec3::new(0.0, 0.0, 0.9),
    );
    let exact = refine(&camera(), start, &seen(&board(), 1, 0.0)).unwrap();
    assert!(
        exact
            .camera_from_frame
            .translation
            .distance(truth().translation)
            < 1e-7
    );
    assert!(exact.rms < 1e-4);
    let mut lengths = Vec::new();
    for seed in 1..200 {
        let found = refine(&camera(), start, &seen(&board(), seed, 0.2)).unwrap();
        // The motion from the true to the estimated pose.
        let motion = found.camera_from_frame * truth().inverse();
        let turn = motion.rotation.to_scaled_axis();
        let off = [
            turn.x,
            turn.y,
            turn.z,
            motion.translation.x,
            motion.translation.y,
            motion.translation.z,
        ];
        let weighed = solve(&found.covariance, &off).unwrap();
        lengths.push((0..6).map(|i| off[i] * weighed[i]).sum::<f64>());
    }
    let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
    assert!((4.5..9.0).contains(&mean), "{mean}");
}

#[test]
fn outlying_corner_has_little_influence() {
    let mut matches = seen(&board(), 3, 0.05);
    matches[5].pixel += DVec2::new(25.0, -10.0);
    let found = refine(&camera(), truth(), &matches).unwrap();
    let off = found
        .camera_from_frame
        .translation
        .distance(truth().translation);
    assert!(off < 2e-3 && found.max_error > 20.0, "{off}");
    assert!(refine(&camera(), truth(), &matches[..3]).is_none());
    let behind = RigidTransform::new(DQuat::IDENTITY, DVec3::new(0.0, 0.0, -1.0));
    assert!(refine(&camera(), behind, &matches).is_none());
}

#[test]
fn uncertainty_grows_with_distance_from_corners() {
    let found = refine(&camera(), truth(), &seen(&square(0.03), 9, 0.1)).unwrap();
    let near = found.sigma_at(&camera(), DVec3::ZERO);
    let far = found.sigma_at(&camera(), DVec3::new(0.1, 0.0, -0.05));
    assert!(near < 0.2 && far > 2.0 * near, "{near} {far}");
}
