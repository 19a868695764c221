//! Writes the recording of a rehearsal.

use penumbra_calibration::simulation::{FrameTruth, Rehearsal, fastrak_record};
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_numerics::Random;
use penumbra_picture::Picture;
use penumbra_session::{Camera, SessionError, SessionWriter};
use penumbra_status::stream::{EncodeError, JpegEncoder};
use serde_json::Value;
use std::path::Path;
use thiserror::Error;

/// The clock at the beginning, nanoseconds.
const BEGIN: i64 = 1_000_000_000_000;
/// Records a second of a FASTRAK with one sensor, and pictures a second of the other camera.
const TRACKER_RATE: f64 = 120.0;
const ENVIRONMENT_RATE: f64 = 15.0;
/// The tracker records for so long before and after the pictures, seconds.
const AROUND: f64 = 0.4;
/// How far stamps wander, seconds: pictures', records'.
const JITTER: (f64, f64) = (0.0015, 0.0002);
/// From a picture's stamp to its arrival, seconds.
const TRANSFER: f64 = 0.018;
const QUALITY: u8 = 95;
/// Length of a gap in the tracker's stream, seconds.
const GAP: f64 = 0.25;

/// A rehearsal cannot be written.
#[derive(Debug, Error)]
pub enum RehearsalError {
    /// The file.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A picture.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

#[derive(Clone, Copy)]
enum Due {
    Picture(Camera),
    Record,
}

/// Records `rehearsal` to a new file, and returns its truth; `told` hears how far it is (0 to 1).
///
/// # Errors
/// A file that exists or cannot be written.
pub fn rehearse(
    rehearsal: &Rehearsal,
    path: &Path,
    mut told: impl FnMut(f64),
) -> Result<Value, RehearsalError> {
    let mut writer = SessionWriter::create(path)?;
    let papers = rehearsal.rig_json().to_string();
    writer.attach("rig.json", papers.as_bytes())?;
    let mut random = Random::new(rehearsal.options.seed ^ 0x5eed);
    let due = schedule(rehearsal, &mut random);
    let mut encoder = JpegEncoder::new(QUALITY)?;
    let mut truth = Vec::new();
    let count = due.len();
    for (i, (arrival, at, what)) in due.into_iter().enumerate() {
        match what {
            Due::Record => {
                let record = fastrak_record(rehearsal.measured(at, &mut random));
                writer.tracker_bytes("fastrak", record.as_bytes(), instant(arrival))?;
            }
            Due::Picture(camera) => {
                let frame = frame(rehearsal, camera, (arrival, at), &mut random, &mut encoder)?;
                if camera == Camera::Scene {
                    truth.push(FrameTruth {
                        stamp: frame.captured_at.as_nanos(),
                        captured: instant(at).as_nanos(),
                        world_from_camera: rehearsal.world_from_camera(at),
                    });
                }
                writer.frame(camera, &frame)?;
                told(i as f64 / count as f64);
            }
        }
    }
    writer.finish()?;
    Ok(rehearsal.truth_json(&truth))
}

fn instant(seconds: f64) -> MonotonicTime {
    MonotonicTime::from_nanos(BEGIN + (seconds * 1e9).round() as i64)
}

/// Arrival, instant of capture or measurement, and what, by arrival.
fn schedule(rehearsal: &Rehearsal, random: &mut Random) -> Vec<(f64, f64, Due)> {
    let options = &rehearsal.options;
    let mut due = Vec::new();
    let mut cameras = vec![(Camera::Scene, options.rate, 0.0)];
    if rehearsal.environment.is_some() {
        cameras.push((Camera::Environment, ENVIRONMENT_RATE, 0.0171));
    }
    for (camera, rate, phase) in cameras {
        for i in 0..(options.seconds * rate) as u32 {
            let at = AROUND + phase + f64::from(i) / rate + JITTER.0 * random.normal();
            let arrival = at + options.camera_latency + TRANSFER + JITTER.1 * random.normal();
            due.push((arrival, at, Due::Picture(camera)));
        }
    }
    let records = (TRACKER_RATE * (options.seconds + 2.0 * AROUND)) as u32;
    let mut silent_until = 0.0;
    for i in 0..records {
        let at = f64::from(i) / TRACKER_RATE;
        if random.uniform() < options.gaps / (GAP * TRACKER_RATE) {
            silent_until = at + GAP;
        }
        if at >= silent_until {
            let arrival = at + options.tracker_latency + JITTER.1 * random.normal();
            due.push((arrival, at, Due::Record));
        }
    }
    due.sort_by(|a, b| a.0.total_cmp(&b.0));
    due
}

fn frame(
    rehearsal: &Rehearsal,
    camera: Camera,
    (arrival, at): (f64, f64),
    random: &mut Random,
    encoder: &mut JpegEncoder,
) -> Result<Frame, EncodeError> {
    let (eye, codes) = match camera {
        Camera::Scene => (Some(&rehearsal.scene), rehearsal.scene_picture(at, random)),
        Camera::Environment => (
            rehearsal.environment.as_ref(),
            rehearsal.environment_picture(at, random),
        ),
    };
    let (width, height) = eye.map_or((0, 0), |e| (e.lens().width, e.lens().height));
    let picture = Picture {
        width,
        height,
        rgba: codes.iter().flat_map(|c| [*c, *c, *c, 255]).collect(),
    };
    Ok(Frame {
        data: encoder.encode(&picture)?,
        format: PixelFormat::Jpeg,
        width,
        height,
        stride: 0,
        sequence: (at * 1000.0) as u64,
        captured_at: instant(at + rehearsal.options.camera_latency),
        arrived_at: instant(arrival),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    })
}
