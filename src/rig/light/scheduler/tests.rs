use super::*;
use crate::light::blended::Blend;
use crate::light::estimator::LightEstimator;
use crate::light::state::LightState;
use crate::light::updates::SceneUpdates;
use crate::light::worker::LightJob;
use crate::setup::RigSetup;
use crossbeam_channel::bounded;
use penumbra_config::Config;
use penumbra_config::Technique;
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_rig_model::RigDocument;
use penumbra_scene::Scene;
use penumbra_status::Settings;
use penumbra_sync::EnvironmentSet;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::watch;

fn frame(number: i64) -> MonotonicTime {
    at(33 * number)
}

pub(in crate::light) fn at(millis: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(millis * 1_000_000)
}

/// Returns light from an environment picture at `millis`: one dome light above.
pub(in crate::light) fn light_state(millis: i64, flux: f32) -> LightState {
    let lighting = Lighting {
        captured_at: at(millis),
        generation: millis.unsigned_abs(),
        radiance: Arc::new(CubeMap {
            size: 1,
            levels: vec![vec![[1.0; 3]; 6]],
            ..CubeMap::default()
        }),
        irradiance: Harmonics::default(),
        lights: vec![DomeLight {
            direction: glam::Vec3::Z,
            irradiance: glam::Vec3::splat(flux),
            angular_radius: 0.2,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        }],
        ground_radiance: glam::Vec3::ZERO,
        faces: None,
    };
    LightState {
        lighting: Some(Arc::new(lighting)),
        ..LightState::default()
    }
}

/// Returns the flux of a light.
pub(in crate::light) fn total(state: &LightState) -> f32 {
    let lights = state.lighting.iter().flat_map(|l| &l.lights);
    lights.map(|l| l.irradiance.x).sum()
}

/// Returns the flux of a blend.
pub(in crate::light) fn blended(blend: Blend<'_>) -> f32 {
    total(blend.from) * (1.0 - blend.weight) + total(blend.to) * blend.weight
}

/// Returns light that is identified by the number of its frame.
fn light_of(number: i64) -> LightResult {
    LightResult {
        picture_arrived_at: frame(number),
        state: Some(light_state(33 * number, 1.0)),
        took: Duration::from_millis(5),
        picture_error: None,
        preview: None,
    }
}

/// Returns the frame number of the active light.
fn light_number(active: &ActiveLight) -> Option<i64> {
    let newest = active.lights.newest()?.captured_at()?;
    Some(newest.as_nanos() / 33_000_000)
}

fn composed(seen: bool, lit_by: i64) -> JournalEntry {
    JournalEntry::Composed(Some(LightRecord {
        seen,
        lit_by: Some(frame(lit_by)),
    }))
}

/// Replays journal entries, one for each frame from `first` on. Returns the frames whose light was
/// estimated and, for each frame, the number of the light in which it was composed.
fn replay(first: i64, entries: &[JournalEntry]) -> (Vec<i64>, Vec<Option<i64>>) {
    let (mut active, mut held) = (ActiveLight::default(), None);
    let (mut estimated, mut lit) = (Vec::new(), Vec::new());
    for (number, entry) in (first..).zip(entries) {
        follow_journal(&mut active, &mut held, [frame(number); 2], *entry, || {
            estimated.push(number);
            light_of(number)
        });
        lit.push(light_number(&active));
    }
    (estimated, lit)
}

#[test]
fn replay_holds_light_back_until_the_frame_in_the_journal() {
    let entries = [
        composed(true, 0),
        composed(true, 0),
        composed(false, 0),
        JournalEntry::Skipped,
        composed(true, 1),
        composed(true, 4),
    ];
    let (estimated, lit) = replay(0, &entries);
    assert_eq!(estimated, [0, 1, 4, 5]);
    assert_eq!(lit, [0, 0, 0, 0, 1, 4].map(Some));
}

