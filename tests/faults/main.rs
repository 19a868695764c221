//! Faults of every kind, injected into a live rig: the picture does not stop, the status names the
//! cause, a device that works again is used within two seconds, and nothing grows. `make faults`
//! injects each kind a hundred times and writes the table of the book; the test injects each once.
#![expect(clippy::unwrap_used, clippy::panic)]

mod growth;
mod kinds;
mod rig;
mod steady;

use bytes::Bytes;
use growth::{Growth, Usage};
use kinds::{Kind, Place};
use penumbra_interface::DeviceKind;
use penumbra_status::Snapshot;
use penumbra_status::recording::{RecordingControl, RecordingRequest};
use penumbra_status::snapshot::DeviceState;
use rig::{Rig, named};
use serde::Serialize;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::time::{Duration, Instant};

/// The longest time between two pictures in a run of several rounds.
const MAX_GAP: Duration = Duration::from_millis(500);
/// The longest time from the end of a fault to normal work, in the same.
const MAX_RECOVERY: Duration = Duration::from_secs(2);
/// After this time without recovery the injection counts as not recovered.
const GIVE_UP: Duration = Duration::from_secs(10);
/// Time between two faults.
const PAUSE: Duration = Duration::from_millis(250);
/// Requests of a flood of settings.
const FLOOD: u32 = 200;

/// What was seen of all injections of one kind at one place.
#[derive(Default, Serialize)]
struct Row {
    kind: &'static str,
    place: &'static str,
    injections: u32,
    named: u32,
    recovered: u32,
    largest_gap_ms: f64,
    slowest_recovery_ms: f64,
}

/// The results of a run.
#[derive(Default, Serialize)]
struct Results {
    adapter: String,
    rounds: u32,
    seconds: f64,
    pictures: u64,
    rows: Vec<Row>,
    growth: Growth,
}

/// What was seen of one injection.
struct Seen {
    is_named: bool,
    gap: Duration,
    recovery: Option<Duration>,
    /// For messages: what the status said.
    said: String,
}

#[test]
fn picture_status_and_recovery_withstand_every_kind_of_fault() {
    let rounds = std::env::var("PENUMBRA_FAULTS_ROUNDS");
    let rounds = rounds.map_or(1, |n| n.parse().unwrap());
    let only = std::env::var("PENUMBRA_FAULTS_ONLY");
    let folder = tempfile::tempdir().unwrap();
    let mut rig = Rig::start(folder.path());
    let streams = |s: &Snapshot| {
        let devices = s.devices.iter();
        let all = devices
            .filter(|d| d.state == DeviceState::Streaming)
            .count()
            == 3;
        all && s.lighting.age_ms.is_some() && s.frames.composed > 20
    };
    let started = rig.until(Duration::from_secs(120), streams);
    assert!(started.is_some(), "{:#?}", rig.status.snapshot());

    let begun = Instant::now();
    let jpeg = small_jpeg();
    let mut results = Results {
        adapter: rig.status.snapshot().adapter.name,
        rounds,
        ..Results::default()
    };
    let (mut usage, mut failures) = (Vec::new(), Vec::new());
    for round in 0..rounds {
        for (i, kind) in Kind::ALL.into_iter().enumerate() {
            if only.as_ref().is_ok_and(|only| only != kind.label()) {
                continue;
            }
            // In turns, so that a single round reaches every place, too.
            let places = kind.places();
            let place = places[(round as usize + i) % places.len()];
            let seen = inject(&mut rig, kind, place, &jpeg, folder.path());
            // A single round is a test, and tests are not timed: it runs on busy machines, too.
            let limits = if rounds == 1 {
                (GIVE_UP, GIVE_UP)
            } else {
                (MAX_GAP, MAX_RECOVERY)
            };
            failures.extend(failure(kind, place, &seen, limits));
            add(&mut results.rows, kind, place, &seen);
        }
        usage.push(Usage::now());
        results.seconds = begun.elapsed().as_secs_f64();
        results.pictures = rig.status.snapshot().frames.composed;
        results.growth = Growth::of(&usage);
        // After each round, because a run of many takes long.
        write_results(&results);
        eprintln!("round {} of {rounds}: {:?}", round + 1, usage.last());
    }
    rig.end();
    failures.extend(results.growth.failure());
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}

fn write_results(results: &Results) {
    let json = serde_json::to_string_pretty(results).unwrap();
    match std::env::var("PENUMBRA_FAULTS_OUT") {
        Ok(path) => std::fs::write(path, json).unwrap(),
        Err(_) => println!("{json}"),
    }
}

