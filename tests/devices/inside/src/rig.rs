//! The guest's devices, by the names that a rig's configuration uses.

use penumbra_usbcam::jpeg::BLOCK;
use penumbra_usbcam::picture::{MIDDLE_GREY, light, middle_of_patch, number};
use std::io::{Read, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The emulated scene camera.
pub const SCENE: &str = "/dev/v4l/by-id/usb-Penumbra_Scene_Camera_SC0001-video-index0";
/// The emulated environment camera.
pub const ENVIRONMENT: &str = "/dev/v4l/by-id/usb-Penumbra_Environment_Camera_EC0001-video-index0";
/// One of vivid's two cameras: both have the same path, so only one has this name.
pub const VIVID: &str = "/dev/v4l/by-path/platform-vivid.0-video-index0";
/// The host's end of the tracker's cable.
pub const TRACKER: &str = "/dev/serial/by-id/usb-Polhemus_FASTRAK_FT0001-if00";
/// Folder for files that a test leaves for the host.
pub const OUT: &str = "/out";

const EMULATOR: &str = "/run/usbcam";
const TRACKER_PLUG: &str = "/sys/kernel/config/usb_gadget/tracker/UDC";

/// Waits until all devices exist, as every test expects.
pub fn ready() {
    for device in [SCENE, ENVIRONMENT, TRACKER, "/dev/ttyGS0"] {
        wait_until(&format!("{device} is there"), || Path::new(device).exists());
    }
}

/// Waits up to ten seconds for a condition.
pub fn wait_until(what: &str, is_true: impl Fn() -> bool) {
    let began = Instant::now();
    while !is_true() {
        assert!(began.elapsed() < Duration::from_secs(10), "never: {what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

/// Sends a command to the camera emulator (`penumbra_usbcam::command::HELP`); returns the answer.
pub fn usbcam(command: &str) -> String {
    let mut stream = UnixStream::connect(EMULATOR).expect("the emulator listens");
    writeln!(stream, "{command}").unwrap();
    stream.shutdown(Shutdown::Write).unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(!answer.starts_with("error"), "{command}: {answer}");
    answer.trim().to_owned()
}

/// Plugs the tracker in or unplugs it.
pub fn plug_tracker(plugged: bool) {
    std::fs::write(TRACKER_PLUG, if plugged { "dummy_udc.0" } else { "\n" }).unwrap();
}

/// Nodes of vivid's cameras.
pub fn vivid() -> Vec<PathBuf> {
    let name = |entry: &Path| std::fs::read_to_string(entry.join("name")).unwrap_or_default();
    let entries = std::fs::read_dir("/sys/class/video4linux")
        .unwrap()
        .flatten();
    let mut nodes: Vec<_> = entries
        .filter(|entry| name(&entry.path()).starts_with("vivid-"))
        .map(|entry| Path::new("/dev").join(entry.file_name()))
        .collect();
    nodes.sort();
    nodes
}

/// The data that a frame of the emulated cameras encodes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Its number since the camera was plugged in.
    pub number: u32,
    /// Exposure and gain relative to the normal ones, linear.
    pub light: f64,
    /// Blue minus red difference of a grey patch, code values.
    pub tint: f64,
}

/// Reads an emulated camera's JPEG.
pub fn read_jpeg(data: &[u8]) -> Reading {
    let picture = turbojpeg::decompress_to_yuv(data).expect("a complete JPEG");
    let (width, height) = (picture.width, picture.height);
    let (x, y) = middle_of_patch(MIDDLE_GREY, width, height);
    let chroma = |plane: usize| {
        let begin = width * height + plane * (width / 2) * (height / 2);
        f64::from(picture.pixels[begin + (y / 2) * (width / 2) + x / 2])
    };
    assert!(width.is_multiple_of(BLOCK) && height.is_multiple_of(BLOCK));
    Reading {
        number: number(&picture.pixels, width),
        light: light(picture.pixels[y * width + x], 0.18),
        tint: chroma(0) - chroma(1),
    }
}
