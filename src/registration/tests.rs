use super::*;
use crate::motion::moved;
use crate::rate_limit::{MAX_SHARE_OF_MOTION, MAX_SPEED_AT_REST};
use glam::{DMat3, DQuat};
use penumbra_fiducials::{Match, refine, synthetic};
use penumbra_numerics::Random;

const RATE: f64 = 30.0;
/// Centre of the objects.
const MIDDLE: DVec3 = DVec3::new(0.05, 0.03, 0.04);

/// Ground truth: a hand-held camera that moves and rests in turn.
fn truth(seconds: f64) -> RigidTransform {
    // Rests in one second out of four.
    let phase = (seconds / 4.0).floor() * 3.0 + (seconds % 4.0).min(3.0);
    let eye = DVec3::new(
        0.35 * (0.7 * phase).cos(),
        -0.5 + 0.1 * (1.1 * phase).sin(),
        0.45 + 0.08 * (0.9 * phase).sin(),
    );
    let forward = (MIDDLE + DVec3::new(0.02 * (1.7 * phase).sin(), 0.0, 0.0) - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    RigidTransform::new(DQuat::from_mat3(&axes), eye)
}

/// Adds the error of an electromagnetic tracker: distortion by a metal table, and drift.
fn distorted(pose: RigidTransform, seconds: f64, strength: f64) -> RigidTransform {
    let x = pose.translation;
    let bend = DVec3::new(
        0.006 * (4.0 * x.x).sin() + 0.004 * x.z,
        0.005 * (3.0 * x.y).cos(),
        0.007 * (3.5 * x.x).sin(),
    );
    let turn = DVec3::new(
        0.010 * (3.0 * x.x).sin(),
        0.008 * (2.0 * x.y).cos(),
        0.006 * (4.0 * x.x).cos(),
    );
    let drift = 1e-4 * seconds;
    moved(
        pose,
        (turn + DVec3::splat(drift)) * strength,
        (bend + DVec3::splat(drift)) * strength,
    )
}

const NOISE: [f64; 2] = [2e-4, 3e-4];

fn tracked(pose: RigidTransform, random: &mut Random) -> TrackerPose {
    TrackerPose {
        world_from_camera: moved(
            pose,
            random.normal3() * NOISE[1],
            random.normal3() * NOISE[0],
        ),
        noise: NOISE,
    }
}

/// Pose by two tags beside the object, from corners with noise of `pixels`.
fn marked(pose: RigidTransform, pixels: f64, random: &mut Random) -> Option<PoseEstimate> {
    let camera = synthetic::camera();
    let from_world = pose.inverse();
    let tags = [DVec3::new(-0.08, 0.0, 0.0), DVec3::new(0.12, 0.1, 0.0)];
    let mut matches = Vec::new();
    for (tag, corner) in tags.iter().flat_map(|t| (0..4).map(move |c| (t, c))) {
        let (x, y) = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)][corner];
        let point = *tag + DVec3::new(0.03 * x, 0.03 * y, 0.0);
        let noise = random.normal3().truncate() * pixels;
        let pixel = camera.project(from_world.transform_point(point))? + noise;
        matches.push(Match { point, pixel });
    }
    refine(&camera, from_world, &matches)
}

/// Errors of the displayed corners of the object's box, pixels.
fn corner_errors(drawn: RigidTransform, truth: RigidTransform) -> [glam::DVec2; 8] {
    let camera = synthetic::camera();
    std::array::from_fn(|i| {
        let sign = |bit: usize| if i >> bit & 1 == 1 { 0.05 } else { -0.05 };
        let p = MIDDLE + DVec3::new(sign(0), sign(1), sign(2));
        let place = |pose: RigidTransform| {
            let there = pose.inverse().transform_point(p);
            camera.project(there).unwrap()
        };
        place(drawn) - place(truth)
    })
}