fn add(rows: &mut Vec<Row>, kind: Kind, place: Place, seen: &Seen) {
    let (kind, place) = (kind.label(), place.label());
    let known = rows.iter().position(|r| r.kind == kind && r.place == place);
    let row = known.unwrap_or_else(|| {
        rows.push(Row {
            kind,
            place,
            ..Row::default()
        });
        rows.len() - 1
    });
    let row = &mut rows[row];
    row.injections += 1;
    row.named += u32::from(seen.is_named);
    row.recovered += u32::from(seen.recovery.is_some());
    let millis = |time: Duration| time.as_secs_f64() * 1e3;
    row.largest_gap_ms = row.largest_gap_ms.max(millis(seen.gap));
    let recovery = seen.recovery.map_or(0.0, millis);
    row.slowest_recovery_ms = row.slowest_recovery_ms.max(recovery);
}

/// Returns what was not as it should be.
fn failure(
    kind: Kind,
    place: Place,
    seen: &Seen,
    (max_gap, max_recovery): (Duration, Duration),
) -> Option<String> {
    let is_late = seen.recovery.is_none_or(|time| time > max_recovery);
    let is_fine = seen.is_named && seen.gap <= max_gap && !is_late;
    (!is_fine).then(|| {
        let text = format!(
            "{} of the {}: named {}, gap {:.0?}, recovery {:.0?}; the status said: {}",
            kind.label(),
            place.label(),
            seen.is_named,
            seen.gap,
            seen.recovery,
            seen.said.replace('\n', " | ")
        );
        eprintln!("{text}");
        text
    })
}

/// Injects a fault and looks at the rig until it works again.
fn inject(rig: &mut Rig, kind: Kind, place: Place, jpeg: &Bytes, folder: &Path) -> Seen {
    rig.look_for(PAUSE);
    let before = rig.look();
    rig.reset_gap();
    let mut seen = match place {
        Place::Device(device) => {
            let fault = kind.of_device(place, jpeg);
            rig.switches.of(device).set(fault);
            let mut said = Said::new(kind, place, &before);
            said.listen(rig, kind.duration(place));
            rig.switches.of(device).set(None);
            let recovery = recovery_of_device(rig, device, &mut said);
            said.seen(recovery)
        }
        Place::Disk => disturb_disk(rig, kind, &before, folder),
        Place::Viewer => stall_viewer(rig, &before),
        Place::Settings => flood_settings(rig, &before),
    };
    seen.gap = rig.largest_gap;
    seen
}

/// Whether the status names the cause.
struct Said<'a> {
    words: &'static [&'static str],
    before: &'a Snapshot,
    is_named: bool,
    last: String,
}

impl<'a> Said<'a> {
    const fn new(kind: Kind, place: Place, before: &'a Snapshot) -> Self {
        Self {
            words: kind.named_by(place),
            before,
            is_named: false,
            last: String::new(),
        }
    }

    fn hear(&mut self, s: &Snapshot) {
        if !self.is_named {
            self.last = named(self.before, s);
            self.is_named = self.words.iter().any(|word| self.last.contains(word));
        }
    }

    fn listen(&mut self, rig: &mut Rig, time: Duration) {
        rig.until(time, |s| {
            self.hear(s);
            false
        });
    }

    fn seen(self, recovery: Option<Duration>) -> Seen {
        Seen {
            is_named: self.is_named,
            gap: Duration::ZERO,
            recovery,
            said: self.last,
        }
    }
}

fn with_pose(s: &Snapshot) -> u64 {
    s.frames.composed - s.frames.without_pose
}

/// Returns the time until the device delivers again and what it delivers is used.
fn recovery_of_device(rig: &mut Rig, kind: DeviceKind, said: &mut Said<'_>) -> Option<Duration> {
    let cleared = rig.look();
    let received = |s: &Snapshot| device(s, kind).map_or(0, |d| d.received);
    let delivers = |s: &Snapshot| received(s) > received(&cleared);
    let returned = rig.until(GIVE_UP, |s| {
        said.hear(s);
        delivers(s)
    })?;
    // Until then there was nothing new to show.
    if kind == DeviceKind::SceneCamera {
        rig.reset_gap();
    }
    let recovery = rig.until(GIVE_UP, |s| {
        said.hear(s);
        works(s, &cleared, kind)
    });
    // The cause may be named a moment after the fault has ended.
    rig.until(GIVE_UP, |s| {
        said.hear(s);
        said.is_named
    });
    Some(returned + recovery?)
}

/// Whether a device delivers, and what it has delivered since `cleared` is used.
fn works(s: &Snapshot, cleared: &Snapshot, kind: DeviceKind) -> bool {
    let Some((now, before)) = device(s, kind).zip(device(cleared, kind)) else {
        return false;
    };
    let is_used = match kind {
        DeviceKind::SceneCamera => s.frames.composed >= cleared.frames.composed + 2,
        DeviceKind::Tracker => with_pose(s) >= with_pose(cleared) + 2,
        DeviceKind::EnvironmentCamera => {
            let skew = s.pairing.environment_skew_ms;
            let is_paired = skew.is_some_and(|ms| (0.0..500.0).contains(&ms));
            // Estimating the light from it takes its time on a slow machine.
            let stale = s.lighting.stale.as_deref();
            let is_blamed = stale.is_some_and(|reason| reason.contains("camera"));
            now.received >= before.received + 3 && !is_blamed && is_paired
        }
    };
    now.state == DeviceState::Streaming && now.reason.is_none() && is_used
}

