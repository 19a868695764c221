//! Round trips, and files that are truncated, damaged or not sessions.
use super::*;
use bytes::Bytes;
use glam::{DQuat, DVec3};
use penumbra_interface::{
    BayerPattern, Exposure, Frame, MonotonicTime, PixelFormat, PoseSample, RigidTransform,
};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn at(nanos: i64) -> MonotonicTime {
    MonotonicTime::from_nanos(nanos)
}

/// A coded picture whose bytes are its number, so that a mix-up is detected.
fn picture(sequence: u64, arrived: i64, bracket_ev: f64) -> Frame {
    Frame {
        data: Bytes::from(vec![sequence as u8; 3000]),
        format: PixelFormat::Jpeg,
        width: 0,
        height: 0,
        stride: 0,
        sequence,
        captured_at: at(arrived - 1_000),
        arrived_at: at(arrived),
        exposure: None,
        bracket_ev,
        controls: None,
    }
}

fn pose(arrived: i64) -> PoseSample {
    let rotation = DQuat::from_rotation_z(0.3);
    PoseSample {
        station: 2,
        transmitter_from_sensor: RigidTransform::new(rotation, DVec3::new(0.1, -0.2, 0.3)),
        arrived_at: at(arrived),
        error: None,
    }
}

/// A small session of every kind of event, in memory; flushed into a separate chunk
/// after every scene frame.
fn recorded(frames: u64) -> Vec<u8> {
    let cursor = Cursor::new(Vec::new());
    let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
    writer.attach("rig.json", b"{}").unwrap();
    writer
        .attach("object/deep/er/object.glb", &[7; 5000])
        .unwrap();
    for i in 0..frames {
        let arrived = 1_000_000_000 + 33_000_000 * i as i64;
        writer
            .frame(Camera::Scene, &picture(i, arrived, 0.0))
            .unwrap();
        for ev in [0.0, -4.0, -8.0] {
            let frame = picture(i, arrived + 5_000_000, ev);
            writer.frame(Camera::Environment, &frame).unwrap();
        }
        writer
            .tracker_bytes("fastrak", b"01 half a rec", at(arrived + 6_000_000))
            .unwrap();
        writer.pose(&pose(arrived + 7_000_000)).unwrap();
        writer.flush().unwrap();
    }
    writer.finish().unwrap().into_inner()
}

