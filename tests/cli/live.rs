//! The live rig, with replayed devices instead of real ones.

use crate::program::{Desk, desk_session, text};
use crate::service::get;
use penumbra_interface::{Clock, SystemClock};
use penumbra_session::{Session, SessionEvent};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Writes the configuration of a calibrated rig of replayed devices.
fn configure(desk: &Desk, session: &str) {
    let calibration = desk_session().display().to_string();
    let text = format!(
        "[scene_camera]\ndevice = \"replay:{session}\"\n[environment_camera]\ndevice = \
         \"replay:{session}\"\n[tracker]\ndevice = \"replay:{session}\"\n[calibration]\n\
         from = \"{calibration}\"\n[environment]\nlight_count = 8\n[recording]\nreserve_mb = 1\n"
    );
    desk.put("rig.toml", text);
}

/// A running program; it is killed if the test fails.
pub struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    /// Starts the live rig; returns it with the address that it prints.
    pub fn rig(desk: &Desk, more: &[&str]) -> (Self, String) {
        Self::serving(desk, &[&["run", "--config", "rig.toml"], more].concat())
    }

    /// Starts a command that serves the status page; returns it with the address that it prints.
    pub fn serving(desk: &Desk, command: &[&str]) -> (Self, String) {
        let page = ["--headless", "--listen", "127.0.0.1:0"];
        let child = desk
            .command(&[command, &page].concat())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut running = Self(child.unwrap());
        let mut printed = String::new();
        // It is kept open: the program goes on printing.
        let mut stdout = BufReader::new(running.0.stdout.as_mut().unwrap());
        while stdout.read_line(&mut printed).unwrap() > 0 {
            let last = printed.lines().next_back().unwrap_or_default();
            let address = last.strip_prefix("status page: http://");
            if let Some(address) = address.and_then(|a| a.strip_suffix('/')) {
                let address = address.to_owned();
                return (running, address);
            }
        }
        panic!("no address: {printed:?}");
    }

    /// Wraps a program that was started elsewhere.
    pub const fn from_child(child: Child) -> Self {
        Self(child)
    }

    pub fn stdout(&mut self) -> std::process::ChildStdout {
        self.0.stdout.take().unwrap()
    }

    pub fn signal(&self, signal: &str) {
        let id = self.0.id().to_string();
        let sent = Command::new("kill").args([signal, &id]).status().unwrap();
        assert!(sent.success());
    }

    /// Ends the program by SIGTERM; returns its standard error.
    pub fn end(mut self) -> String {
        self.signal("-TERM");
        let mut printed = String::new();
        let stderr = self.0.stderr.take();
        if let Some(mut stderr) = stderr {
            stderr.read_to_string(&mut printed).unwrap();
        }
        assert!(self.0.wait().unwrap().success(), "{printed}");
        printed
    }
}

pub fn status(address: &str) -> Value {
    let answer = get(address, "/status");
    serde_json::from_str(answer.split_once("\r\n\r\n").unwrap().1).unwrap()
}

