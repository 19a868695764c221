#![allow(clippy::unwrap_used)]
use super::*;

fn turn(radians: f64) -> RigidTransform {
    RigidTransform::new(
        DQuat::from_rotation_y(radians),
        DVec3::new(radians, 0.0, 0.0),
    )
}

#[test]
fn noise_does_not_shake_a_camera_that_rests_and_motion_stays_whole() {
    let noise = Some([2e-3, 2e-3]);
    assert_eq!(believed(turn(1e-3), noise), RigidTransform::IDENTITY);
    let quick = believed(turn(0.05), noise);
    let (turned, moved) = (quick.rotation.to_scaled_axis().y, quick.translation.x);
    assert!((turned / 0.05 - 1.0).abs() < 1e-3 && (moved / 0.05 - 1.0).abs() < 1e-3);
    assert_eq!(believed(turn(1e-3), None), turn(1e-3));
}

#[test]
fn the_time_to_the_window_follows_what_is_measured() {
    let handing = DisplayLatency::default();
    handing.add(8_000_000);
    assert_eq!(handing.nanos(), 8_000_000);
    (0..60).for_each(|_| handing.add(20_000_000));
    assert!((handing.nanos() - 20_000_000).abs() < 10_000);
}
