use super::*;
use crate::source::Live;
use bytes::Bytes;
use penumbra_config::Config;
use penumbra_interface::threads;
use penumbra_interface::{Frame, PixelFormat, RigidTransform};
use penumbra_rig_model::RigDocument;
use penumbra_session::LightRecord;
use penumbra_session::SessionWriter;
use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

const MS: i64 = 1_000_000;

fn frame(at: MonotonicTime, sequence: u64) -> Frame {
    Frame {
        data: Bytes::from_static(b"picture"),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence,
        captured_at: at,
        arrived_at: at,
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn pose(at: MonotonicTime) -> SessionEvent {
    SessionEvent::Pose(PoseSample {
        station: 1,
        transmitter_from_sensor: RigidTransform::IDENTITY,
        arrived_at: at,
        error: None,
    })
}

fn live() -> (Source, Arc<Hub>) {
    let live = Live::new(&Config::default(), true).unwrap();
    let hub = live.hub.clone();
    (Source::Live(live), hub)
}

fn feed(source: &Source) -> Feed {
    let rig = RigDocument::uncalibrated(640, 480).calibration;
    let config = PairingConfig {
        max_wait_nanos: 20 * MS,
        ..PairingConfig::default()
    };
    Feed::new(source, &rig, config, true)
}

/// Index, sequence number and skipped pictures of the next frame.
fn next_numbers(feed: &mut Feed) -> (u64, u64, u64) {
    match feed.next_picture(None) {
        Next::Item(item) => (item.frame.index, item.frame.scene.sequence, item.skipped),
        Next::Idle => panic!("idle"),
        Next::Ended => panic!("the end"),
    }
}

#[test]
fn returns_newest_waiting_picture_and_counts_the_others() {
    let (source, hub) = live();
    let mut feed = feed(&source);
    let start = SystemClock.now();
    let at = |millis: i64| start.offset_nanos(millis * MS - 1000 * MS);
    for n in 0..7 {
        hub.deliver(SessionEvent::Scene(frame(at(33 * n), n as u64)));
        hub.deliver(pose(at(33 * n + 5)));
    }
    assert_eq!(next_numbers(&mut feed), (6, 6, 6));
    hub.deliver(SessionEvent::Scene(frame(at(400), 7)));
    hub.deliver(pose(at(405)));
    assert_eq!(next_numbers(&mut feed), (7, 7, 0));
    assert_eq!(feed.counts().scene_frames, 8);
    hub.end();
    assert!(matches!(feed.next_picture(None), Next::Ended));
}

#[test]
fn silent_tracker_does_not_delay_picture_beyond_maximum_wait() {
    let (source, hub) = live();
    let mut feed = feed(&source);
    let now = SystemClock.now();
    hub.deliver(pose(now));
    hub.deliver(SessionEvent::Scene(frame(now.offset_nanos(MS), 0)));
    let begun = Instant::now();
    assert_eq!(next_numbers(&mut feed), (0, 0, 0));
    let waited = begun.elapsed();
    assert!(waited < Duration::from_millis(150), "{waited:?}");
    assert!(waited > Duration::from_millis(10), "{waited:?}");
}

#[test]
fn reports_idle_while_only_the_tracker_delivers() {
    let (source, hub) = live();
    let mut feed = feed(&source);
    let stop = Arc::new(AtomicBool::new(false));
    let stopped = stop.clone();
    let tracker = threads::spawn("tracker", move || {
        while !stopped.load(Ordering::Relaxed) {
            hub.deliver(pose(SystemClock.now()));
            std::thread::sleep(Duration::from_millis(2));
        }
    });
    let begun = Instant::now();
    assert!(matches!(feed.next_picture(None), Next::Idle));
    assert!(begun.elapsed() < Duration::from_secs(5));
    assert!(feed.counts().poses > 5);
    stop.store(true, Ordering::Relaxed);
    tracker.unwrap().join().unwrap();
}

/// The recording of a live rig that was too slow for every second picture.
#[test]
fn replay_pairs_as_the_live_rig_and_reads_its_journal() {
    let at = |millis: i64| MonotonicTime::from_nanos(1_000_000 * MS + millis * MS);
    let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("memory")).unwrap();
    for n in 0..10 {
        let arrived_at = at(40 * n);
        writer
            .event(&SessionEvent::Scene(frame(arrived_at, n as u64)))
            .unwrap();
        // The tracker is silent: the wait for it ends after 20 ms.
        writer.event(&SessionEvent::Tick(at(40 * n + 20))).unwrap();
        if n % 2 == 0 && n < 8 {
            let entry = SessionEvent::Prepared {
                at: at(40 * n + 90),
                arrived_at,
                light: (n > 0).then_some(LightRecord {
                    seen: n == 4,
                    lit_by: Some(at(0)),
                }),
            };
            writer.event(&entry).unwrap();
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("live.mcap");
    std::fs::write(&path, writer.finish().unwrap().into_inner()).unwrap();
    let source = Source::Recorded(Session::open(&path).unwrap());
    let mut feed = feed(&source);
    let mut entries = Vec::new();
    while let Next::Item(item) = feed.next_picture(None) {
        assert_eq!(item.frame.index, entries.len() as u64);
        entries.push(item.entry);
    }
    let skipped = JournalEntry::Skipped;
    let composed = |seen| {
        JournalEntry::Composed(Some(LightRecord {
            seen,
            lit_by: Some(at(0)),
        }))
    };
    let expected = [
        // As in older recordings: an entry without light.
        JournalEntry::Composed(None),
        skipped,
        composed(false),
        skipped,
        composed(true),
        skipped,
        composed(false),
        skipped,
        skipped,
        skipped,
    ];
    assert_eq!(entries, expected);
    // Without the journal, no frame has an entry.
    let rig = RigDocument::uncalibrated(640, 480).calibration;
    let mut all = Feed::new(&source, &rig, PairingConfig::default(), false);
    let mut count = 0;
    while let Next::Item(item) = all.next_picture(None) {
        assert_eq!(item.entry, JournalEntry::None);
        count += 1;
    }
    assert_eq!(count, 10);
}

/// A line that drops and inserts one byte in a hundred. The bytes of two records can form a third
/// one with possible numbers, which only the sensor's motion refutes.
#[test]
fn misread_records_stay_out_of_the_picture_and_are_counted() {
    let mut random = penumbra_numerics::Random::new(7);
    let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("memory")).unwrap();
    let place = |seconds: f64| glam::DVec3::new(0.5, 0.1 * (2.0 * seconds).sin(), -0.3);
    for i in 0..4800_i64 {
        let at = MonotonicTime::from_nanos(1_000_000 * MS + i * 8_333_333);
        let p = place(i as f64 * 8.333_333e-3) / 0.0254;
        let mut record = b"01 ".to_vec();
        for value in [p.x, p.y, p.z, 40.0, 10.0, -20.0] {
            record.extend((value as f32).to_le_bytes());
        }
        record.push(b' ');
        let mut bytes = Vec::new();
        for byte in record {
            match random.between(0.0, 200.0) as u32 {
                0 => (),
                1 => bytes.extend([byte, random.between(0.0, 256.0) as u8]),
                _ => bytes.push(byte),
            }
        }
        writer
            .tracker_bytes("fastrak-binary-euler", &bytes, at)
            .unwrap();
        if i % 4 == 3 {
            writer
                .event(&SessionEvent::Scene(frame(at, i as u64)))
                .unwrap();
        }
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noisy.mcap");
    std::fs::write(&path, writer.finish().unwrap().into_inner()).unwrap();
    let mut feed = feed(&Source::Recorded(Session::open(&path).unwrap()));
    let mut worst = 0.0_f64;
    while let Next::Item(item) = feed.next_picture(None) {
        let captured_at = item.frame.captured_at.as_nanos() - 1_000_000 * MS;
        if let Some(pose) = item.frame.pose {
            let expected = place(captured_at as f64 * 1e-9);
            worst = worst.max(pose.transmitter_from_sensor.translation.distance(expected));
        }
    }
    let counts = feed.pairing_counts();
    assert!(worst < 0.01, "{worst} m off; {counts:?}");
    assert!(counts.rejected_poses > 0, "{counts:?}");
    let missing = 4800 - counts.poses - counts.rejected_poses;
    assert!(missing > 500, "{counts:?}");
    let lost = feed.lost_readings();
    assert!(lost.abs_diff(missing) * 5 < missing, "{lost} of {missing}");
}