pub fn post(address: &str, path: &str, body: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(
        stream,
        "POST {path} HTTP/1.1\r\nHost: {address}\r\nContent-Type: application/json\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    )
    .unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    text(&answer)
}

pub fn until(what: &str, mut holds: impl FnMut() -> bool) -> Duration {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
    begun.elapsed()
}

pub fn device(status: &Value, kind: &str) -> Value {
    let devices = status["devices"].as_array().unwrap().iter();
    let mut found = devices.filter(|d| d["kind"] == kind);
    found
        .next()
        .unwrap_or_else(|| panic!("{kind}: {status}"))
        .clone()
}

/// Counts the frames in `live` that differ from those in `replayed` by more than four levels in more
/// than one of 2000 codes. On a software driver, a light's shadows are drawn again only when it has
/// turned a little, which may be at a picture that the live rig had skipped: until it turns further,
/// the edges of its shadows differ by a few levels. A wrong pairing differs by dozens.
fn different(desk: &Desk, live: &str, replayed: &str) -> usize {
    let same = |name: &&String| {
        let codes = |folder: &str| {
            let png = desk.read(Path::new(folder).join(name));
            image::load_from_memory(&png)
                .unwrap()
                .into_rgb8()
                .into_raw()
        };
        let (a, b) = (codes(live), codes(replayed));
        let differ = a
            .iter()
            .zip(&b)
            .filter(|(a, b)| a.abs_diff(**b) > 4)
            .count();
        a.len() == b.len() && 2000 * differ <= a.len()
    };
    let names = desk.names(live);
    assert!(names.len() >= 25);
    names.len() - names.iter().filter(same).count()
}

#[test]
fn replay_of_a_recording_equals_the_live_pictures() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let out = "--headless --config rig.toml --frames-out";
    let printed = desk.works(&format!(
        "run --listen 127.0.0.1:0 {out} live --frames 25 --record rec.mcap"
    ));
    assert!(printed.contains("25 frames composed"), "{printed}");
    assert!(
        printed.contains("rec.mcap: ") && !printed.contains("DROPPED"),
        "{printed}"
    );
    desk.works(&format!(
        "replay rec.mcap --listen 127.0.0.1:0 {out} replayed"
    ));
    assert_eq!(different(&desk, "live", "replayed"), 0);
    // The comparison detects differences: with complete pairing the poses differ.
    let line = format!("replay rec.mcap --listen 127.0.0.1:0 --pairing complete {out} complete");
    desk.works(&line);
    assert!(different(&desk, "live", "complete") > 20);
}

#[test]
fn record_writes_all_streams_and_never_overwrites() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let printed = desk.works("record out.mcap --config rig.toml --duration 3");
    assert!(printed.starts_with("out.mcap: "), "{printed}");
    let session = Session::open(&desk.path("out.mcap")).unwrap();
    let original = Session::open(&desk_session()).unwrap();
    assert!(!session.truncated() && !session.has_journal());
    for attachment in original.attachments() {
        let copy = session.attachment(&attachment.name).unwrap();
        assert!(copy == &attachment.data[..], "{}", attachment.name);
    }
    assert_eq!(session.tracker_protocol(), original.tracker_protocol());
    let count = |topic: &str| {
        let streams = session.streams().unwrap();
        streams
            .iter()
            .find(|s| s.topic == topic)
            .map_or(0, |s| s.messages)
    };
    assert!(
        count("/scene_camera/image") > 60,
        "{}",
        count("/scene_camera/image")
    );
    assert!(count("/environment_camera/image_ev-8") > 8);
    assert!(count("/tracker/bytes") > 240);
    let refused = desk.refuses("record out.mcap --config rig.toml --duration 1");
    assert!(
        refused.contains("out.mcap") && refused.contains("exists"),
        "{refused}"
    );
    desk.works(
        "replay out.mcap --headless --light-count 8 --frames 3 --speed max --listen 127.0.0.1:0",
    );
}

#[cfg(unix)]
#[test]
fn recording_of_a_killed_program_lacks_at_most_one_second() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let mut command = desk.command(&["record", "out.mcap", "--config", "rig.toml"]);
    let recorder = Running(command.stderr(Stdio::null()).spawn().unwrap());
    let long_enough = |s: Session| s.span().is_some_and(|(a, b)| b.seconds_since(a) > 3.0);
    until("three seconds are on the disk", || {
        Session::open(&desk.path("out.mcap")).is_ok_and(long_enough)
    });
    // Read the time before `kill` starts, which takes a while on a busy machine.
    let killed_at = SystemClock.now();
    recorder.signal("-KILL");
    drop(recorder);
    let session = Session::open(&desk.path("out.mcap")).unwrap();
    assert!(session.truncated());
    let (mut scene, mut last) = (0, killed_at);
    for event in session.events() {
        let event = event.unwrap();
        scene += u64::from(matches!(event, SessionEvent::Scene(_)));
        last = event.arrived_at();
    }
    // Three seconds, with a pause where the session is repeated.
    assert!(scene > 50, "{scene}");
    let lost = killed_at.seconds_since(last);
    assert!(lost < 1.0, "the last {lost} s are lost");
    assert!(session.attachment("rig.json").is_some());
}