/// Statistics of the displayed errors.
#[derive(Debug, Default)]
struct Errors {
    squares: f64,
    count: f64,
    worst: f64,
    jump: f64,
    /// Sum of (error / stated standard deviation)².
    normalised: f64,
    stated: f64,
    rejected: u32,
}

impl Errors {
    fn rms(&self) -> f64 {
        (self.squares / self.count).sqrt()
    }
}

/// Simulates pictures with a tracker distorted by `strength`. `shows` returns whether a picture shows
/// markers and whether the tracker measures; `outliers` is the share of wrong marker poses.
fn run(
    seconds: std::ops::Range<f64>,
    strength: f64,
    shows: impl Fn(f64, &mut Random) -> (bool, bool),
    outliers: f64,
) -> Errors {
    let mut random = Random::new(11);
    let mut registration = HybridRegistration::new(synthetic::camera(), MIDDLE);
    let mut errors = Errors::default();
    let mut last: Option<([glam::DVec2; 8], RigidTransform)> = None;
    let frames = (seconds.end * RATE) as i64;
    for k in 0..frames {
        let t = k as f64 / RATE;
        let pose = truth(t);
        let (shown, tracks) = shows(t, &mut random);
        let by_tracker = tracked(distorted(pose, t, strength), &mut random);
        let mut seen = marked(pose, 0.15, &mut random).filter(|_| shown);
        if random.uniform() < outliers
            && let Some(seen) = &mut seen
        {
            // The wrong one of a single marker's two poses, or a marker that was moved.
            let wrong = moved(pose, random.normal3() * 0.2, random.normal3() * 0.05);
            seen.camera_from_frame = wrong.inverse();
        }
        let at = MonotonicTime::from_nanos((t * 1e9) as i64);
        let fused = registration.register(at, tracks.then_some(by_tracker), seen.as_ref());
        let Some(fused) = fused else {
            last = None;
            continue;
        };
        errors.rejected += u32::from(fused.assessment == MarkerAssessment::Rejected);
        let off = corner_errors(fused.world_from_camera, pose);
        if t >= seconds.start {
            for e in off {
                errors.squares += e.length_squared();
                errors.count += 1.0;
                errors.worst = errors.worst.max(e.length());
            }
            if let Some(sigma) = fused.sigma {
                let mean = off.iter().map(|e| e.length_squared()).sum::<f64>() / 16.0;
                errors.normalised += mean / sigma.pixels.powi(2);
                errors.stated += 1.0;
            }
        }
        if let Some((before, from)) = last {
            let camera = synthetic::camera();
            let motion = apart_pixels(&camera, from, pose, 0.6);
            let slid = off.iter().zip(before).map(|(a, b)| (*a - b).length());
            let slid = slid.fold(0.0, f64::max);
            errors.jump = errors.jump.max(slid - MAX_SHARE_OF_MOTION * motion);
        }
        last = Some((off, pose));
    }
    errors
}

#[test]
fn markers_correct_field_distortion() {
    let alone = run(2.0..40.0, 1.0, |_, _| (false, true), 0.0);
    let both = run(2.0..40.0, 1.0, |_, _| (true, true), 0.0);
    println!(
        "tracker alone {:.2} px, with markers {both:?} {:.3} px",
        alone.rms(),
        both.rms()
    );
    assert!(alone.rms() > 3.0, "{}", alone.rms());
    assert!(
        both.rms() < 0.5 && both.worst < 2.0,
        "{} {}",
        both.rms(),
        both.worst
    );
    let normalised = (both.normalised / both.stated).sqrt();
    assert!((0.5..1.5).contains(&normalised), "{normalised}");
}

