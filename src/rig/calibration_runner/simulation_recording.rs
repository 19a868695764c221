//! Writes the session that a simulated rig records.

use penumbra_calibration::simulation::{FrameTruth, SimulatedRig, SimulatedWebcam, fastrak_record};
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_numerics::Random;
use penumbra_picture::Picture;
use penumbra_session::{Camera, RigViews, SessionError, SessionWriter, ViewedRig};
use penumbra_status::stream::{EncodeError, JpegEncoder};
use serde_json::Value;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use thiserror::Error;

/// Clock at the start, nanoseconds.
const START_NANOS: i64 = 1_000_000_000_000;
/// Records per second of a FASTRAK with one sensor.
const TRACKER_RATE: f64 = 120.0;
/// Pictures per second of the environment camera.
const ENVIRONMENT_RATE: f64 = 15.0;
/// Duration of tracker data before and after the pictures, seconds.
const TRACKER_MARGIN_SECONDS: f64 = 0.4;
/// Standard deviation of the interval between captures, seconds.
const CAPTURE_JITTER_SECONDS: f64 = 0.0015;
/// Standard deviation of arrival times, seconds.
const ARRIVAL_JITTER_SECONDS: f64 = 0.0002;
/// Time from a picture's stamp to its arrival, seconds.
const TRANSFER_SECONDS: f64 = 0.018;
/// JPEG quality, per cent.
const JPEG_QUALITY: u8 = 95;
/// Length of a gap in the tracker's stream, seconds.
const GAP_SECONDS: f64 = 0.25;