/// A closed terminal, for example.
#[cfg(unix)]
#[test]
fn hang_up_closes_the_recording() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let mut command = desk.command(&["record", "out.mcap", "--config", "rig.toml"]);
    let mut recorder = Running(command.stderr(Stdio::null()).spawn().unwrap());
    until("the recording has begun", || {
        Session::open(&desk.path("out.mcap")).is_ok_and(|s| s.span().is_some())
    });
    recorder.signal("-HUP");
    assert!(recorder.0.wait().unwrap().success());
    assert!(!Session::open(&desk.path("out.mcap")).unwrap().truncated());
}

#[test]
fn run_fails_if_its_recording_failed() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let rig = text(&desk.read("rig.toml")).replace("reserve_mb = 1\n", "reserve_mb = 1e9\n");
    desk.put("rig.toml", rig);
    let output = desk
        .run("run --config rig.toml --headless --listen 127.0.0.1:0 --frames 60 --record out.mcap");
    let error = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{error}");
    let last = error.lines().last().unwrap_or_default();
    assert!(
        last.starts_with("penumbra: out.mcap: recording ended"),
        "{error}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn live_picture_goes_on_if_poses_cannot_be_written() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let more = ["--poses-out", "/dev/full", "--force"];
    let (mut rig, address) = Running::rig(&desk, &more);
    until("the status warns", || {
        let warnings = status(&address)["warnings"].to_string();
        warnings.contains("/dev/full: No space left on device")
    });
    let composed = || status(&address)["frames"]["composed"].as_u64();
    let before = composed();
    until("the picture goes on", || composed() > before.map(|n| n + 5));
    rig.signal("-TERM");
    assert_eq!(rig.0.wait().unwrap().code(), Some(1));
}

#[cfg(unix)]
#[test]
fn missing_devices_are_reported_and_used_once_they_appear() {
    let desk = Desk::new();
    configure(&desk, "late.mcap");
    let (rig, address) = Running::rig(&desk, &[]);
    until("the status reports the missing device", || {
        let scene = status(&address)["devices"][0]["reason"].clone();
        scene.as_str().is_some_and(|r| r.contains("not connected"))
    });
    let s = status(&address);
    assert_eq!(
        (&s["session"]["state"], &s["frames"]["composed"]),
        (&"live".into(), &0.into())
    );
    assert!(
        s["session"]["description"]
            .as_str()
            .unwrap()
            .contains("late.mcap"),
        "{s}"
    );
    for kind in ["scene-camera", "environment-camera", "tracker"] {
        assert_eq!(device(&s, kind)["state"], "retrying");
    }
    // A black picture replaces the camera's.
    until("a picture", || {
        get(&address, "/snapshot.png").starts_with("HTTP/1.1 200")
    });
    std::fs::copy(desk_session(), desk.path("copy.mcap")).unwrap();
    std::fs::rename(desk.path("copy.mcap"), desk.path("late.mcap")).unwrap();
    let waited = until("it streams", || {
        device(&status(&address), "scene-camera")["state"] == "streaming"
    });
    assert!(waited < Duration::from_secs(2), "{waited:?}");
    until("pictures", || {
        status(&address)["frames"]["composed"].as_u64() > Some(0)
    });
    let s = status(&address);
    let scene = device(&s, "scene-camera");
    assert!(
        scene["attempts"].as_u64().unwrap() > 1 && scene["reason"].is_null(),
        "{scene}"
    );
    assert!(
        scene["last_error"]
            .as_str()
            .unwrap()
            .contains("not connected")
    );
    let printed = rig.end();
    // One message per device, not one per attempt.
    assert_eq!(printed.matches("not connected").count(), 3, "{printed}");
}

