use super::*;
use drawing::{Scene, camera, pixels_off, truth};
use glam::{DQuat, DVec2};
use penumbra_numerics::Random;

mod drawing;

const RATE: f64 = 30.0;
/// Noise of the tracker, metres and radians.
const NOISE: [f64; 2] = [3e-4, 4e-4];

/// A run over drawn pictures.
struct Run {
    scene: Scene,
    camera: PinholeCamera,
    pictures: u32,
    /// Noise as the tracker states it, metres and radians.
    stated: [f64; 2],
    /// Time from one row to the next, seconds.
    row_seconds: f64,
}

impl Run {
    fn new(scene: Scene) -> Self {
        Self {
            scene,
            camera: camera(),
            pictures: 48,
            stated: NOISE,
            row_seconds: 0.0,
        }
    }

    /// Steadies the poses that `track` returns for pictures of true poses. `draw` may change a picture.
    fn results(
        &self,
        track: impl FnMut(u32, RigidTransform) -> RigidTransform,
        draw: impl FnMut(u32, &mut Vec<u8>),
    ) -> Vec<Outcome> {
        let mut steadying = Steadying::new(self.camera.clone(), DVec3::ZERO);
        self.results_with(&mut steadying, track, draw)
    }

    fn results_with(
        &self,
        steadying: &mut Steadying,
        mut track: impl FnMut(u32, RigidTransform) -> RigidTransform,
        mut draw: impl FnMut(u32, &mut Vec<u8>),
    ) -> Vec<Outcome> {
        let mut rgba = Vec::new();
        let outcome = |k: u32| {
            let seconds = f64::from(k) / RATE;
            let pose = |since: f64| truth(seconds + since);
            self.scene
                .draw(&self.camera, &pose, self.row_seconds, seconds, &mut rgba);
            draw(k, &mut rgba);
            let tracked = track(k, truth(seconds));
            let (before, after) = (pose(-0.01), pose(0.01));
            let steadied = steadying.steady(&SteadyingInput {
                at: MonotonicTime::from_nanos((seconds * 1e9) as i64),
                camera: &self.camera,
                rgba: &rgba,
                tracked: TrackerPose {
                    world_from_camera: tracked,
                    noise: self.stated,
                },
                motion: RollingShutter::between(&before, &after, 0.02, self.row_seconds),
                surfaces: &|origin, direction| self.scene.known(origin, direction),
            });
            let off = |pose| pixels_off(&self.camera, pose, truth(seconds));
            Outcome {
                tracked,
                steadied,
                before: off(tracked),
                after: off(steadied.world_from_camera),
            }
        };
        (0..self.pictures).map(outcome).collect()
    }
}

/// A picture's result.
struct Outcome {
    tracked: RigidTransform,
    steadied: SteadiedPose,
    /// Errors in the middle of the picture, tracked and steadied, pixels.
    before: DVec2,
    after: DVec2,
}

fn noisy(seed: u64, noise: [f64; 2]) -> impl FnMut(u32, RigidTransform) -> RigidTransform {
    let mut random = Random::new(seed);
    move |_, pose| {
        let turn = random.normal3() * noise[1];
        moved(pose, turn, random.normal3() * noise[0])
    }
}

fn rms(values: impl Iterator<Item = DVec2>) -> f64 {
    let all: Vec<f64> = values.map(DVec2::length_squared).collect();
    (all.iter().sum::<f64>() / all.len() as f64).sqrt()
}

/// Ratio of the steadied to the tracked errors, and of their steps from picture to picture, after the
/// first ten pictures.
fn ratios(outcomes: &[Outcome]) -> (f64, f64) {
    let late = &outcomes[10..];
    let steps =
        |of: fn(&Outcome) -> DVec2| rms(late.windows(2).map(move |w| of(&w[1]) - of(&w[0])));
    let errors = rms(late.iter().map(|o| o.after)) / rms(late.iter().map(|o| o.before));
    let steps = steps(|o| o.after) / steps(|o| o.before);
    println!("errors fall to {errors:.2}, steps to {steps:.2}");
    (errors, steps)
}

const fn as_drawn(_: u32, _: &mut Vec<u8>) {}

#[test]
fn noise_of_the_tracker_falls_to_a_third_and_its_steps_to_a_tenth() {
    let (errors, steps) = ratios(&Run::new(Scene::plane()).results(noisy(1, NOISE), as_drawn));
    assert!(errors < 0.35, "{errors}");
    assert!(steps < 0.1, "{steps}");
}

