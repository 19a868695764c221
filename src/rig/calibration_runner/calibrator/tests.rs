//! Steps that are made for the test, on replayed devices.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use super::*;
use glam::DVec2;
use penumbra_calibration::step::{Eye, Finished, Made as By, Progress, Shown, Wants};
use penumbra_capture::source::open_camera;
use penumbra_config::CameraSource;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_rig_model::Grade;
use penumbra_session::{Camera, SessionWriter};
use penumbra_status::calibration::CalibrationState;
use std::path::Path;
use std::time::Instant;

/// What a step of the test does.
#[derive(Clone, Copy, PartialEq)]
enum Habit {
    /// It has enough after three pictures.
    Modest,
    /// It never has enough.
    Greedy,
    /// It has a bug that the second picture shows.
    Buggy,
    /// It needs long to conclude.
    Slow,
}

struct Counted {
    habit: Habit,
    pictures: u32,
}

impl Step for Counted {
    fn name(&self) -> &'static str {
        "counted"
    }

    fn wants(&self) -> Wants {
        Wants {
            scene: true,
            environment: false,
            brackets: false,
            poses: false,
            spacing: 0.0,
        }
    }

    fn look(&mut self, shown: &Shown) {
        let Shown::Picture(shown) = shown else {
            panic!("nobody wanted poses");
        };
        assert_eq!((shown.eye, shown.picture.width), (Eye::Scene, 16));
        self.pictures += 1;
        assert!(
            self.habit != Habit::Buggy || self.pictures < 2,
            "on purpose"
        );
    }

    fn progress(&self) -> Progress {
        let enough = match self.habit {
            Habit::Greedy | Habit::Slow => 1e6,
            Habit::Modest | Habit::Buggy => 3.0,
        };
        Progress {
            share: f64::from(self.pictures) / enough,
            message: format!("{} pictures", self.pictures),
            hint: "wait".to_owned(),
            marks: vec![DVec2::new(3.0, 4.0), DVec2::NAN],
            eye: Some(Eye::Scene),
        }
    }

    fn finish(&mut self, made: &By) -> Finished {
        if self.habit == Habit::Slow {
            std::thread::sleep(Duration::from_millis(400));
        }
        assert_eq!(made.source, "live");
        let device = made.device.clone().unwrap_or_default();
        Finished {
            grade: Grade::Usable,
            lines: vec![format!("{} of {device}", self.pictures)],
            findings: vec![(Grade::Usable, "few".to_owned())],
            hints: vec!["more".to_owned()],
            page: "<!doctype html>".to_owned(),
            file: Some("{}\n".to_owned()),
        }
    }
}

/// A session of three seconds of a grey picture, at 20 a second.
fn session(path: &Path) {
    let mut writer = SessionWriter::create(path).unwrap();
    for i in 0..60_i64 {
        let at = MonotonicTime::from_nanos(1_000_000_000 + 50_000_000 * i);
        let frame = Frame {
            data: vec![128; 16 * 8].into(),
            format: PixelFormat::Grey8,
            width: 16,
            height: 8,
            stride: 0,
            sequence: i.unsigned_abs(),
            captured_at: at,
            arrived_at: at,
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        };
        writer.frame(Camera::Scene, &frame).unwrap();
    }
    writer.finish().unwrap();
}

/// A rig with one camera, whose files are in a folder.
struct Bench {
    folder: tempfile::TempDir,
    live: Live,
    calibrator: Arc<Calibrator>,
}

impl Bench {
    fn new(habit: Habit) -> Self {
        let folder = tempfile::tempdir().unwrap();
        session(&folder.path().join("camera.mcap"));
        let camera = CameraSource::Replay(folder.path().join("camera.mcap"));
        Self::on(folder, habit, camera)
    }

    fn on(folder: tempfile::TempDir, habit: Habit, camera: CameraSource) -> Self {
        let mut config = Config::default();
        config.scene_camera.source = camera;
        config.calibration = Some(folder.path().to_owned());
        let live = Live::new(&config, false).unwrap();
        let calibrator = Calibrator::with_steps(&live, &config, maker(habit));
        live.open().unwrap();
        Self {
            folder,
            live,
            calibrator,
        }
    }

    fn start(&self) -> Result<(), CalibrationRefusal> {
        self.calibrator.start(&CalibrationRequest {
            step: "counted".to_owned(),
            ..CalibrationRequest::default()
        })
    }

