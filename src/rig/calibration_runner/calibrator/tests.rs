//! Tests of the calibrator with artificial steps on replayed devices.

use super::*;
use glam::DVec2;
use penumbra_calibration::step::{
    CalibrationProvenance, CameraRole, Finished, Progress, StepInput, StepInputs,
};
use penumbra_capture::source::open_camera;
use penumbra_config::CameraSource;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_rig_model::Grade;
use penumbra_session::{Camera, SessionWriter};
use penumbra_status::calibration::CalibrationState;
use std::path::Path;
use std::time::Instant;

/// Behaviour of a test step.
#[derive(Clone, Copy, PartialEq)]
enum Behaviour {
    /// Complete after three pictures.
    Complete,
    /// Never complete.
    Endless,
    /// Panics at the second picture.
    Panicking,
    /// Never complete, and slow to evaluate.
    Slow,
}

/// A step that counts its pictures.
struct CountingStep {
    behaviour: Behaviour,
    pictures: u32,
}

impl Step for CountingStep {
    fn name(&self) -> &'static str {
        "counted"
    }

    fn inputs(&self) -> StepInputs {
        StepInputs {
            scene: true,
            environment: false,
            brackets: false,
            poses: false,
            spacing: 0.0,
        }
    }

    fn observe(&mut self, shown: &StepInput) {
        let StepInput::Picture(shown) = shown else {
            panic!("got a pose, which the step does not need");
        };
        assert_eq!((shown.camera, shown.picture.width), (CameraRole::Scene, 16));
        self.pictures += 1;
        assert!(
            self.behaviour != Behaviour::Panicking || self.pictures < 2,
            "intended panic"
        );
    }

    fn progress(&self) -> Progress {
        let needed = match self.behaviour {
            Behaviour::Endless | Behaviour::Slow => 1e6,
            Behaviour::Complete | Behaviour::Panicking => 3.0,
        };
        Progress {
            share: f64::from(self.pictures) / needed,
            message: format!("{} pictures", self.pictures),
            hint: "wait".to_owned(),
            overlay_points: vec![DVec2::new(3.0, 4.0), DVec2::NAN],
            camera: Some(CameraRole::Scene),
        }
    }

    fn finish(&mut self, made: &CalibrationProvenance) -> Finished {
        if self.behaviour == Behaviour::Slow {
            std::thread::sleep(Duration::from_millis(400));
        }
        assert_eq!(made.source, "live");
        let device = made.device.clone().unwrap_or_default();
        Finished {
            grade: Grade::Usable,
            lines: vec![format!("{} of {device}", self.pictures)],
            findings: vec![(Grade::Usable, "few".to_owned())],
            hints: vec!["more".to_owned()],
            report: "<!doctype html>".to_owned(),
            file: Some("{}\n".to_owned()),
        }
    }
}

