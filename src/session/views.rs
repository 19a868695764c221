//! What viewers need to know of a rig: its frame tree, the lenses of its cameras, and the poses in the
//! tracker's bytes. It is written beside the raw data and never read back.

use super::SessionError;
use super::events::SessionEvent;
use super::messages;
use super::topics::Camera;
use super::writer::SessionWriter;
use foxglove::messages::{CameraCalibration, Timestamp};
use glam::{DMat4, DVec3};
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_tracker_serial::AnyDecoder;
use penumbra_tracker_serial::fastrak::{METRES_PER_CENTIMETRE, METRES_PER_INCH};
use serde_json::Value;
use std::io::{Seek, Write};

/// What viewers are told of a rig that does not change.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewedRig {
    /// Lenses of the cameras.
    pub lenses: Vec<ViewedLens>,
    /// Constant transforms: names of parent and child, and `parent_from_child`.
    pub fixed: Vec<((String, String), RigidTransform)>,
    /// The tracker's unit of length; `None` for its protocol's own.
    pub metres_per_unit: Option<f64>,
}

/// The lens of a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewedLens {
    /// Whose lens it is.
    pub camera: Camera,
    /// Width and height of the picture, pixels.
    pub size: (u32, u32),
    /// Focal lengths (x, y) and principal point (x, y), pixels.
    pub intrinsics: [f64; 4],
    /// Coefficients of the distortion.
    pub distortion: Distortion,
}

/// The distortion of a lens, in OpenCV's order of coefficients.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// k1, k2, p1, p2, k3 of Brown and Conrady.
    Brown([f64; 5]),
    /// k1 to k4 of Kannala and Brandt, for a fisheye.
    KannalaBrandt([f64; 4]),
}

/// Frame of the receiver of a station (from 1), for [`ViewedRig::fixed`].
#[must_use]
pub fn sensor_frame(station: u8) -> String {
    messages::sensor_frame(station)
}

impl ViewedRig {
    /// Reads a `rig.json` of a rig with a FASTRAK; what it lacks is left out.
    #[must_use]
    pub fn from_rig_json(rig: &Value) -> Self {
        let cameras = [
            (Camera::Scene, &rig["scene_camera"]),
            (Camera::Environment, &rig["environment_camera"]),
        ];
        let lens = |(camera, entry)| lens(camera, entry);
        Self {
            lenses: cameras.into_iter().filter_map(lens).collect(),
            fixed: fixed(rig),
            metres_per_unit: Some(metres_per_unit(rig)),
        }
    }

    /// Returns the calibrations of the cameras.
    pub(super) fn calibrations(&self, stamp: Timestamp) -> Vec<(Camera, CameraCalibration)> {
        let lenses = self.lenses.iter();
        let calibrations = lenses.map(|lens| (lens.camera, lens.calibration(stamp)));
        calibrations.collect()
    }
}

impl ViewedLens {
    fn calibration(&self, stamp: Timestamp) -> CameraCalibration {
        let [fx, fy, cx, cy] = self.intrinsics;
        let k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        let (model, d) = match self.distortion {
            Distortion::Brown(d) => ("plumb_bob", d.to_vec()),
            Distortion::KannalaBrandt(d) => ("kannala_brandt", d.to_vec()),
        };
        messages::camera_calibration(self.camera, self.size, k, (model, d), stamp)
    }
}

/// Writes what viewers need to know of a rig.
pub struct RigViews {
    rig: ViewedRig,
    /// Time of [`Self::begin`].
    start: Option<MonotonicTime>,
    /// The tracker's newest protocol and its decoder; `None` for one that is unknown.
    tracker: Option<(String, Option<AnyDecoder>)>,
    poses: Vec<PoseSample>,
}

impl RigViews {
    /// Prepares for a rig.
    #[must_use]
    pub const fn new(rig: ViewedRig) -> Self {
        Self {
            rig,
            start: None,
            tracker: None,
            poses: Vec::new(),
        }
    }