#[test]
fn lens_distortion_and_rolling_shutter_are_taken_into_account() {
    let mut run = Run::new(Scene::plane());
    run.camera.distortion = [-0.2, 0.05, 0.001, -0.001, 0.0];
    run.row_seconds = 120e-6;
    let outcomes = run.results(noisy(2, NOISE), as_drawn);
    let (errors, steps) = ratios(&outcomes);
    assert!(errors < 0.35, "{errors}");
    assert!(steps < 0.12, "{steps}");
    let residual = outcomes
        .iter()
        .map(|o| o.steadied.residual_pixels)
        .fold(0.0, f64::max);
    assert!(residual < 0.05, "{residual} px");
}

#[test]
fn thing_that_moves_does_not_pull() {
    let run = Run::new(Scene {
        carried: 45.0,
        ..Scene::plane()
    });
    let (errors, steps) = ratios(&run.results(noisy(3, NOISE), as_drawn));
    assert!(errors < 0.4, "{errors}");
    assert!(steps < 0.15, "{steps}");
}

#[test]
fn thing_that_fills_most_of_the_picture_does_not_carry_the_pose_away() {
    for (seed, carried) in [(20, 90.0), (21, 150.0)] {
        let run = Run::new(Scene {
            carried,
            ..Scene::plane()
        });
        let (errors, _) = ratios(&run.results(noisy(seed, NOISE), as_drawn));
        assert!(errors < 0.97, "{carried}: {errors}");
    }
}

#[test]
fn shadow_that_moves_does_not_pull() {
    let run = Run::new(Scene {
        shadow: 0.5,
        contrast: 25.0,
        ..Scene::plane()
    });
    let (errors, steps) = ratios(&run.results(noisy(16, NOISE), as_drawn));
    assert!(errors < 0.4, "{errors}");
    assert!(steps < 0.15, "{steps}");
}

#[test]
fn unknown_surface_does_not_mislead() {
    let run = Run::new(Scene {
        step: 0.04,
        ..Scene::plane()
    });
    let (errors, steps) = ratios(&run.results(noisy(4, NOISE), as_drawn));
    assert!(errors < 0.5, "{errors}");
    assert!(steps < 0.25, "{steps}");
}

#[test]
fn surfaces_that_are_all_wrong_add_little_error_and_no_trembling() {
    for (seed, step) in [(17, 0.01), (18, 0.04), (19, -0.06)] {
        let run = Run::new(Scene {
            step,
            step_from: f64::NEG_INFINITY,
            ..Scene::plane()
        });
        let (errors, steps) = ratios(&run.results(noisy(seed, NOISE), as_drawn));
        assert!(errors < 1.4, "{step}: {errors}");
        assert!(steps < 0.4, "{step}: {steps}");
    }
}

#[test]
fn without_texture_the_pose_is_the_trackers_exactly() {
    let run = Run::new(Scene {
        contrast: 0.0,
        ..Scene::plane()
    });
    for outcome in run.results(noisy(5, NOISE), as_drawn) {
        assert_eq!(outcome.steadied, SteadiedPose::tracked(outcome.tracked));
    }
}

#[test]
fn without_known_surfaces_the_pose_is_the_trackers_exactly() {
    let run = Run::new(Scene {
        is_known: false,
        ..Scene::plane()
    });
    for outcome in run.results(noisy(6, NOISE), as_drawn) {
        assert_eq!(outcome.steadied, SteadiedPose::tracked(outcome.tracked));
    }
}

#[test]
fn picture_of_another_size_is_not_used() {
    let run = Run::new(Scene::plane());
    let cut = |k, rgba: &mut Vec<u8>| rgba.truncate(if k == 20 { 400 } else { rgba.len() });
    let outcomes = run.results(noisy(7, NOISE), cut);
    assert_eq!(
        outcomes[20].steadied,
        SteadiedPose::tracked(outcomes[20].tracked)
    );
    assert!(outcomes[19].steadied.landmarks > 10 && outcomes[22].steadied.landmarks > 10);
}