    fn until(&self, what: &str, holds: impl Fn(&Calibration) -> bool) -> Calibration {
        let begun = Instant::now();
        loop {
            let view = self.calibrator.view();
            if holds(&view) {
                return view;
            }
            assert!(
                begun.elapsed() < Duration::from_secs(60),
                "{what}: {view:?}"
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn calibrations(&self) -> usize {
        let files = std::fs::read_dir(self.folder.path().join("calibration"));
        files.map_or(0, Iterator::count)
    }
}

fn maker(habit: Habit) -> Box<StepMaker> {
    Box::new(move |wish, known| {
        let mut made = step_of("intrinsics", &wish.parameters, known).unwrap();
        made.step = Box::new(Counted { habit, pictures: 0 });
        Ok(made)
    })
}

#[test]
fn a_step_that_has_enough_is_written_and_the_next_keeps_it() {
    let bench = Bench::new(Habit::Modest);
    assert_eq!(bench.calibrator.view().state, CalibrationState::Idle);
    assert!(bench.calibrator.finish().is_err() && bench.calibrator.report().is_none());
    bench.start().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(
        view.state,
        CalibrationState::Finished,
        "{}",
        view.description
    );
    let result = view.result.unwrap();
    assert!(
        result.lines[0].contains("camera.mcap"),
        "{:?}",
        result.lines
    );
    let file = bench.folder.path().join("calibration/counted.json");
    assert_eq!(result.file.as_deref(), file.to_str());
    assert_eq!((result.backup, result.report), (None, true));
    assert_eq!(
        bench.calibrator.report().as_deref(),
        Some("<!doctype html>")
    );
    // The picture was kept, as somebody had asked; what is no place is no mark.
    let picture = view.picture.unwrap();
    assert_eq!((picture.width, picture.points), (16, vec![[3.0, 4.0]]));
    assert!(bench.calibrator.picture(Some(picture.revision)).is_some());
    bench.start().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert!(view.result.unwrap().backup.is_some());
    assert_eq!(bench.calibrations(), 4);
}

#[test]
fn one_at_a_time_and_an_aborted_one_leaves_nothing() {
    let bench = Bench::new(Habit::Greedy);
    bench.start().unwrap();
    let again = bench.start().unwrap_err().to_string();
    assert!(again.contains("`counted` is under way"), "{again}");
    bench.until("pictures", |v| v.pictures > 2);
    bench.calibrator.abort().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!((view.state, view.result), (CalibrationState::Idle, None));
    assert_eq!(bench.calibrations(), 0);
    bench.start().unwrap();
    bench.until("pictures", |v| v.pictures > 2);
    bench.calibrator.finish().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Finished);
}

#[test]
fn what_is_aborted_while_it_concludes_is_not_written() {
    let bench = Bench::new(Habit::Slow);
    bench.start().unwrap();
    bench.until("pictures", |v| v.pictures > 0);
    bench.calibrator.finish().unwrap();
    bench.until("it concludes", |v| v.state == CalibrationState::Evaluating);
    bench.calibrator.abort().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Idle);
    assert_eq!(bench.calibrations(), 0);
}

#[cfg(target_os = "linux")]
#[test]
fn what_cannot_be_written_is_told_and_still_shown() {
    let bench = Bench::new(Habit::Greedy);
    bench.start().unwrap();
    bench.until("pictures", |v| v.pictures > 2);
    // The kernel's disk that is always full.
    let part = bench.folder.path().join("calibration/.counted.json.part");
    std::os::unix::fs::symlink("/dev/full", part).unwrap();
    bench.calibrator.finish().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Failed);
    assert!(
        view.description.contains("could not be written")
            && view.description.contains("free space"),
        "{}",
        view.description
    );
    let result = view.result.unwrap();
    assert_eq!((result.file, result.report), (None, true));
    assert_eq!(result.findings[0].text, "few");
    assert_eq!(bench.calibrations(), 0);
}

#[test]
fn a_bug_in_a_step_is_told_and_takes_nothing_else_along() {
    let bench = Bench::new(Habit::Buggy);
    for _ in 0..2 {
        bench.start().unwrap();
        let view = bench.until("it ends", |v| !v.state.is_busy());
        assert_eq!(view.state, CalibrationState::Failed);
        assert!(view.description.contains("a bug in the step `counted`"));
        // The thread is on its way out when it says so.
        std::thread::sleep(Duration::from_millis(50));
    }
    let received = || bench.live.supervised()[0].status().received;
    let before = received();
    std::thread::sleep(Duration::from_millis(300));
    assert!(received() > before, "the camera goes on");
}

