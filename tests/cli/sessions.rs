//! Writes sessions and folders derived from the bundled session.

use crate::program::{Desk, desk_session};
use penumbra_interface::Frame;
use penumbra_session::{Camera, Session, SessionEvent, SessionWriter};
use std::fmt::Write;

/// Returns the first pictures of the bundled session's scene camera.
pub fn scene_frames(count: usize) -> Vec<Frame> {
    let events = Session::open(&desk_session()).unwrap().events();
    let scene = events.filter_map(|event| match event.unwrap() {
        SessionEvent::Scene(frame) => Some(frame),
        _ => None,
    });
    scene.take(count).collect()
}

/// Writes a session with one picture and these attachments.
pub fn put_session(desk: &Desk, name: &str, attachments: &[(&str, &[u8])]) {
    let mut writer = SessionWriter::create(&desk.path(name)).unwrap();
    for (name, data) in attachments {
        writer.attach(name, data).unwrap();
    }
    writer.frame(Camera::Scene, &scene_frames(1)[0]).unwrap();
    writer.finish().unwrap();
}

/// Writes the pictures of the scene camera of `session` without its attachments.
pub fn put_without_attachments(desk: &Desk, session: &Session, name: &str) {
    let mut writer = SessionWriter::create(&desk.path(name)).unwrap();
    for event in session.events() {
        if let SessionEvent::Scene(frame) = event.unwrap() {
            writer.frame(Camera::Scene, &frame).unwrap();
        }
    }
    writer.finish().unwrap();
}

/// Writes the bundled session with one flipped byte in the picture number `frame` of the scene
/// camera.
pub fn put_with_flipped_byte(desk: &Desk, name: &str, frame: usize) {
    let mut bytes = std::fs::read(desk_session()).unwrap();
    let picture = &scene_frames(frame + 1)[frame].data;
    let at = bytes.windows(64).position(|w| *w == picture[1000..1064]);
    bytes[at.unwrap()] ^= 1;
    desk.put(name, bytes);
}

/// Writes an MCAP file of another program.
pub fn put_foreign(desk: &Desk, name: &str) {
    let file = std::fs::File::create(desk.path(name)).unwrap();
    let mut writer = mcap::Writer::new(file).unwrap();
    let schema = writer.add_schema("Weather", "jsonschema", b"{}").unwrap();
    let channel = writer
        .add_channel(schema, "/weather", "json", &Default::default())
        .unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 1,
        publish_time: 1,
    };
    writer.write_to_known_channel(&header, b"{}").unwrap();
    writer.finish().unwrap();
}

/// Writes the beginning of the bundled session as a folder that `import` reads: everything that
/// arrived before the scene camera's picture number `frames`.
pub fn put_rig_folder(desk: &Desk, folder: &str, frames: u64) {
    let session = Session::open(&desk_session()).unwrap();
    for attachment in session.attachments() {
        desk.put(&format!("{folder}/{}", attachment.name), &attachment.data);
    }
    let mut out = Unpacked::new();
    let events = session.events().map(Result::unwrap);
    for event in events.take_while(|e| !matches!(e, SessionEvent::Scene(f) if f.sequence >= frames))
    {
        out.take(desk, folder, event);
    }
    desk.put(&format!("{folder}/scene_timestamps.csv"), out.scene);
    desk.put(&format!("{folder}/env_timestamps.csv"), out.environment);
    desk.put(&format!("{folder}/tracker_fastrak.txt"), out.tracker);
    desk.put(&format!("{folder}/tracker_fastrak_index.csv"), out.index);
}

struct Unpacked {
    scene: String,
    environment: String,
    tracker: Vec<u8>,
    index: String,
}

impl Unpacked {
    fn new() -> Self {
        let pictures = "frame,file,timestamp_ns\n".to_owned();
        Self {
            scene: pictures.clone(),
            environment: pictures,
            tracker: Vec::new(),
            index: "byte_offset,arrival_ns\n".to_owned(),
        }
    }

    fn take(&mut self, desk: &Desk, folder: &str, event: SessionEvent) {
        match event {
            SessionEvent::Scene(frame) => {
                let file = format!("scene/{:05}.jpg", frame.sequence);
                let arrival = frame.arrived_at.as_nanos();
                writeln!(self.scene, "{},{file},{arrival}", frame.sequence).unwrap();
                desk.put(&format!("{folder}/{file}"), &frame.data);
            }
            SessionEvent::Environment(frame) => {
                let base = format!("env/{:05}", frame.sequence);
                if frame.bracket_ev == 0.0 {
                    let arrival = frame.arrived_at.as_nanos();
                    writeln!(self.environment, "{},{base}.jpg,{arrival}", frame.sequence).unwrap();
                    desk.put(&format!("{folder}/{base}.jpg"), &frame.data);
                } else {
                    let file = format!("{base}_ev{}.jpg", frame.bracket_ev);
                    desk.put(&format!("{folder}/{file}"), &frame.data);
                }
            }
            SessionEvent::TrackerBytes {
                bytes, arrived_at, ..
            } => {
                let arrival = arrived_at.as_nanos();
                writeln!(self.index, "{},{arrival}", self.tracker.len()).unwrap();
                self.tracker.extend_from_slice(&bytes);
            }
            SessionEvent::Pose(_) | SessionEvent::Tick(_) | SessionEvent::Prepared { .. } => (),
        }
    }
}

/// Writes a folder of the TUM RGB-D layout with two pictures, poses and a calibration.
pub fn put_tum_folder(desk: &Desk, folder: &str) {
    let mut list = "# timestamp filename\n".to_owned();
    for (i, frame) in scene_frames(2).iter().enumerate() {
        writeln!(list, "1.{i}00000 rgb/{i}.jpg").unwrap();
        desk.put(&format!("{folder}/rgb/{i}.jpg"), &frame.data);
    }
    desk.put(&format!("{folder}/rgb.txt"), list);
    let poses = "1.00 0 0 0.5 1 0 0 0\n1.05 0 0 0.5 1 0 0 0\n1.10 0 0 0.5 1 0 0 0\n";
    desk.put(&format!("{folder}/groundtruth.txt"), poses);
    let rig = r#"{"scene_camera":{"image_size":[640,480],"K":[[600,0,320],[0,600,240],[0,0,1]]}}"#;
    desk.put(&format!("{folder}/rig.json"), rig);
}