#[cfg(unix)]
#[test]
fn running_rig_records_on_request() {
    let desk = Desk::new();
    configure(&desk, &desk_session().display().to_string());
    let (rig, address) = Running::rig(&desk, &[]);
    assert_eq!(status(&address)["recording"]["state"], "idle");
    let begun = post(
        &address,
        "/recording",
        r#"{"record": true, "file": "a.mcap"}"#,
    );
    assert!(begun.starts_with("HTTP/1.1 202"), "{begun}");
    let line = format!("record b.mcap --while-running --listen {address} --duration 3");
    assert!(desk.refuses(&line).contains("a.mcap is being recorded"));
    until("it grows", || {
        let recording = status(&address)["recording"].clone();
        // The journal begins with the first frame that was prepared.
        recording["bytes"].as_u64() > Some(2_000_000)
            && recording["state"] == "recording"
            && status(&address)["frames"]["composed"].as_u64() > Some(10)
    });
    assert!(status(&address)["recording"]["seconds_left"].as_f64() > Some(0.0));
    let ended = post(&address, "/recording", r#"{"record": false}"#);
    assert!(ended.contains("\"state\":\"finished\""), "{ended}");
    let again = post(
        &address,
        "/recording",
        r#"{"record": true, "file": "a.mcap"}"#,
    );
    assert!(
        again.starts_with("HTTP/1.1 409") && again.contains("exists"),
        "{again}"
    );
    assert!(desk.works(&line).contains("b.mcap"));
    until("the length ends it", || {
        status(&address)["recording"]["state"] == "finished"
    });
    let elsewhere = desk.refuses(&format!(
        "record x/c.mcap --while-running --listen {address}"
    ));
    assert!(elsewhere.contains("own folder"), "{elsewhere}");
    rig.end();
    for name in ["a.mcap", "b.mcap"] {
        let session = Session::open(&desk.path("recordings").join(name)).unwrap();
        assert!(session.has_journal() && !session.truncated(), "{name}");
    }
    let refused = desk.refuses(&format!("record c.mcap --while-running --listen {address}"));
    assert!(
        refused.contains("no `penumbra run` answers there"),
        "{refused}"
    );
}

#[cfg(target_os = "linux")]
#[test]
fn service_manager_is_notified_of_start_state_and_watchdog() {
    use std::os::unix::net::UnixDatagram;
    let desk = Desk::new();
    configure(&desk, "nowhere.mcap");
    let manager = UnixDatagram::bind(desk.path("notify")).unwrap();
    manager
        .set_read_timeout(Some(Duration::from_secs(60)))
        .unwrap();
    let line = [
        "run",
        "--config",
        "rig.toml",
        "--headless",
        "--listen",
        "127.0.0.1:0",
    ];
    let mut command = desk.command(&line);
    command.env("NOTIFY_SOCKET", desk.path("notify"));
    command.env("WATCHDOG_USEC", "1500000");
    let rig = Running(
        command
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap(),
    );
    let mut messages = Vec::new();
    let mut receive = || {
        let mut buffer = [0; 4096];
        let length = manager.recv(&mut buffer).unwrap();
        messages.push(text(&buffer[..length]).trim_end().to_owned());
        messages.clone()
    };
    let watchdogs = |messages: &[String]| messages.iter().filter(|m| *m == "WATCHDOG=1").count();
    while watchdogs(&receive()) < 4 {}
    let received = receive();
    assert_eq!(received[0], "READY=1");
    assert!(
        received
            .iter()
            .any(|m| m.starts_with("STATUS=") && m.contains("not connected")),
        "{received:?}"
    );
    rig.signal("-TERM");
    while receive().last().unwrap() != "STOPPING=1" {}
    rig.end_quietly();
}

#[cfg(target_os = "linux")]
impl Running {
    fn end_quietly(mut self) {
        assert!(self.0.wait().unwrap().success());
    }
}