    /// Writes calibrations and constant transforms.
    ///
    /// # Errors
    /// The time is before the clock's zero, or nothing can be written.
    pub fn begin<W: Write + Seek>(
        &mut self,
        writer: &mut SessionWriter<W>,
        start: MonotonicTime,
    ) -> Result<(), SessionError> {
        self.start = Some(start);
        if let Some(stamp) = messages::timestamp(start) {
            for (camera, calibration) in self.rig.calibrations(stamp) {
                writer.view_calibration(camera, &calibration, start)?;
            }
        }
        for ((parent, child), pose) in &self.rig.fixed {
            writer.view_transform((parent, child), *pose, start)?;
        }
        Ok(())
    }

    /// Writes a lens that is used from `at` on.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn lens<W: Write + Seek>(
        &mut self,
        writer: &mut SessionWriter<W>,
        lens: &ViewedLens,
        at: MonotonicTime,
    ) -> Result<(), SessionError> {
        match messages::timestamp(at) {
            Some(stamp) => writer.view_calibration(lens.camera, &lens.calibration(stamp), at),
            None => Ok(()),
        }
    }

    /// Writes what viewers need beside an event; begins with the first one.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn event<W: Write + Seek>(
        &mut self,
        writer: &mut SessionWriter<W>,
        event: &SessionEvent,
    ) -> Result<(), SessionError> {
        if self.start.is_none() {
            self.begin(writer, event.arrived_at())?;
        }
        match event {
            SessionEvent::TrackerBytes {
                protocol,
                bytes,
                arrived_at,
            } => self.tracker_bytes(writer, protocol, (bytes, *arrived_at)),
            _ => Ok(()),
        }
    }

    /// Writes the poses in bytes of the tracker.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn tracker_bytes<W: Write + Seek>(
        &mut self,
        writer: &mut SessionWriter<W>,
        protocol: &str,
        (bytes, arrived_at): (&[u8], MonotonicTime),
    ) -> Result<(), SessionError> {
        if self
            .tracker
            .as_ref()
            .is_none_or(|(known, _)| known != protocol)
        {
            self.tracker = Some((protocol.to_owned(), decoder(protocol, &self.rig)));
        }
        let Self {
            tracker,
            poses,
            start,
            ..
        } = self;
        if let Some((_, Some(decoder))) = tracker {
            decoder.push(bytes, arrived_at, |sample| poses.push(sample));
        }
        for sample in poses.drain(..) {
            // The frame tree is in the order of time, and begins with the constant transforms.
            if start.is_some_and(|start| sample.arrived_at < start) {
                continue;
            }
            let sensor = messages::sensor_frame(sample.station);
            let pose = sample.transmitter_from_sensor;
            writer.view_transform(("tracker", &sensor), pose, sample.arrived_at)?;
        }
        Ok(())
    }
}

/// Returns the decoder of a protocol in a rig's unit of length; `None` for an unknown protocol.
fn decoder(protocol: &str, rig: &ViewedRig) -> Option<AnyDecoder> {
    let decoder = AnyDecoder::for_protocol(protocol)?;
    Some(match rig.metres_per_unit {
        Some(metres) => decoder.with_metres_per_unit(metres),
        None => decoder,
    })
}

/// Returns the unit of length of a rig's FASTRAK, metres.
pub(super) fn metres_per_unit(rig: &Value) -> f64 {
    match rig["tracker"]["fastrak"]["units"].as_str() {
        Some("centimetres") => METRES_PER_CENTIMETRE,
        Some("millimetres") => 0.001,
        Some("metres") => 1.0,
        _ => METRES_PER_INCH,
    }
}

/// Returns the constant transforms of a `rig.json`.
fn fixed(rig: &Value) -> Vec<((String, String), RigidTransform)> {
    let all = [
        ("world", "tracker", &rig["tracker"]["T_world_source"]),
        ("sensor_1", "scene_camera", &rig["tracker"]["T_sensor_cam"]),
        (
            "world",
            "environment_camera",
            &rig["environment_camera"]["T_world_cam"],
        ),
    ];
    let stated = all.into_iter().filter_map(|(parent, child, placement)| {
        let frames = (parent.to_owned(), child.to_owned());
        Some((frames, rigid(&placement["matrix_row_major"])?))
    });
    stated.collect()
}