#[test]
fn displayed_pose_does_not_jump_where_markers_appear_and_disappear() {
    // Markers are visible a third of the time, from the third second.
    let shows =
        |t: f64, random: &mut Random| (t > 3.0 && t % 3.0 < 1.0 && random.uniform() < 0.8, true);
    let alone = run(8.0..60.0, 0.4, |_, _| (false, true), 0.0);
    let errors = run(8.0..60.0, 0.4, shows, 0.0);
    println!(
        "alone {:.2} px, coming and going {errors:?} {:.3} px",
        alone.rms(),
        errors.rms()
    );
    // The margin is the tracker's own noise: 3 standard deviations of two pictures.
    assert!(
        errors.jump < MAX_SPEED_AT_REST / RATE + 2.0,
        "{}",
        errors.jump
    );
    assert!(errors.rms() < 0.7 * alone.rms(), "{}", errors.rms());
}

#[test]
fn rejects_outlying_marker_poses() {
    let errors = run(2.0..40.0, 1.0, |_, _| (true, true), 0.1);
    println!("outliers {errors:?} {:.3} px", errors.rms());
    assert!(errors.rejected > 60, "{}", errors.rejected);
    assert!(
        errors.rms() < 0.6 && errors.worst < 3.0,
        "{} {}",
        errors.rms(),
        errors.worst
    );
}

#[test]
fn continues_with_one_source_while_the_other_is_missing() {
    // The tracker is missing in every fifth second, the markers in every seventh.
    let shows = |t: f64, _: &mut Random| (t % 7.0 < 6.0, t % 5.0 < 4.0);
    let errors = run(2.0..70.0, 0.3, shows, 0.0);
    println!("either {errors:?} {:.3} px", errors.rms());
    assert!(errors.rms() < 1.0, "{}", errors.rms());
    assert!(
        errors.jump < MAX_SPEED_AT_REST / RATE + 2.0,
        "{}",
        errors.jump
    );
}

#[test]
fn consistent_outliers_reset_correction_without_a_jump() {
    let camera = synthetic::camera();
    let mut registration = HybridRegistration::new(camera.clone(), MIDDLE);
    let mut random = Random::new(3);
    let pose = truth(3.5);
    let mut before: Option<RigidTransform> = None;
    let mut overruled = 0;
    for k in 0..600 {
        // The transmitter is knocked over at picture 100.
        let knock = if k < 100 { 0.0 } else { 0.02 };
        let bumped = moved(pose, DVec3::Z * knock, DVec3::X * knock);
        let seen = marked(pose, 0.1, &mut random).unwrap();
        let at = MonotonicTime::from_nanos(i64::from(k) * 33_333_333);
        let clean = TrackerPose {
            world_from_camera: bumped,
            noise: [1e-5; 2],
        };
        let fused = registration.register(at, Some(clean), Some(&seen)).unwrap();
        overruled += u32::from(fused.assessment == MarkerAssessment::Reset);
        if let Some(before) = before
            && k != 100
        {
            let step = apart_pixels(&camera, before, fused.world_from_camera, 0.6);
            assert!(step < 1.6 * MAX_SPEED_AT_REST / RATE, "{k}: {step} px");
        }
        before = Some(fused.world_from_camera);
    }
    assert_eq!(overruled, 1);
    let off = corner_errors(before.unwrap(), pose)[0].length();
    assert!(off < 0.4, "{off} px");
}

#[test]
fn tracker_without_markers_is_uncorrected_and_has_no_standard_deviation() {
    let mut registration = HybridRegistration::new(synthetic::camera(), MIDDLE);
    let pose = truth(1.0);
    let clean = TrackerPose {
        world_from_camera: pose,
        noise: NOISE,
    };
    let fused = registration
        .register(MonotonicTime::from_nanos(0), Some(clean), None)
        .unwrap();
    assert_eq!(fused.source, PoseOrigin::Tracker);
    assert_eq!(fused.sigma, None);
    assert!(corner_errors(fused.world_from_camera, pose)[0].length() < 1e-9);
    assert!(
        registration
            .register(MonotonicTime::from_nanos(1), None, None)
            .is_none()
    );
}