fn device(s: &Snapshot, kind: DeviceKind) -> Option<&penumbra_status::snapshot::Device> {
    s.devices.iter().find(|d| d.kind == kind)
}

fn recording_request(record: bool, file: Option<String>) -> RecordingRequest {
    RecordingRequest {
        record,
        file,
        seconds: None,
        composite: None,
    }
}

/// Records onto a disk that becomes full or slow, then onto one that works.
fn disturb_disk(rig: &mut Rig, kind: Kind, before: &Snapshot, folder: &Path) -> Seen {
    let start = recording_request(true, Some("fault.mcap".to_owned()));
    rig.recorder.carry_out(&start).unwrap();
    rig.look_for(Duration::from_millis(200));
    let mut said = Said::new(kind, Place::Disk, before);
    match kind {
        Kind::DiskFull => rig.disk.set_full(true),
        _ => rig.disk.set_delay(Duration::from_millis(300)),
    }
    said.listen(rig, kind.duration(Place::Disk));
    rig.disk.set_full(false);
    rig.disk.set_delay(Duration::ZERO);
    if kind == Kind::DiskFull {
        let again = recording_request(true, Some("again.mcap".to_owned()));
        rig.until(GIVE_UP, |s| {
            said.hear(s);
            said.is_named
        });
        rig.recorder.carry_out(&again).unwrap();
    }
    let events = rig.look().recording.events;
    let recovery = rig.until(GIVE_UP, |s| {
        said.hear(s);
        s.recording.events > events && said.is_named
    });
    rig.recorder
        .carry_out(&recording_request(false, None))
        .unwrap();
    for file in ["fault.mcap", "again.mcap"] {
        let _ = std::fs::remove_file(folder.join(file));
    }
    said.seen(recovery)
}

fn connect(rig: &Rig, request: &str) -> TcpStream {
    let mut socket = TcpStream::connect(rig.address).unwrap();
    socket.set_read_timeout(Some(GIVE_UP)).unwrap();
    let request = request.replace("HOST", &rig.address.to_string());
    socket.write_all(request.as_bytes()).unwrap();
    socket
}

/// A viewer of the stream that reads nothing, and then leaves.
fn stall_viewer(rig: &mut Rig, before: &Snapshot) -> Seen {
    let (kind, place) = (Kind::ViewerStalled, Place::Viewer);
    let socket = connect(rig, "GET /stream.mjpeg HTTP/1.1\r\nHost: HOST\r\n\r\n");
    let mut said = Said::new(kind, place, before);
    said.listen(rig, kind.duration(place) + Duration::from_millis(700));
    drop(socket);
    let recovery = rig.until(GIVE_UP, |s| s.stream.viewers == 0 && said.is_named);
    said.seen(recovery)
}

/// Many changes of a setting, one after the other.
fn flood_settings(rig: &mut Rig, before: &Snapshot) -> Seen {
    let (kind, place) = (Kind::SettingsFlood, Place::Settings);
    let mut said = Said::new(kind, place, before);
    let mut strength = 0.0;
    for i in 0..FLOOD {
        // It ends at another value each time.
        let last = if before.settings.shadow_strength > 0.75 {
            0.5
        } else {
            1.0
        };
        strength = if i + 1 == FLOOD {
            last
        } else {
            f64::from(i) / f64::from(FLOOD)
        };
        let body = format!("{{\"shadow_strength\": {strength}}}");
        let request = format!(
            "POST /settings HTTP/1.1\r\nHost: HOST\r\nContent-Type: application/json\r\n\
             Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
            body.len()
        );
        let mut answer = String::new();
        connect(rig, &request).read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 202"), "{answer}");
        if i % 20 == 0 {
            said.hear(&rig.look());
        }
    }
    let is_set = |s: &Snapshot| (f64::from(s.settings.shadow_strength) - strength).abs() < 1e-6;
    let recovery = rig.until(GIVE_UP, |s| {
        said.hear(s);
        is_set(s) && said.is_named
    });
    said.seen(recovery)
}

/// A picture of another size than the rig's.
fn small_jpeg() -> Bytes {
    let picture = image::RgbImage::from_fn(64, 48, |x, y| image::Rgb([x as u8, y as u8, 90]));
    let mut jpeg = std::io::Cursor::new(Vec::new());
    picture
        .write_to(&mut jpeg, image::ImageFormat::Jpeg)
        .unwrap();
    jpeg.into_inner().into()
}