/// Returns the lens of a pinhole camera or a fisheye in `rig.json`.
fn lens(camera: Camera, entry: &Value) -> Option<ViewedLens> {
    let side = |i: usize| u32::try_from(entry["image_size"][i].as_u64()?).ok();
    let size = (side(0)?, side(1)?);
    let projection = &entry["projection"];
    let fisheye = ["f", "f", "cx", "cy"].map(|key| projection[key].as_f64());
    let pinhole = [(0, 0), (1, 1), (0, 2), (1, 2)].map(|(i, j)| entry["K"][i][j].as_f64());
    let coefficient = |from: &Value, i: usize, key: &str| {
        let listed = from[i].as_f64().or_else(|| from[key].as_f64());
        listed.unwrap_or_default()
    };
    let (intrinsics, distortion) = if let [Some(fx), Some(fy), Some(cx), Some(cy)] = fisheye {
        let keys = ["k1", "k2", "k3", "k4"];
        let d = keys.map(|key| projection[key].as_f64().unwrap_or_default());
        ([fx, fy, cx, cy], Distortion::KannalaBrandt(d))
    } else if let [Some(fx), Some(fy), Some(cx), Some(cy)] = pinhole {
        let keys = [(0, "k1"), (1, "k2"), (2, "p1"), (3, "p2"), (4, "k3")];
        let d = keys.map(|(i, key)| coefficient(&entry["lens_distortion"], i, key));
        ([fx, fy, cx, cy], Distortion::Brown(d))
    } else {
        return None;
    };
    Some(ViewedLens {
        camera,
        size,
        intrinsics,
        distortion,
    })
}