/// Error of a simulated session that cannot be written.
#[derive(Debug, Error)]
pub enum SimulationRecordingError {
    /// The session cannot be written.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A picture cannot be encoded.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

#[derive(Clone, Copy)]
enum Event {
    Picture(Camera),
    /// A record of the tracker.
    Record,
}

/// Records `simulation` to a new file, and returns its ground truth. Calls `report` after each
/// picture with the share that is written (0 to 1).
///
/// # Errors
/// The file exists or cannot be written.
pub fn record_simulation(
    simulation: &SimulatedRig,
    path: &Path,
    mut report: impl FnMut(f64),
) -> Result<Value, SimulationRecordingError> {
    let writer = SessionWriter::create(path)?;
    let written = record(simulation, writer, &mut report);
    if written.is_err() {
        // A part of a simulation is of no use.
        let _ = std::fs::remove_file(path);
    }
    written
}

fn record(
    simulation: &SimulatedRig,
    mut writer: SessionWriter<BufWriter<File>>,
    report: &mut impl FnMut(f64),
) -> Result<Value, SimulationRecordingError> {
    let rig_json = simulation.rig_json();
    writer.attach("rig.json", rig_json.to_string().as_bytes())?;
    let mut views = RigViews::new(ViewedRig::from_rig_json(&rig_json));
    let mut random = Random::new(simulation.options.seed ^ 0x5eed);
    let events = schedule(simulation, &mut random);
    let mut encoder = JpegEncoder::new(JPEG_QUALITY)?;
    let mut truth = Vec::new();
    let count = events.len();
    if let Some((arrival, ..)) = events.first() {
        views.begin(&mut writer, instant(*arrival))?;
    }
    let mut pictures = [0_u64; 2];
    for (i, (arrival, at, event)) in events.into_iter().enumerate() {
        match event {
            Event::Record => {
                let record = fastrak_record(simulation.measured(at, &mut random));
                let (bytes, arrived_at) = (record.as_bytes(), instant(arrival));
                writer.tracker_bytes("fastrak", bytes, arrived_at)?;
                views.tracker_bytes(&mut writer, "fastrak", (bytes, arrived_at))?;
            }
            Event::Picture(camera) => {
                let mut frame =
                    frame(simulation, camera, (arrival, at), &mut random, &mut encoder)?;
                let counter = &mut pictures[usize::from(camera == Camera::Environment)];
                frame.sequence = *counter;
                *counter += 1;
                if camera == Camera::Scene {
                    truth.push(FrameTruth {
                        stamp: frame.captured_at.as_nanos(),
                        captured: instant(at).as_nanos(),
                        world_from_camera: simulation.world_from_camera(at),
                    });
                }
                writer.frame(camera, &frame)?;
                report(i as f64 / count as f64);
            }
        }
    }
    writer.finish()?;
    Ok(simulation.truth_json(&truth))
}

/// Records a simulated webcam to a new file, for `seconds` at `rate` pictures per second. Calls
/// `report` after each picture with the share that is written (0 to 1).
///
/// # Errors
/// The file exists or cannot be written.
pub fn record_webcam(
    webcam: &SimulatedWebcam,
    path: &Path,
    (seconds, rate): (f64, f64),
    mut report: impl FnMut(f64),
) -> Result<(), SimulationRecordingError> {
    let mut writer = SessionWriter::create(path)?;
    let mut written = || -> Result<(), SimulationRecordingError> {
        writer.attach("rig.json", webcam.rig_json().to_string().as_bytes())?;
        let mut random = Random::new(7);
        let mut encoder = JpegEncoder::new(JPEG_QUALITY)?;
        let count = (seconds * rate) as u32;
        for i in 0..count {
            let at = f64::from(i) / rate;
            let picture = webcam.picture(webcam.pose(at), 1.0, &mut random);
            let frame = Frame {
                data: encoder.encode(&picture)?,
                format: PixelFormat::Jpeg,
                width: picture.width,
                height: picture.height,
                stride: 0,
                sequence: u64::from(i),
                captured_at: instant(at),
                arrived_at: instant(at + TRANSFER_SECONDS),
                exposure: None,
                bracket_ev: 0.0,
                controls: None,
            };
            writer.frame(Camera::Scene, &frame)?;
            report(f64::from(i + 1) / f64::from(count));
        }
        Ok(())
    };
    let result = written().and_then(|()| Ok(writer.finish().map(drop)?));
    if result.is_err() {
        // A part of a simulation is of no use.
        let _ = std::fs::remove_file(path);
    }
    result
}

fn instant(seconds: f64) -> MonotonicTime {
    MonotonicTime::from_nanos(START_NANOS + (seconds * 1e9).round() as i64)
}

/// Returns all events with their times of arrival and of capture or measurement, seconds, sorted by
/// arrival.
fn schedule(simulation: &SimulatedRig, random: &mut Random) -> Vec<(f64, f64, Event)> {
    let options = &simulation.options;
    let mut events = Vec::new();
    let mut cameras = vec![(Camera::Scene, options.rate, 0.0)];
    if simulation.environment.is_some() {
        cameras.push((Camera::Environment, ENVIRONMENT_RATE, 0.0171));
    }
    for (camera, rate, phase) in cameras {
        for i in 0..(options.seconds * rate) as u32 {
            let jitter = CAPTURE_JITTER_SECONDS * random.normal();
            let at = TRACKER_MARGIN_SECONDS + phase + f64::from(i) / rate + jitter;
            let jitter = ARRIVAL_JITTER_SECONDS * random.normal();
            let arrival = at + options.camera_latency + TRANSFER_SECONDS + jitter;
            events.push((arrival, at, Event::Picture(camera)));
        }
    }
    let records = (TRACKER_RATE * (options.seconds + 2.0 * TRACKER_MARGIN_SECONDS)) as u32;
    let mut silent_until = 0.0;
    for i in 0..records {
        let at = f64::from(i) / TRACKER_RATE;
        if random.uniform() < options.gaps / (GAP_SECONDS * TRACKER_RATE) {
            silent_until = at + GAP_SECONDS;
        }
        if at >= silent_until {
            let arrival = at + options.tracker_latency + ARRIVAL_JITTER_SECONDS * random.normal();
            events.push((arrival, at, Event::Record));
        }
    }
    events.sort_by(|a, b| a.0.total_cmp(&b.0));
    events
}

/// Renders and encodes a picture that is captured at `at` and arrives at `arrival`, seconds.
fn frame(
    simulation: &SimulatedRig,
    camera: Camera,
    (arrival, at): (f64, f64),
    random: &mut Random,
    encoder: &mut JpegEncoder,
) -> Result<Frame, EncodeError> {
    let (simulated_camera, codes) = match camera {
        Camera::Scene => (
            Some(&simulation.scene),
            simulation.scene_picture(at, random),
        ),
        Camera::Environment => (
            simulation.environment.as_ref(),
            simulation.environment_picture(at, random),
        ),
    };
    let (width, height) = simulated_camera.map_or((0, 0), |c| (c.lens().width, c.lens().height));
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
        sequence: 0,
        captured_at: instant(at + simulation.options.camera_latency),
        arrived_at: instant(arrival),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    })
}