#[test]
fn a_camera_that_is_away_is_told_and_awaited() {
    let folder = tempfile::tempdir().unwrap();
    session(&folder.path().join("unplugged.mcap"));
    let camera = CameraSource::Replay(folder.path().join("camera.mcap"));
    let bench = Bench::on(folder, Habit::Modest, camera);
    bench.start().unwrap();
    let view = bench.until("it says so", |v| v.device_error.is_some());
    let trouble = view.device_error.unwrap();
    assert!(
        trouble.contains("scene camera") && trouble.contains("not there"),
        "{trouble}"
    );
    let path = |name: &str| bench.folder.path().join(name);
    std::fs::rename(path("unplugged.mcap"), path("camera.mcap")).unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(
        view.state,
        CalibrationState::Finished,
        "{}",
        view.description
    );
}

#[test]
fn a_camera_that_is_unplugged_in_the_middle_is_waited_for() {
    use penumbra_capture::source::Recordings;
    use penumbra_faulty::{Fault, FaultyCamera, Plan};
    use penumbra_interface::DeviceFactory;
    use penumbra_interface::{Camera as Driver, DeviceError};
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.mcap");
    session(&path);
    let gone = || DeviceError::NotFound {
        device: "the camera".to_owned(),
    };
    let (opened, plugged) = (AtomicU32::new(0), Arc::new(AtomicBool::new(false)));
    let is_there = Arc::clone(&plugged);
    let maker = DeviceFactory::new("the camera", move |clock| {
        let first = opened.fetch_add(1, Ordering::Relaxed) == 0;
        if !first && !is_there.load(Ordering::Relaxed) {
            return Err(gone());
        }
        let source = CameraSource::Replay(path.clone());
        let inner = open_camera(&source, Camera::Scene, &Recordings::default(), clock)?;
        let plan = if first {
            Plan::new([
                (3, Fault::CutShort { share: 0.5 }),
                (3, Fault::Error(gone())),
            ])
        } else {
            Plan::default()
        };
        Ok(Box::new(FaultyCamera::new(inner, plan)) as Box<dyn Driver>)
    });
    let bench = Bench::on(folder, Habit::Greedy, CameraSource::Custom(maker));
    bench.start().unwrap();
    let view = bench.until("it says so", |v| v.device_error.is_some());
    assert!(
        view.device_error.unwrap().contains("scene camera"),
        "{}",
        view.description
    );
    let before = view.pictures;
    plugged.store(true, Ordering::Relaxed);
    let view = bench.until("it goes on", |v| {
        v.pictures > before + 3 && v.device_error.is_none()
    });
    assert!(
        view.state.is_busy() && view.damaged <= 1,
        "{}",
        view.damaged
    );
    bench.calibrator.finish().unwrap();
    let view = bench.until("it ends", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Finished);
}

#[test]
fn when_the_rig_is_closed_nothing_is_written() {
    let bench = Bench::new(Habit::Greedy);
    bench.start().unwrap();
    bench.until("pictures", |v| v.pictures > 2);
    let Bench {
        folder,
        live,
        calibrator,
    } = bench;
    drop(live);
    let begun = Instant::now();
    while calibrator.view().state.is_busy() {
        assert!(begun.elapsed() < Duration::from_secs(10));
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(calibrator.view().state, CalibrationState::Idle);
    assert_eq!(
        std::fs::read_dir(folder.path().join("calibration"))
            .unwrap()
            .count(),
        0
    );
}

#[test]
fn what_cannot_begin_is_refused_in_one_line() {
    let bench = Bench::new(Habit::Modest);
    let refused = |config: &Config, wish: &CalibrationRequest, says: &str| {
        let calibrator = Calibrator::new(&bench.live, config);
        let refusal = calibrator.start(wish).unwrap_err().to_string();
        assert!(
            refusal.contains(says) && !refusal.contains('\n'),
            "{refusal}"
        );
        assert_eq!(calibrator.view().state, CalibrationState::Idle);
    };
    let mut config = Config::default();
    let mut wish = CalibrationRequest {
        step: "intrinsics".to_owned(),
        ..CalibrationRequest::default()
    };
    refused(&config, &wish, "[calibration] from is not set");
    config.calibration = Some(bench.folder.path().join("camera.mcap"));
    refused(&config, &wish, "is no folder");
    config.calibration = Some(bench.folder.path().to_owned());
    wish.parameters
        .insert("camera".to_owned(), "environment".to_owned());
    refused(&config, &wish, "no environment camera");
    wish.parameters.insert("board".to_owned(), "12".to_owned());
    refused(&config, &wish, "write chess:");
    wish.step = "soup".to_owned();
    refused(&config, &wish, "there is no step `soup`");
}