fn stored(bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

fn opened(bytes: &[u8]) -> Result<(TempDir, Session), SessionError> {
    let (folder, path) = stored(bytes);
    Session::open(&path).map(|session| (folder, session))
}

fn all_events(session: &Session) -> Vec<SessionEvent> {
    session.events().map(Result::unwrap).collect()
}

fn scene_sequences(events: &[SessionEvent]) -> Vec<u64> {
    let scene = events.iter().filter_map(|event| match event {
        SessionEvent::Scene(frame) => Some(frame.sequence),
        _ => None,
    });
    scene.collect()
}

#[test]
fn events_round_trip_in_the_order_of_arrival() {
    let (_folder, session) = opened(&recorded(3)).unwrap();
    assert!(!session.truncated() && session.damage().is_empty());
    let events = all_events(&session);
    assert_eq!(events.len(), 3 * 6);
    assert!(events.is_sorted_by_key(SessionEvent::arrived_at));
    let [
        SessionEvent::Scene(scene),
        SessionEvent::Environment(base),
        SessionEvent::Environment(darker),
        SessionEvent::Environment(darkest),
        SessionEvent::TrackerBytes {
            bytes, arrived_at, ..
        },
        SessionEvent::Pose(sample),
        ..,
    ] = &events[..]
    else {
        panic!("{events:?}");
    };
    assert_eq!(scene.data, vec![0; 3000]);
    assert_eq!(scene.captured_at, at(999_999_000));
    assert_eq!(scene.arrived_at, at(1_000_000_000));
    assert_eq!(
        (base.bracket_ev, darker.bracket_ev, darkest.bracket_ev),
        (0.0, -4.0, -8.0)
    );
    assert_eq!(
        (&bytes[..], *arrived_at),
        (&b"01 half a rec"[..], at(1_006_000_000))
    );
    let expected = pose(1_007_000_000);
    assert_eq!(
        (sample.station, sample.arrived_at),
        (2, expected.arrived_at)
    );
    let (found, expected) = (
        sample.transmitter_from_sensor,
        expected.transmitter_from_sensor,
    );
    assert_eq!(found.translation, expected.translation);
    assert!(found.rotation.abs_diff_eq(expected.rotation, 1e-15));
    assert_eq!(session.tracker_protocol(), Some("fastrak"));
}

#[test]
fn attachments_round_trip_with_their_paths() {
    let (_folder, session) = opened(&recorded(1)).unwrap();
    assert_eq!(session.attachment("rig.json"), Some(&b"{}"[..]));
    assert_eq!(
        session.attachment("object/deep/er/object.glb"),
        Some(&[7; 5000][..])
    );
    assert_eq!(session.attachment("object"), None);
    assert_eq!(session.attachments()[0].media_type, "application/json");
}

#[test]
fn session_can_be_read_repeatedly() {
    let (_folder, session) = opened(&recorded(4)).unwrap();
    for _ in 0..3 {
        assert_eq!(scene_sequences(&all_events(&session)), [0, 1, 2, 3]);
    }
}

#[test]
fn sorts_streams_that_were_written_late() {
    let cursor = Cursor::new(Vec::new());
    let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
    for i in [4, 0, 3, 1, 2] {
        writer
            .frame(Camera::Scene, &picture(i, 1_000 * i as i64 + 5_000, 0.0))
            .unwrap();
        writer.flush().unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let (_folder, session) = opened(&bytes).unwrap();
    assert_eq!(scene_sequences(&all_events(&session)), [0, 1, 2, 3, 4]);
}

#[test]
fn truncated_file_replays_its_complete_chunks() {
    let bytes = recorded(3);
    let (_folder, session) = opened(&bytes).unwrap();
    let chunk_ends: Vec<_> = session
        .container
        .chunks
        .iter()
        .map(|chunk| (chunk.offset + chunk.header.compressed_size) as usize)
        .collect();
    assert_eq!(chunk_ends.len(), 3);
    // Every boundary of a chunk and its neighbourhood, and samples of the rest.
    let near = chunk_ends.iter().flat_map(|end| end - 3..end + 3);
    for cut in near.chain((0..bytes.len()).step_by(97)) {
        let chunks = chunk_ends.iter().filter(|end| **end <= cut).count();
        match opened(&bytes[..cut]) {
            Ok((_folder, session)) => {
                assert!(session.truncated(), "cut at {cut}");
                let sequences = scene_sequences(&all_events(&session));
                assert_eq!(
                    sequences,
                    (0..chunks as u64).collect::<Vec<_>>(),
                    "cut at {cut}"
                );
                assert_eq!(session.attachment("rig.json"), Some(&b"{}"[..]));
                assert!(describe(&session).contains("truncated"));
            }
            Err(SessionError::NoCompleteChunk { .. }) => assert_eq!(chunks, 0, "cut at {cut}"),
            Err(SessionError::Empty { .. }) => assert_eq!(cut, 0),
            Err(SessionError::NotMcap { .. }) => assert!(cut < 8, "cut at {cut}"),
            Err(error) => panic!("cut at {cut}: {error}"),
        }
    }
}

#[test]
fn file_that_ends_in_zeros_is_truncated() {
    let mut bytes = recorded(2);
    let (_folder, session) = opened(&bytes).unwrap();
    let second = session.container.chunks[1].offset as usize;
    bytes[second - 60..].fill(0);
    let (_folder, session) = opened(&bytes).unwrap();
    assert!(session.truncated());
    assert_eq!(scene_sequences(&all_events(&session)), [0]);
}

#[test]
fn damaged_chunk_is_skipped_and_reported() {
    let mut bytes = recorded(3);
    let (_folder, session) = opened(&bytes).unwrap();
    bytes[session.container.chunks[1].offset as usize + 500] ^= 1;
    let (_folder, session) = opened(&bytes).unwrap();
    let (good, bad): (Vec<_>, Vec<_>) = session.events().partition(Result::is_ok);
    let good: Vec<_> = good.into_iter().map(Result::unwrap).collect();
    assert_eq!(scene_sequences(&good), [0, 2]);
    assert_eq!(bad.len(), 1);
    let text = bad[0].as_ref().unwrap_err().to_string();
    assert!(text.contains("checksum") && !text.contains('\n'), "{text}");
}

#[test]
fn damaged_chunk_states_what_it_held() {
    let mut bytes = recorded(3);
    let (_folder, session) = opened(&bytes).unwrap();
    bytes[session.container.chunks[1].offset as usize + 500] ^= 1;
    let (_folder, session) = opened(&bytes).unwrap();
    let error = session.events().find_map(Result::err).unwrap();
    let lost: BTreeMap<_, _> = error
        .lost()
        .iter()
        .map(|l| (l.stream.clone().unwrap_or_default(), l.messages))
        .collect();
    assert_eq!(lost.get("/scene_camera/image"), Some(&Some(1)));
    assert_eq!(lost.get("/environment_camera/image_ev-4"), Some(&Some(1)));
    assert_eq!(lost.get("/tracker/bytes"), Some(&Some(1)));
    let text = describe(&session);
    assert!(
        text.contains("1 of /scene_camera/image from 0.033 s to 0.033 s"),
        "{text}"
    );
}

/// The walk over the records would end at a damaged length, or go astray.
#[test]
fn damaged_length_of_a_chunk_loses_that_chunk_only() {
    let good = recorded(4);
    let (_folder, session) = opened(&good).unwrap();
    let length_at = session.container.chunks[1].record_at as usize + 1;
    for (byte, bit) in (0..8).flat_map(|byte| (0..8).map(move |bit| (byte, bit))) {
        let mut bytes = good.clone();
        bytes[length_at + byte] ^= 1 << bit;
        let (_folder, session) = opened(&bytes).unwrap();
        assert!(!session.truncated());
        let events: Vec<_> = session.events().filter_map(Result::ok).collect();
        let sequences = scene_sequences(&events);
        let kept = [0, 2, 3].iter().all(|i| sequences.contains(i));
        assert!(kept, "byte {byte} bit {bit}: {sequences:?}");
        let text = describe(&session);
        let is_reported = text.contains("1 of /scene_camera/image from 0.033 s");
        assert!(is_reported || sequences.contains(&1), "{text}");
    }
}

#[test]
fn message_that_cannot_be_read_is_counted() {
    let mut bytes = recorded(2);
    let protobuf = b"jpeg";
    // Without a checksum, the damage is found in the message only.
    let (_folder, session) = opened(&bytes).unwrap();
    let chunk = session.container.chunks[1].clone();
    let start = chunk.record_at as usize + 9 + 24;
    bytes[start..start + 4].fill(0);
    let records = chunk.offset as usize;
    let at = bytes[records..]
        .windows(protobuf.len())
        .position(|w| w == protobuf)
        .unwrap();
    bytes[records + at..][..4].copy_from_slice(b"\xff\xff\xff\xff");
    let (_folder, session) = opened(&bytes).unwrap();
    let errors: Vec<_> = session.events().filter_map(Result::err).collect();
    assert_eq!(errors.len(), 1, "{errors:?}");
    assert_eq!(errors[0].lost()[0].messages, Some(1));
    assert!(describe(&session).contains(&errors[0].to_string()));
}

#[test]
fn rejects_other_files_with_one_line() {
    let text = |bytes: &[u8]| opened(bytes).map(|_| ()).unwrap_err().to_string();
    assert!(text(b"").contains("is empty"));
    assert!(text(b"\xff\xd8\xff\xe0 this is a JPEG").contains("not an MCAP file"));
    assert!(text(b"\x89MCAP0\r\n").contains("truncated before its first complete chunk"));
    let mut foreign = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
    let channel = foreign
        .add_channel(0, "/lidar\nmast", "cdr", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    foreign.write_to_known_channel(&header, b"abc").unwrap();
    foreign.finish().unwrap();
    let foreign = text(&foreign.into_inner().into_inner());
    assert!(!foreign.contains('\n'), "{foreign}");
    assert!(foreign.contains("not a session of Penumbra") && foreign.contains("/lidar"));
    let folder = tempfile::tempdir().unwrap();
    let missing = Session::open(&folder.path().join("none.mcap")).unwrap_err();
    assert!(missing.to_string().contains("no such session"));
    let not_a_file = Session::open(folder.path()).unwrap_err();
    assert!(matches!(not_a_file, SessionError::NotMcap { .. }));
}

#[test]
fn rejects_attachments_outside_the_session() {
    let write = |name: &str| {
        let mut writer = mcap::Writer::new(Cursor::new(Vec::new())).unwrap();
        let attachment = mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: name.to_owned(),
            media_type: String::new(),
            data: b"x"[..].into(),
        };
        writer.attach(&attachment).unwrap();
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    };
    for name in ["../../etc/passwd", "/etc/passwd", "object/../../x", ""] {
        let error = opened(&write(name)).map(|_| ()).unwrap_err();
        assert!(
            matches!(error, SessionError::AttachmentName { .. }),
            "{name}: {error}"
        );
        let cursor = Cursor::new(Vec::new());
        let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
        assert!(writer.attach(name, b"x").is_err());
    }
}

#[test]
fn rejects_chunk_with_huge_uncompressed_size() {
    let bytes = recorded(1);
    let (_folder, session) = opened(&bytes).unwrap();
    let offset = session.container.chunks[0].offset as usize;
    // start, end: 16 bytes; then uncompressed size, crc, compression "", compressed size.
    let size = offset - 8 - 4 - 4 - 8;
    let mut mountain = bytes.clone();
    mountain[size..size + 8].copy_from_slice(&u64::MAX.to_le_bytes());
    let error = opened(&mountain).map(|_| ()).unwrap_err();
    assert!(matches!(error, SessionError::TooLarge { .. }), "{error}");
}

#[test]
fn reads_compressed_chunks_and_rejects_decompression_bombs() {
    for compression in [mcap::Compression::Lz4, mcap::Compression::Zstd] {
        let bytes = recorded_elsewhere(compression);
        let (_folder, session) = opened(&bytes).unwrap();
        assert_eq!(scene_sequences(&all_events(&session)), [0, 1, 2]);
        // A chunk that is larger than its header states.
        let place = &session.container.chunks[0];
        let name = place.header.compression.len();
        let size = place.offset as usize - 8 - 4 - name - 4 - 8;
        let mut lying = bytes.clone();
        lying[size..size + 8].copy_from_slice(&100_u64.to_le_bytes());
        let (_folder, session) = opened(&lying).unwrap();
        assert_eq!(session.events().filter(Result::is_err).count(), 1);
    }
}

/// The same messages, compressed by another MCAP writer.
fn recorded_elsewhere(compression: mcap::Compression) -> Vec<u8> {
    let options = mcap::WriteOptions::new().compression(Some(compression));
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let channel = writer
        .add_channel(0, "/scene_camera/image", "protobuf", &Default::default())
        .unwrap();
    for sequence in 0..3 {
        let frame = picture(sequence, 5_000 + sequence as i64, 0.0);
        let stamp = messages::timestamp(frame.captured_at).unwrap();
        let image = messages::compressed_image(Camera::Scene, &frame, stamp);
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time: frame.arrived_at.as_nanos() as u64,
            publish_time: 0,
        };
        let data = messages::encode(&image).unwrap();
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

#[test]
fn brackets_are_not_lost_frames_of_the_base_exposure() {
    let cursor = Cursor::new(Vec::new());
    let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
    let scene = picture(0, 10_000_000, 0.0);
    writer.frame(Camera::Scene, &scene).unwrap();
    // The camera counts base exposures and brackets; picture 7 is lost.
    for i in (0..12).filter(|i| *i != 7) {
        let ev = [0.0, -4.0, -8.0][i % 3];
        let frame = picture(i as u64, 10_000_000 * (i as i64 + 1), ev);
        writer.frame(Camera::Environment, &frame).unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let (_folder, session) = opened(&bytes).unwrap();
    let lost: Vec<u64> = session.streams().unwrap().iter().map(|s| s.lost).collect();
    assert_eq!(lost, [1, 0, 0, 0]);
}

#[test]
fn counts_messages_gaps_and_lost_frames() {
    let cursor = Cursor::new(Vec::new());
    let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
    // 100 Hz; the camera's counter shows that frames 3 and 4 are lost.
    for i in [0, 1, 2, 5, 6, 7] {
        let frame = picture(i, 10_000_000 * (i as i64 + 1), 0.0);
        writer.frame(Camera::Scene, &frame).unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let (_folder, session) = opened(&bytes).unwrap();
    let [stream] = &session.streams().unwrap()[..] else {
        panic!("one stream");
    };
    assert_eq!((stream.messages, stream.gaps, stream.lost), (6, 1, 2));
    assert_eq!(stream.rate_hz, Some(100.0));
    assert_eq!(stream.longest_interval_nanos, 30_000_000);
    assert!((stream.duration_seconds() - 0.07).abs() < 1e-12);
    assert!(describe(&session).contains("/scene_camera/image"));
}

#[test]
fn rejects_unrecordable_events() {
    let cursor = Cursor::new(Vec::new());
    let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
    let mut early = picture(0, 500, 0.0);
    early.captured_at = at(-1);
    assert!(writer.frame(Camera::Scene, &early).is_err());
    assert!(
        writer
            .frame(Camera::Scene, &picture(0, 2_000, f64::NAN))
            .is_err()
    );
    assert!(writer.tracker_bytes("fastrak", b"", at(-5)).is_err());
}

fn any_frame() -> impl Strategy<Value = Frame> {
    let format = prop::sample::select(vec![
        PixelFormat::Jpeg,
        PixelFormat::Png,
        PixelFormat::Yuyv,
        PixelFormat::Nv12,
        PixelFormat::Rgb8,
        PixelFormat::Grey8,
        PixelFormat::Bayer8(BayerPattern::Rggb),
        PixelFormat::Bayer8(BayerPattern::Bggr),
        PixelFormat::Bayer8(BayerPattern::Grbg),
        PixelFormat::Bayer8(BayerPattern::Gbrg),
    ]);
    let exposure = prop::option::of((1.0..1e6, 0.5..64.0));
    let counter = prop_oneof![0..100_u64, any::<u64>()];
    let times = (
        0..4_000_000_000_000_000_000_i64,
        -1_000_000_000..1_000_000_000_i64,
    );
    let brackets = prop::sample::select(vec![0.0, -4.0, -8.0, 1.5]);
    (format, exposure, counter, times, brackets, 0..3_u32).prop_map(
        |(format, exposure, sequence, (arrived, latency), bracket_ev, padding)| {
            let (width, height, tight, rows) = match format {
                PixelFormat::Jpeg | PixelFormat::Png => (0, 0, 0, 0),
                PixelFormat::Yuyv => (6, 4, 12, 4),
                PixelFormat::Nv12 => (6, 4, 6, 6),
                PixelFormat::Rgb8 => (5, 3, 15, 3),
                PixelFormat::Grey8 | PixelFormat::Bayer8(_) => (5, 3, 5, 3),
            };
            let padded = if width == 0 || padding == 0 {
                0
            } else {
                tight + padding
            };
            let len = rows * if padded == 0 { tight } else { padded };
            Frame {
                data: Bytes::from(vec![
                    sequence as u8;
                    if len == 0 { 321 } else { len as usize }
                ]),
                format,
                width,
                height,
                stride: padded,
                sequence,
                captured_at: at((arrived - latency).clamp(0, 4_290_000_000_000_000_000)),
                arrived_at: at(arrived),
                exposure: exposure.map(|(exposure_micros, gain)| Exposure {
                    exposure_micros,
                    gain,
                }),
                bracket_ev,
                controls: None,
            }
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn frames_round_trip(frames in prop::collection::vec((any_frame(), any::<bool>()), 1..8)) {
        let cursor = Cursor::new(Vec::new());
        let mut writer = SessionWriter::new(cursor, Path::new("memory")).unwrap();
        writer.frame(Camera::Scene, &picture(0, 4_100_000_000_000_000_000, 0.0)).unwrap();
        for (frame, scene) in &frames {
            let camera = if *scene { Camera::Scene } else { Camera::Environment };
            writer.frame(camera, frame).unwrap();
        }
        let bytes = writer.finish().unwrap().into_inner();
        let (_folder, session) = opened(&bytes).unwrap();
        let mut expected: Vec<_> = frames.iter().map(|(frame, scene)| (*scene, frame)).collect();
        expected.sort_by_key(|(_, frame)| frame.arrived_at);
        let found = all_events(&session);
        prop_assert_eq!(found.len(), expected.len() + 1);
        for (event, (scene, frame)) in found.iter().zip(expected) {
            let found = match event {
                SessionEvent::Scene(found) if scene => found,
                SessionEvent::Environment(found) if !scene => found,
                other => panic!("{other:?}"),
            };
            let exposure = |frame: &Frame| frame.exposure.map(|e| (e.exposure_micros, e.gain));
            match (exposure(found), exposure(frame)) {
                (Some(found), Some(exposure)) => {
                    // JSON numbers are parsed to within one unit in the last place.
                    prop_assert!((found.0 / exposure.0 - 1.0).abs() < 1e-15);
                    prop_assert!((found.1 / exposure.1 - 1.0).abs() < 1e-15);
                }
                (found, exposure) => prop_assert_eq!(found, exposure),
            }
            let silent = |frame: &Frame| Frame { exposure: None, ..frame.clone() };
            prop_assert_eq!(format!("{:?}", silent(found)), format!("{:?}", silent(frame)));
        }
    }

    #[test]
    fn flipped_bits_never_panic(place in 0..10_000_usize, bit in 0..8_u8) {
        let mut bytes = recorded(2);
        let place = place % bytes.len();
        bytes[place] ^= 1 << bit;
        if let Ok((_folder, session)) = opened(&bytes) {
            let _ = describe(&session);
            prop_assert!(session.events().count() <= 2 * 6 + 2);
        }
    }
}

#[test]
fn killed_writer_leaves_complete_chunks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("killed.mcap");
    let mut writer = SessionWriter::create(&path).unwrap();
    writer.attach("rig.json", b"{}").unwrap();
    for i in 0..40 {
        let arrived = 1_000_000_000 + 33_000_000 * i as i64;
        writer
            .frame(Camera::Scene, &picture(i, arrived, 0.0))
            .unwrap();
        if i == 9 {
            writer.flush().unwrap();
        }
    }
    // Neither finished nor dropped, as after a SIGKILL, with a partially written chunk whose
    // header is not filled in yet.
    std::mem::forget(writer);
    assert!(std::fs::metadata(&path).unwrap().len() > 60_000);
    let session = Session::open(&path).unwrap();
    assert!(session.truncated());
    assert_eq!(
        scene_sequences(&all_events(&session)),
        (0..10).collect::<Vec<_>>()
    );
    assert_eq!(session.attachment("rig.json"), Some(&b"{}"[..]));
}

/// A disk of limited capacity, bytes.
struct FullDisk {
    room: usize,
    file: Cursor<Vec<u8>>,
}

impl std::io::Write for FullDisk {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.room < bytes.len() {
            return Err(std::io::ErrorKind::StorageFull.into());
        }
        self.room -= bytes.len();
        self.file.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl std::io::Seek for FullDisk {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.file.seek(to)
    }
}

#[test]
fn full_disk_is_an_error_at_any_position() {
    let path = Path::new("full.mcap");
    let write = |room: usize| -> Result<(), SessionError> {
        let file = Cursor::new(Vec::new());
        let mut writer = SessionWriter::new(FullDisk { room, file }, path)?;
        writer.attach("rig.json", &[b' '; 500])?;
        for i in 0..3 {
            writer.frame(Camera::Scene, &picture(i, 1_000_000 + i as i64, 0.0))?;
            writer.flush()?;
        }
        writer.finish().map(|_| ())
    };
    for room in (0..16_000).step_by(37) {
        match write(room) {
            Ok(()) => assert!(room > 9_500, "{room}"),
            Err(SessionError::Io { source, .. }) => {
                assert_eq!(source.kind(), std::io::ErrorKind::StorageFull, "{room}");
                assert!(room < 15_000);
            }
            Err(error) => panic!("{room}: {error}"),
        }
    }
}

/// Events of a live rig in the order of the file, with three pictures a second apart.
fn events_of_a_live_rig() -> Vec<SessionEvent> {
    let controls = |exposure| -> penumbra_interface::ControlsInForce {
        [
            ("exposure_time_absolute".into(), exposure),
            ("gain".into(), 7),
        ]
        .into()
    };
    let scene = |sequence, nanos, exposure| Frame {
        controls: Some(controls(exposure)),
        ..picture(sequence, nanos, 0.0)
    };
    let second = 1_000_000_000;
    vec![
        SessionEvent::Scene(scene(1, second, 100)),
        SessionEvent::Scene(scene(2, 2 * second, 100)),
        SessionEvent::Tick(at(2 * second + 5)),
        SessionEvent::Prepared {
            at: at(2 * second + 6),
            arrived_at: at(2 * second),
            light: Some(LightRecord {
                seen: true,
                lit_by: Some(at(second)),
            }),
        },
        SessionEvent::Prepared {
            at: at(2 * second + 6),
            arrived_at: at(2 * second + 1),
            light: Some(LightRecord {
                seen: false,
                lit_by: None,
            }),
        },
        // As written by older rigs, which rendered each picture in the light of the previous one.
        SessionEvent::Prepared {
            at: at(2 * second + 6),
            arrived_at: at(2 * second + 2),
            light: None,
        },
        // Stamped by another thread earlier, but received later.
        SessionEvent::TrackerBytes {
            protocol: "fastrak".into(),
            bytes: Bytes::from_static(b"abc"),
            arrived_at: at(2 * second - 1),
        },
        SessionEvent::TrackerBytes {
            protocol: "csv".into(),
            bytes: Bytes::from_static(b"1,2"),
            arrived_at: at(2 * second + 7),
        },
        SessionEvent::Scene(scene(3, 3 * second, 50)),
    ]
}

#[test]
fn controls_and_journal_round_trip_in_file_order() {
    let events = events_of_a_live_rig();
    let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("memory")).unwrap();
    for event in &events {
        writer.event(event).unwrap();
    }
    let bytes = writer.finish().unwrap().into_inner();
    let (_folder, session) = opened(&bytes).unwrap();
    assert!(session.has_journal());
    let found: Vec<_> = session.events().map(Result::unwrap).collect();
    assert_eq!(format!("{found:?}"), format!("{events:?}"));
    let infos = session.streams().unwrap();
    let messages = infos.iter().find(|i| i.topic == "/scene_camera/controls");
    assert_eq!(messages.unwrap().messages, 2, "only where they change");
}