#[test]
fn jump_of_the_tracker_is_followed() {
    let mut noise = noisy(8, NOISE);
    let knocked = |k, pose| {
        let jump = if k < 30 { 0.0 } else { 0.02 };
        moved(noise(k, pose), DVec3::ZERO, DVec3::X * jump)
    };
    let outcomes = Run::new(Scene::plane()).results(knocked, as_drawn);
    for outcome in &outcomes[31..] {
        let off = (outcome.after - outcome.before).length();
        assert!(off < 1.5, "{off} px from the tracker");
    }
    assert!(outcomes[45].steadied.landmarks > 10);
}

#[test]
fn error_that_grows_is_followed() {
    let mut noise = noisy(9, NOISE);
    // 15 mm in two seconds: a field distorted by metal.
    let drifting = |k, pose| {
        moved(
            noise(k, pose),
            DVec3::ZERO,
            DVec3::X * 2.5e-4 * f64::from(k),
        )
    };
    let outcomes = Run::new(Scene::plane()).results(drifting, as_drawn);
    let mut last = DVec2::ZERO;
    for outcome in &outcomes {
        let off = (outcome.after - outcome.before).length();
        assert!(off < 3.0, "{off} px from the tracker");
        let step = (outcome.after - last).length();
        assert!(step < 0.8, "step of {step} px");
        last = outcome.after;
    }
    assert!(outcomes.iter().skip(1).all(|o| o.steadied.landmarks > 10));
}

#[test]
fn dark_pictures_fall_back_without_a_jump() {
    // The tracker errs by 2.5 mm when the light goes out.
    let mut noise = noisy(10, NOISE);
    let erring = |k, pose| {
        let error = if (19..24).contains(&k) { 2.5e-3 } else { 0.0 };
        moved(noise(k, pose), DVec3::ZERO, DVec3::X * error)
    };
    let dark = |k, rgba: &mut Vec<u8>| {
        if (20..40).contains(&k) {
            rgba.fill(3);
        }
    };
    let outcomes = Run::new(Scene::plane()).results(erring, dark);
    let correction = |k: usize| outcomes[k].after - outcomes[k].before;
    assert!(correction(19).length() > 1.2, "{}", correction(19));
    for k in 20..40 {
        let step = (correction(k) - correction(k - 1)).length();
        assert!(step < 1.0, "{k}: {step} px");
    }
    assert_eq!(outcomes[30].steadied.landmarks, 0);
    assert_eq!(
        outcomes[35].steadied.world_from_camera,
        outcomes[35].tracked
    );
    assert!(outcomes[45].steadied.landmarks > 10);
}

#[test]
fn never_worse_than_the_tracker_whatever_noise_it_states() {
    for (seed, factor) in [(11, 0.1), (12, 0.3), (13, 3.0), (14, 10.0)] {
        let mut run = Run::new(Scene::plane());
        run.stated = NOISE.map(|sigma| sigma / factor);
        let outcomes = run.results(noisy(seed, NOISE), as_drawn);
        let (errors, steps) = ratios(&outcomes);
        assert!(errors < 0.6, "stated / {factor}: {errors}");
        assert!(steps < 0.5, "stated / {factor}: {steps}");
    }
}

#[test]
fn exact_tracker_is_hardly_disturbed() {
    let outcomes = Run::new(Scene::plane()).results(|_, pose| pose, as_drawn);
    let error = rms(outcomes.iter().map(|o| o.after));
    assert!(error < 0.05, "{error} px");
}

#[test]
fn recording_that_begins_again_gives_the_same_poses() {
    let mut run = Run::new(Scene::plane());
    run.pictures = 15;
    run.stated = NOISE.map(|sigma| sigma / 5.0);
    let mut steadying = Steadying::new(run.camera.clone(), DVec3::ZERO);
    let mut poses = || -> Vec<SteadiedPose> {
        let outcomes = run.results_with(&mut steadying, noisy(15, NOISE), as_drawn);
        outcomes.into_iter().map(|o| o.steadied).collect()
    };
    let first = poses();
    assert!(first.iter().any(|pose| pose.landmarks > 10));
    assert_eq!(poses(), first);
}

#[test]
fn mean_stays_near_the_trackers_pose() {
    let sigma = 3e-4;
    let tracked = RigidTransform::new(DQuat::IDENTITY, DVec3::X * 40.0 * sigma);
    let mut mean = TrackerMean::new();
    mean.average(RigidTransform::IDENTITY, tracked, [sigma; 2], 0.0);
    let now = mean.apply(RigidTransform::IDENTITY).translation;
    let off = now.distance(tracked.translation) / sigma;
    assert!((off - 5.7).abs() < 1e-6, "{off} standard deviations");
}