#[test]
fn journal_without_light_uses_the_light_of_the_frame_composed_before() {
    let entries = [
        JournalEntry::Composed(None),
        JournalEntry::Composed(None),
        JournalEntry::Skipped,
        JournalEntry::Composed(None),
        JournalEntry::None,
    ];
    let (estimated, lit) = replay(0, &entries);
    assert_eq!(estimated, [0, 1, 3, 4]);
    assert_eq!(lit, [0, 0, 0, 1, 3].map(Some));
}

/// The recording lacks the light that was active when it began.
#[test]
fn recording_of_a_running_rig_synchronises_with_its_journal() {
    let entries = [
        composed(false, 7),
        composed(true, 7),
        composed(false, 7),
        composed(true, 11),
        composed(true, 13),
    ];
    let (estimated, lit) = replay(10, &entries);
    assert_eq!(estimated, [11, 13, 14]);
    assert_eq!(lit, [None, Some(11), Some(11), Some(11), Some(13)]);
}

/// Returns a light updater for a rig without an environment camera, so its estimates find no light.
fn updater() -> (LightUpdater, watch::Sender<Settings>) {
    let setup = RigSetup {
        pose: penumbra_config::PoseSource::Tracker,
        calibration: RigDocument::uncalibrated(64, 48).calibration,
        scene: Scene::default(),
        fixed_pose: None,
        tags: None,
        calibrated: false,
        same_product: false,
    };
    let estimator = LightEstimator::new(&setup, &Config::default(), &|_| None).unwrap();
    let (sender, requested) = watch::channel(Settings::default());
    (
        LightUpdater::new(
            estimator,
            requested,
            Technique::default(),
            2,
            SceneUpdates::default(),
        ),
        sender,
    )
}

fn request(number: i64) -> LightRequest {
    LightRequest {
        seconds: 0.0,
        sphere: crate::light::view::SphereAt::Calibrated,
        arrived_at: frame(number),
        captured_at: frame(number),
        exposure: None,
        world_from_camera: None,
        camera: RigDocument::uncalibrated(64, 48)
            .calibration
            .scene_camera
            .camera,
        environment: Some(Arc::new(EnvironmentSet {
            generation: number.unsigned_abs() + 1,
            captured_at: frame(number),
            arrived_at: frame(number),
            frames: Vec::new(),
        })),
    }
}

fn picture() -> Picture {
    Picture {
        width: 64,
        height: 48,
        rgba: vec![128; 64 * 48 * 4],
    }
}

#[test]
fn frames_wait_for_their_own_light_until_one_is_found() {
    let (updater, _sender) = updater();
    let mut lights = LightScheduler::live(updater).unwrap();
    for number in 0..3 {
        let record = lights.schedule(&request(number), &picture(), JournalEntry::None);
        let own = LightRecord {
            seen: true,
            lit_by: Some(frame(number)),
        };
        assert_eq!(record, Some(own));
        assert_eq!(
            lights.active_light().picture_arrived_at,
            Some(frame(number))
        );
    }
}

#[test]
fn lights_ahead_are_estimated_in_order_and_thinned_where_the_thread_is_slow() {
    let (jobs, waiting) = bounded(1);
    let (done, finished) = bounded(1);
    let mut worker = LightWorker::over(jobs, finished);
    let mut active = ActiveLight::exact();
    let next = || {
        waiting
            .try_recv()
            .ok()
            .map(|job: LightJob| (job.request.captured_at, job))
    };
    // Thirty pictures are read before the first is shown.
    for number in 0..30 {
        worker.schedule_ahead(&mut active, &request(number), &picture(), None);
    }
    let mut estimated = Vec::new();
    let mut shown = None;
    while let Some((at, job)) = next() {
        estimated.push(at.as_nanos() / frame(1).as_nanos());
        assert!(done.send((light_of(0), job)).is_ok());
        worker.poll(&mut active, shown);
        // From the third on, what is shown follows close behind.
        shown = (estimated.len() > 2).then(|| at.offset_nanos(-100_000_000));
    }
    assert!(estimated.is_sorted() && estimated[0] == 0, "{estimated:?}");
    assert_eq!(*estimated.last().unwrap(), 29, "{estimated:?}");
    let gap = estimated.windows(2).map(|w| w[1] - w[0]).max().unwrap();
    assert!(estimated.len() > 4 && gap <= 8, "{estimated:?}");
    assert_eq!(estimated.len() as u64 + worker.left_out, 30);
}