fn rigid(rows: &Value) -> Option<RigidTransform> {
    let mut columns = [[0.0; 4]; 4];
    for (i, column) in columns.iter_mut().enumerate() {
        for (j, value) in column.iter_mut().enumerate() {
            *value = rows[j][i].as_f64()?;
        }
    }
    let matrix = DMat4::from_cols_array_2d(&columns);
    let pose = RigidTransform::from_matrix(matrix);
    let is_rotation = (matrix.determinant() - 1.0).abs() < 1e-3;
    (is_rotation && pose.translation.cmpgt(DVec3::splat(f64::MIN)).all()).then_some(pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use std::collections::BTreeMap;
    use std::io::Cursor;
    use std::path::Path;

    #[test]
    fn viewers_get_lenses_frames_and_poses() {
        let identity =
            json!({"matrix_row_major": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]});
        let rig = json!({
            "scene_camera": {"image_size": [640, 480], "K": [[700, 0, 320], [0, 700, 240], [0, 0, 1]]},
            "environment_camera": {"image_size": [480, 480], "T_world_cam": identity,
                "projection": {"f": 150.0, "cx": 240.0, "cy": 240.0}},
            "tracker": {"T_world_source": identity, "T_sensor_cam": identity,
                "fastrak": {"units": "centimetres"}},
        });
        let at = MonotonicTime::from_nanos;
        let mut views = RigViews::new(ViewedRig::from_rig_json(&rig));
        let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("a.mcap")).unwrap();
        views.begin(&mut writer, at(1_000)).unwrap();
        let record = b"01   10.00  20.00  30.00   0.00   0.00   0.00\r\n";
        // In portions, and a rest that states no pose.
        let stream = [&record[..], record, record, &record[..9]].concat();
        for (i, portion) in stream.chunks(20).enumerate() {
            let arrived_at = at(2_000 + i as i64);
            views
                .tracker_bytes(&mut writer, "fastrak", (portion, arrived_at))
                .unwrap();
        }
        let bytes = writer.finish().unwrap().into_inner();
        let mut counts = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            *counts
                .entry(message.unwrap().channel.topic.clone())
                .or_insert(0) += 1;
        }
        let transforms = counts.remove("/tf");
        // Three constant ones, and a pose for each record; the first may be needed to find the beginning.
        assert!(transforms >= Some(5), "{transforms:?}");
        let lenses = [
            "/environment_camera/calibration",
            "/scene_camera/calibration",
        ];
        assert_eq!(counts, lenses.map(|topic| (topic.to_owned(), 1)).into());
    }

    #[test]
    fn what_a_rig_lacks_is_left_out() {
        let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("a.mcap")).unwrap();
        let rig = json!({"scene_camera": {"image_size": ["a", 1]}, "tracker": 3});
        let mut views = RigViews::new(ViewedRig::from_rig_json(&rig));
        views
            .begin(&mut writer, MonotonicTime::from_nanos(1))
            .unwrap();
        let bytes = writer.finish().unwrap().into_inner();
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().count(), 0);
    }

    #[test]
    fn distortion_of_lenses_is_stated() {
        let camera = |distortion: Value| {
            json!({"scene_camera": {"image_size": [640, 480], "lens_distortion": distortion,
                "K": [[700, 0, 320], [0, 710, 240], [0, 0, 1]]},
            "environment_camera": {"image_size": [480, 480],
                "projection": {"f": 150.0, "cx": 240.0, "cy": 241.0, "k2": 0.5}}})
        };
        let brown = |distortion| {
            let rig = ViewedRig::from_rig_json(&camera(distortion));
            assert_eq!(rig.lenses[0].intrinsics, [700.0, 710.0, 320.0, 240.0]);
            let fisheye = Distortion::KannalaBrandt([0.0, 0.5, 0.0, 0.0]);
            assert_eq!(rig.lenses[1].distortion, fisheye);
            rig.lenses[0].distortion
        };
        assert_eq!(brown(json!("none")), Distortion::Brown([0.0; 5]));
        let all = Distortion::Brown([0.1, 0.2, 0.3, 0.4, 0.0]);
        assert_eq!(brown(json!([0.1, 0.2, 0.3, 0.4])), all);
        let named = json!({"k1": 0.1, "k2": 0.2, "p1": 0.3, "p2": 0.4});
        assert_eq!(brown(named), all);
        let stamp = messages::timestamp(MonotonicTime::from_nanos(1)).unwrap();
        let rig = ViewedRig::from_rig_json(&camera(json!([0.1, 0.2, 0.3, 0.4])));
        let (_, calibration) = rig.calibrations(stamp).swap_remove(0);
        assert_eq!(calibration.d, [0.1, 0.2, 0.3, 0.4, 0.0]);
        assert_eq!(calibration.k[4], 710.0);
    }

    #[test]
    fn any_protocol_is_decoded_in_the_rigs_unit_from_the_first_event_on() {
        let record = b"01   10.00  20.00  30.00   0.00   0.00   0.00\r\n";
        let event = |protocol: &str, nanos| SessionEvent::TrackerBytes {
            protocol: protocol.into(),
            bytes: [&record[..], record].concat().into(),
            arrived_at: MonotonicTime::from_nanos(nanos),
        };
        let mut views = RigViews::new(ViewedRig {
            metres_per_unit: Some(0.01),
            ..ViewedRig::default()
        });
        let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("a.mcap")).unwrap();
        // A later one that arrived before the first is left out, as is an unknown protocol.
        let events = [
            ("fastrak", 2_000),
            ("fastrak", 1_000),
            ("polaris", 3_000),
            ("fastrak", 4_000),
        ];
        for (protocol, nanos) in events {
            views.event(&mut writer, &event(protocol, nanos)).unwrap();
        }
        let bytes = writer.finish().unwrap().into_inner();
        let written = mcap::MessageStream::new(&bytes)
            .unwrap()
            .map(Result::unwrap);
        let times: Vec<_> = written.map(|message| message.log_time).collect();
        assert!(times.len() >= 2 && times.is_sorted(), "{times:?}");
        assert!(times.iter().all(|time| *time >= 2_000), "{times:?}");
        assert!(times.contains(&4_000), "{times:?}");
    }
}
