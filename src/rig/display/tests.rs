use super::*;

fn motion(radians: f64) -> RigidTransform {
    RigidTransform::new(
        DQuat::from_rotation_y(radians),
        DVec3::new(radians, 0.0, 0.0),
    )
}

#[test]
fn suppresses_noise_at_rest_and_keeps_fast_motion() {
    let noise = Some([2e-3, 2e-3]);
    assert_eq!(
        shrink_by_noise(motion(1e-3), noise),
        RigidTransform::IDENTITY
    );
    let fast = shrink_by_noise(motion(0.05), noise);
    let (rotated, moved) = (fast.rotation.to_scaled_axis().y, fast.translation.x);
    assert!((rotated / 0.05 - 1.0).abs() < 1e-3 && (moved / 0.05 - 1.0).abs() < 1e-3);
    assert_eq!(shrink_by_noise(motion(1e-3), None), motion(1e-3));
}

#[test]
fn display_latency_follows_measurements() {
    let latency = DisplayLatency::default();
    latency.add(8_000_000);
    assert_eq!(latency.nanos(), 8_000_000);
    (0..60).for_each(|_| latency.add(20_000_000));
    assert!((latency.nanos() - 20_000_000).abs() < 10_000);
}