#[test]
fn light_ahead_stays_known_where_an_estimate_takes_six_pictures() {
    const AHEAD: i64 = 24;
    const TAKES: i64 = 6;
    let (jobs, waiting) = bounded::<LightJob>(1);
    let (done, finished) = bounded(1);
    let mut worker = LightWorker::over(jobs, finished);
    let mut active = ActiveLight::exact();
    for number in 0..AHEAD {
        worker.schedule_ahead(&mut active, &request(number), &picture(), None);
    }
    let (mut working, mut unknown) = (None, Vec::new());
    for shown in 0..300 {
        let read = request(shown + AHEAD);
        worker.schedule_ahead(&mut active, &read, &picture(), Some(frame(shown)));
        if let Some((_, job)) = working.take_if(|(ends, _)| *ends <= shown) {
            let job: LightJob = job;
            let number = job.request.captured_at.as_nanos() / frame(1).as_nanos();
            let light = LightResult {
                took: Duration::from_millis(33 * TAKES.unsigned_abs()),
                ..light_of(number)
            };
            assert!(done.send((light, job)).is_ok());
            worker.poll(&mut active, Some(frame(shown)));
        }
        working = working.or_else(|| Some((shown + TAKES, waiting.try_recv().ok()?)));
        if !active.lights.is_settled(frame(shown)) {
            unknown.push(shown);
        }
    }
    // Until the first estimates are there the lead must grow.
    let late = unknown.iter().filter(|shown| **shown > 60).count();
    assert_eq!(late, 0, "{unknown:?}");
}

#[test]
fn active_light_lets_frames_pass_with_one_estimate_at_a_time() {
    let (jobs, waiting) = bounded(1);
    let (done, finished) = bounded(1);
    let mut worker = LightWorker::over(jobs, finished);
    let mut active = ActiveLight::default();
    active.activate(light_of(0), frame(0));
    let mut schedule = |number| worker.schedule(&mut active, &request(number), &picture());
    let record = |seen, lit_by| LightRecord {
        seen,
        lit_by: Some(frame(lit_by)),
    };
    let begun = Instant::now();
    assert_eq!(schedule(1), record(true, 0));
    assert_eq!(schedule(2), record(false, 0));
    let job: LightJob = waiting.try_recv().unwrap();
    assert_eq!(job.picture, picture());
    assert!(done.send((light_of(1), job)).is_ok());
    assert_eq!(schedule(3), record(true, 1));
    assert_eq!(schedule(4), record(false, 1));
    assert_eq!(worker.left_out, 1);
    assert!(begun.elapsed() < Duration::from_secs(5));
    // A light of the recording's end is none of its beginning.
    let job = waiting.try_recv().unwrap();
    assert!(!job.restarts && done.send((light_of(3), job)).is_ok());
    worker.restart();
    assert_eq!(light_number(&active), Some(1));
    let mut schedule = |number| worker.schedule(&mut active, &request(number), &picture());
    assert_eq!(schedule(0), record(true, 1));
    let job = waiting.try_recv().unwrap();
    assert!(job.restarts && done.send((light_of(0), job)).is_ok());
    // The thread has ended; the light stays active.
    drop((waiting, done));
    assert_eq!(schedule(5), record(false, 0));
    assert_eq!(light_number(&active), Some(0));
    assert_eq!(worker.left_out, 1);
}
