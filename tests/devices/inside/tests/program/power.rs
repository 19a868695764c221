//! A recording on a disk that loses its power. `tests/devices/power_cut.py` gives the guest the disk
//! and judges what is left.

use crate::record::monotonic_nanos;
use crate::setup::{Light, SimulatedTracker, config, start};
use penumbra_guest::program::succeeds;
use penumbra_guest::rig::OUT;
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions};
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const DISK: &str = "/dev/vda";
const FOLDER: &str = "/tmp/disk";
/// Where the clock is written: a part of the same disk behind the file system, which the host gives
/// a device of its own.
const CLOCK: &str = "/dev/vdb";

/// What a write past the page cache requires.
#[repr(align(4096))]
struct Block([u8; 4096]);

fn mount() {
    std::fs::create_dir_all(FOLDER).unwrap();
    let mounted = Command::new("mount")
        .args(["-t", "ext4", DISK, FOLDER])
        .status();
    assert!(mounted.unwrap().success(), "cannot mount {DISK}");
}

/// Writes the clock to the disk, so that it is among the disk's writes when each of them was made.
/// Not flushed: a flush would save the recording, too.
fn write_clock(disk: &File) {
    let mut block = Block([0; 4096]);
    block.0[..8].copy_from_slice(&monotonic_nanos().to_le_bytes());
    disk.write_all_at(&block.0, 0).unwrap();
}

#[test]
#[ignore = "needs the guest: make power-cut"]
fn records_until_the_power_is_cut() {
    mount();
    let _tracker = SimulatedTracker::start();
    let folder = Path::new(FOLDER);
    let config = config(folder, &Light::Usb, true);
    let recorder = start("power", &config, &[]);
    let mut options = OpenOptions::new();
    let direct = OFlags::DIRECT.bits() as i32;
    let clock = options.write(true).custom_flags(direct).open(CLOCK);
    let clock = clock.unwrap();
    let began = Instant::now();
    let seconds = std::fs::read_to_string(Path::new(OUT).join("record-seconds")).unwrap();
    let wanted = Duration::from_secs_f64(seconds.trim().parse().unwrap());
    let mut recording_since = None;
    // The host ends the guest after it has recorded long enough.
    loop {
        write_clock(&clock);
        std::thread::sleep(Duration::from_millis(20));
        let size = std::fs::metadata(&recorder.file).map_or(0, |metadata| metadata.len());
        if size > 1 << 20 && recording_since.is_none() {
            recording_since = Some(Instant::now());
        }
        let is_late = recording_since.is_none() && began.elapsed() > Duration::from_secs(60);
        assert!(
            !is_late,
            "nothing is recorded:\n{}",
            recorder.program.output()
        );
        let recorded = recording_since.map_or(Duration::ZERO, |since| since.elapsed());
        if recorded > wanted {
            std::fs::write(Path::new(OUT).join("enough"), "").unwrap();
        }
        assert!(
            recorded < wanted + Duration::from_secs(300),
            "the power stays"
        );
    }
}

/// After the cut the kernel mounts the disk, and the program reads the session.
#[test]
#[ignore = "needs the guest: make power-cut"]
fn reads_what_the_power_cut_left() {
    mount();
    let session = Path::new(FOLDER).join("session.mcap");
    let info = succeeds(&["info", session.to_str().unwrap()]);
    assert!(info.contains("/scene_camera/image"), "{info}");
    std::fs::copy(&session, Path::new(OUT).join("left.mcap")).unwrap();
}