/// Writes a session of three seconds of a grey picture at 20 pictures per second.
fn write_session(path: &Path) {
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

/// A live rig with one camera and a folder of files.
struct TestRig {
    folder: tempfile::TempDir,
    live: Live,
    calibrator: Arc<Calibrator>,
}

impl TestRig {
    fn new(behaviour: Behaviour) -> Self {
        let folder = tempfile::tempdir().unwrap();
        write_session(&folder.path().join("camera.mcap"));
        let camera = CameraSource::Replay(folder.path().join("camera.mcap"));
        Self::with_camera(folder, behaviour, camera)
    }

    fn with_camera(folder: tempfile::TempDir, behaviour: Behaviour, camera: CameraSource) -> Self {
        let mut config = Config::default();
        config.scene_camera.source = camera;
        config.calibration = Some(folder.path().to_owned());
        let live = Live::new(&config, false).unwrap();
        let calibrator = Calibrator::with_steps(&live, &config, step_maker(behaviour));
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

    /// Waits until the view satisfies `condition`.
    fn wait_for(&self, what: &str, condition: impl Fn(&Calibration) -> bool) -> Calibration {
        let started_at = Instant::now();
        loop {
            let view = self.calibrator.view();
            if condition(&view) {
                return view;
            }
            assert!(
                started_at.elapsed() < Duration::from_secs(60),
                "{what}: {view:?}"
            );
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    /// Returns the number of files in the calibration folder.
    fn calibration_files(&self) -> usize {
        let files = std::fs::read_dir(self.folder.path().join("calibration"));
        files.map_or(0, Iterator::count)
    }
}

fn step_maker(behaviour: Behaviour) -> Box<StepMaker> {
    Box::new(move |request, context| {
        let mut prepared = make_step("intrinsics", &request.parameters, context).unwrap();
        prepared.step = Box::new(CountingStep {
            behaviour,
            pictures: 0,
        });
        Ok(prepared)
    })
}

#[test]
fn complete_step_writes_a_calibration_and_the_next_run_backs_it_up() {
    let rig = TestRig::new(Behaviour::Complete);
    assert_eq!(rig.calibrator.view().state, CalibrationState::Idle);
    assert!(rig.calibrator.finish().is_err() && rig.calibrator.report().is_none());
    rig.start().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
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
    let file = rig.folder.path().join("calibration/counted.json");
    assert_eq!(result.file.as_deref(), file.to_str());
    assert_eq!((result.backup, result.report), (None, true));
    assert_eq!(rig.calibrator.report().as_deref(), Some("<!doctype html>"));
    // The preview exists because the state was read recently; overlay points that are not finite
    // are omitted.
    let picture = view.picture.unwrap();
    assert_eq!((picture.width, picture.points), (16, vec![[3.0, 4.0]]));
    assert!(rig.calibrator.picture(Some(picture.revision)).is_some());
    rig.start().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert!(view.result.unwrap().backup.is_some());
    assert_eq!(rig.calibration_files(), 4);
}

#[test]
fn one_step_runs_at_a_time_and_an_aborted_one_writes_nothing() {
    let rig = TestRig::new(Behaviour::Endless);
    rig.start().unwrap();
    let again = rig.start().unwrap_err().to_string();
    assert!(again.contains("`counted` is running"), "{again}");
    rig.wait_for("pictures", |v| v.pictures > 2);
    rig.calibrator.abort().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert_eq!((view.state, view.result), (CalibrationState::Idle, None));
    assert_eq!(rig.calibration_files(), 0);
    rig.start().unwrap();
    rig.wait_for("pictures", |v| v.pictures > 2);
    rig.calibrator.finish().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Finished);
}

#[test]
fn abort_during_evaluation_writes_nothing() {
    let rig = TestRig::new(Behaviour::Slow);
    rig.start().unwrap();
    rig.wait_for("pictures", |v| v.pictures > 0);
    rig.calibrator.finish().unwrap();
    rig.wait_for("evaluation", |v| v.state == CalibrationState::Evaluating);
    rig.calibrator.abort().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Idle);
    assert_eq!(rig.calibration_files(), 0);
}

#[cfg(target_os = "linux")]
#[test]
fn result_that_cannot_be_written_is_reported_and_shown() {
    let rig = TestRig::new(Behaviour::Endless);
    rig.start().unwrap();
    rig.wait_for("pictures", |v| v.pictures > 2);
    // Writing to /dev/full fails as on a full disk.
    let part = rig.folder.path().join("calibration/.counted.json.part");
    std::os::unix::fs::symlink("/dev/full", part).unwrap();
    rig.calibrator.finish().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
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
    assert_eq!(rig.calibration_files(), 0);
}

#[test]
fn panic_of_a_step_is_reported_and_the_camera_continues() {
    let rig = TestRig::new(Behaviour::Panicking);
    for _ in 0..2 {
        rig.start().unwrap();
        let view = rig.wait_for("the end", |v| !v.state.is_busy());
        assert_eq!(view.state, CalibrationState::Failed);
        assert!(view.description.contains("a bug in the step `counted`"));
        // The thread ends shortly after it has reported the failure.
        std::thread::sleep(Duration::from_millis(50));
    }
    let received = || rig.live.supervised()[0].status().received;
    let before = received();
    std::thread::sleep(Duration::from_millis(300));
    assert!(received() > before, "the camera continues");
}

#[test]
fn missing_camera_is_reported_and_awaited() {
    let folder = tempfile::tempdir().unwrap();
    write_session(&folder.path().join("unplugged.mcap"));
    let camera = CameraSource::Replay(folder.path().join("camera.mcap"));
    let rig = TestRig::with_camera(folder, Behaviour::Complete, camera);
    rig.start().unwrap();
    let view = rig.wait_for("a device problem", |v| v.device_error.is_some());
    let trouble = view.device_error.unwrap();
    assert!(
        trouble.contains("scene camera") && trouble.contains("not connected"),
        "{trouble}"
    );
    let path = |name: &str| rig.folder.path().join(name);
    std::fs::rename(path("unplugged.mcap"), path("camera.mcap")).unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert_eq!(
        view.state,
        CalibrationState::Finished,
        "{}",
        view.description
    );
}

#[test]
fn camera_unplugged_during_a_step_is_awaited() {
    use penumbra_capture::source::Recordings;
    use penumbra_faulty::{Fault, FaultyCamera, Plan};
    use penumbra_interface::DeviceFactory;
    use penumbra_interface::{Camera as Driver, DeviceError};
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("camera.mcap");
    write_session(&path);
    let gone = || DeviceError::NotFound {
        device: "the camera".to_owned(),
    };
    let (opened, plugged_in) = (AtomicU32::new(0), Arc::new(AtomicBool::new(false)));
    let is_plugged_in = Arc::clone(&plugged_in);
    let factory = DeviceFactory::new("the camera", move |clock| {
        let first = opened.fetch_add(1, Ordering::Relaxed) == 0;
        if !first && !is_plugged_in.load(Ordering::Relaxed) {
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
    let rig = TestRig::with_camera(folder, Behaviour::Endless, CameraSource::Custom(factory));
    rig.start().unwrap();
    let view = rig.wait_for("a device problem", |v| v.device_error.is_some());
    assert!(
        view.device_error.unwrap().contains("scene camera"),
        "{}",
        view.description
    );
    let before = view.pictures;
    plugged_in.store(true, Ordering::Relaxed);
    let view = rig.wait_for("more pictures", |v| {
        v.pictures > before + 3 && v.device_error.is_none()
    });
    assert!(
        view.state.is_busy() && view.damaged <= 1,
        "{}",
        view.damaged
    );
    rig.calibrator.finish().unwrap();
    let view = rig.wait_for("the end", |v| !v.state.is_busy());
    assert_eq!(view.state, CalibrationState::Finished);
}

#[test]
fn closing_the_rig_writes_nothing() {
    let rig = TestRig::new(Behaviour::Endless);
    rig.start().unwrap();
    rig.wait_for("pictures", |v| v.pictures > 2);
    let TestRig {
        folder,
        live,
        calibrator,
    } = rig;
    drop(live);
    let started_at = Instant::now();
    while calibrator.view().state.is_busy() {
        assert!(started_at.elapsed() < Duration::from_secs(10));
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
fn rejects_steps_that_cannot_start_in_one_line() {
    let rig = TestRig::new(Behaviour::Complete);
    let assert_refused = |config: &Config, request: &CalibrationRequest, expected: &str| {
        let calibrator = Calibrator::new(&rig.live, config);
        let refusal = calibrator.start(request).unwrap_err().to_string();
        assert!(
            refusal.contains(expected) && !refusal.contains('\n'),
            "{refusal}"
        );
        assert_eq!(calibrator.view().state, CalibrationState::Idle);
    };
    let mut config = Config::default();
    let mut request = CalibrationRequest {
        step: "intrinsics".to_owned(),
        ..CalibrationRequest::default()
    };
    assert_refused(&config, &request, "[calibration] from is not set");
    config.calibration = Some(rig.folder.path().join("camera.mcap"));
    assert_refused(&config, &request, "is not a folder");
    config.calibration = Some(rig.folder.path().to_owned());
    request
        .parameters
        .insert("camera".to_owned(), "environment".to_owned());
    assert_refused(&config, &request, "no environment camera");
    request
        .parameters
        .insert("board".to_owned(), "12".to_owned());
    assert_refused(&config, &request, "write chess:");
    request.step = "soup".to_owned();
    assert_refused(&config, &request, "there is no step `soup`");
}
