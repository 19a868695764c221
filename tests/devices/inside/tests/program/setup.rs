//! A rig's configuration, its recorder and its tracker.

use penumbra_guest::program::Running;
use penumbra_guest::recording::attachments;
use penumbra_guest::rig::{ENVIRONMENT, OUT, SCENE, TRACKER, VIVID, ready};
use penumbra_guest::serial;
use serde_json::{Value, json};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// Locked controls of the scene camera: normal exposure, greys are rendered grey.
pub const LOCKED: [(&str, i32); 5] = [
    ("auto_exposure", 1),
    ("exposure_time_absolute", 157),
    ("gain", 32),
    ("white_balance_automatic", 0),
    ("white_balance_temperature", 5000),
];

/// The environment camera.
pub enum Light {
    /// The second emulated USB camera.
    Usb,
    /// One of vivid's cameras, which send raw pictures.
    Vivid,
}

/// Writes the desk's calibration with the fisheye's circle centred in the environment camera's
/// larger picture.
fn calibration(folder: &Path) {
    for (name, bytes) in attachments(Path::new("/tests/desk.mcap")) {
        let path = folder.join(&name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let mut bytes = bytes;
        if name == "rig.json" {
            let mut rig: Value = serde_json::from_slice(&bytes).unwrap();
            let camera = &mut rig["environment_camera"];
            camera["image_size"] = json!([640, 480]);
            camera["projection"]["cx"] = json!(319.5);
            camera["projection"]["cy"] = json!(239.5);
            bytes = rig.to_string().into_bytes();
        }
        std::fs::write(path, bytes).unwrap();
    }
}

/// Writes a rig's configuration.
pub fn config(folder: &Path, light: &Light, with_tracker: bool) -> PathBuf {
    let controls: String = LOCKED
        .iter()
        .map(|(name, value)| format!("{name} = {value}\n"))
        .collect();
    let environment = match light {
        Light::Usb => format!("device = \"{ENVIRONMENT}\"\nformats = [\"mjpeg\"]\n"),
        Light::Vivid => format!("device = \"{VIVID}\"\nformats = [\"yuyv\"]\n"),
    };
    let tracker = if with_tracker {
        format!("[tracker]\ndevice = \"{TRACKER}\"\nprotocol = \"fastrak\"\n")
    } else {
        String::new()
    };
    calibration(&folder.join("calibration"));
    let size = "width = 640\nheight = 480\n";
    let text = format!(
        "[scene_camera]\ndevice = \"{SCENE}\"\nformats = [\"mjpeg\"]\n{size}\
         frames_per_second = 30\non_control_change = \"restore\"\n\
         [scene_camera.controls]\n{controls}\
         [environment_camera]\n{environment}{size}{tracker}\
         [calibration]\nfrom = \"calibration\"\n[recording]\nreserve_mb = 10\n[status]\nlisten = \"127.0.0.1:0\"\n"
    );
    let path = folder.join("rig.toml");
    std::fs::write(&path, text).unwrap();
    path
}

/// A running recorder with its own folder in memory.
pub struct Recorder {
    /// The recording.
    pub file: PathBuf,
    /// The program.
    pub program: Running,
}

/// Starts to record the rig; `more` are additional arguments.
pub fn record(name: &str, light: &Light, with_tracker: bool, more: &[&str]) -> Recorder {
    ready();
    let folder = Path::new("/tmp").join(name);
    std::fs::create_dir_all(&folder).unwrap();
    let config = config(&folder, light, with_tracker);
    start(name, &config, more)
}

/// Starts to record with a configuration.
pub fn start(name: &str, config: &Path, more: &[&str]) -> Recorder {
    let file = config.with_file_name("session.mcap");
    let mut arguments = vec![
        "record",
        file.to_str().unwrap(),
        "--config",
        config.to_str().unwrap(),
    ];
    arguments.extend(more);
    let log = Path::new(OUT).join(format!("tests/program.{name}.program.log"));
    Recorder {
        program: Running::start(&arguments, &log),
        file,
    }
}

/// Copies a recording to the host's folder.
pub fn keep(file: &Path, name: &str) {
    let folder = Path::new(OUT).join("recordings");
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::copy(file, folder.join(name)).unwrap();
}

/// A simulated FASTRAK at the device's end of the tracker's USB cable.
pub struct SimulatedTracker(Running);

impl SimulatedTracker {
    /// Starts the simulator on a pseudo-terminal, which two threads connect to the cable.
    pub fn start() -> Self {
        ready();
        let terminal = "/tmp/simulated-fastrak";
        let arguments = [
            "simulate",
            "tracker",
            "--protocol",
            "fastrak",
            "--pty",
            terminal,
        ];
        let log = Path::new(OUT).join("tests/program.simulator.log");
        let mut simulator = Running::start(&arguments, &log);
        simulator.wait_until("its terminal exists", |_| Path::new(terminal).exists());
        join(serial::open(terminal), serial::open("/dev/ttyGS0"));
        Self(simulator)
    }

    /// Ends the simulator, which must succeed.
    pub fn stop(self) {
        self.0.stop();
    }
}

/// Copies bytes in both directions until either end hangs up.
fn join(a: std::fs::File, b: std::fs::File) {
    let ends = [(a.try_clone().unwrap(), b.try_clone().unwrap()), (b, a)];
    for (mut from, mut to) in ends {
        std::thread::spawn(move || {
            let mut bytes = [0; 4096];
            while let Ok(count @ 1..) = from.read(&mut bytes) {
                if to.write_all(&bytes[..count]).is_err() {
                    return;
                }
            }
        });
    }
}
