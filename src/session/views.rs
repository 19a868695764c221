//! What viewers need to know of a rig: its frame tree, the lenses of its cameras, and the poses in the
//! tracker's bytes. It is written beside the raw data and never read back.

use super::SessionError;
use super::messages;
use super::topics::Camera;
use super::writer::SessionWriter;
use foxglove::messages::{CameraCalibration, Timestamp};
use glam::{DMat4, DVec3};
use penumbra_interface::{MonotonicTime, PoseSample, RigidTransform};
use penumbra_tracker_serial::fastrak::{Decoder, Format, METRES_PER_CENTIMETRE, METRES_PER_INCH};
use serde_json::Value;
use std::io::{Seek, Write};

/// Writes what viewers need to know of a rig with a FASTRAK.
pub struct RigViews {
    rig: Value,
    decoder: Decoder,
    poses: Vec<PoseSample>,
}

impl RigViews {
    /// Prepares for the rig of a `rig.json`; what it lacks is left out.
    #[must_use]
    pub fn new(rig: Value) -> Self {
        Self {
            decoder: tracker_decoder(&rig),
            rig,
            poses: Vec::new(),
        }
    }

    /// Writes calibrations and constant transforms.
    ///
    /// # Errors
    /// The time is before the clock's zero, or nothing can be written.
    pub fn begin<W: Write + Seek>(
        &self,
        writer: &mut SessionWriter<W>,
        start: MonotonicTime,
    ) -> Result<(), SessionError> {
        if let Some(stamp) = messages::timestamp(start) {
            for (camera, calibration) in calibrations(&self.rig, stamp) {
                writer.view_calibration(camera, &calibration, start)?;
            }
        }
        for ((parent, child), pose) in fixed(&self.rig) {
            writer.view_transform((parent, child), pose, start)?;
        }
        Ok(())
    }

    /// Writes the poses in the tracker's bytes.
    ///
    /// # Errors
    /// As [`Self::begin`].
    pub fn tracker_bytes<W: Write + Seek>(
        &mut self,
        writer: &mut SessionWriter<W>,
        bytes: &[u8],
        arrived_at: MonotonicTime,
    ) -> Result<(), SessionError> {
        let Self { decoder, poses, .. } = self;
        decoder.push(bytes, arrived_at, |sample| poses.push(sample));
        for sample in poses.drain(..) {
            let sensor = messages::sensor_frame(sample.station);
            let pose = sample.transmitter_from_sensor;
            writer.view_transform(("tracker", &sensor), pose, sample.arrived_at)?;
        }
        Ok(())
    }
}

/// Returns the decoder of a rig's FASTRAK.
pub(super) fn tracker_decoder(rig: &Value) -> Decoder {
    Decoder::new(Format {
        metres_per_unit: match rig["tracker"]["fastrak"]["units"].as_str() {
            Some("centimetres") => METRES_PER_CENTIMETRE,
            Some("millimetres") => 0.001,
            Some("metres") => 1.0,
            _ => METRES_PER_INCH,
        },
        ..Format::default()
    })
}

/// Returns the constant transforms: parent, child, and `parent_from_child`.
pub(super) fn fixed(rig: &Value) -> Vec<((&'static str, &'static str), RigidTransform)> {
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
        Some(((parent, child), rigid(&placement["matrix_row_major"])?))
    });
    stated.collect()
}

/// Returns the calibrations of the cameras.
pub(super) fn calibrations(rig: &Value, stamp: Timestamp) -> Vec<(Camera, CameraCalibration)> {
    let cameras = [
        (Camera::Scene, &rig["scene_camera"]),
        (Camera::Environment, &rig["environment_camera"]),
    ];
    let known = cameras.into_iter().filter_map(|(camera, calibration)| {
        let (k, model) = intrinsics(calibration)?;
        let size = size(calibration)?;
        Some((
            camera,
            messages::camera_calibration(camera, size, k, model, stamp),
        ))
    });
    known.collect()
}

fn size(camera: &Value) -> Option<(u32, u32)> {
    let side = |i: usize| u32::try_from(camera["image_size"][i].as_u64()?).ok();
    Some((side(0)?, side(1)?))
}

/// Returns K and the distortion model of a pinhole camera or a fisheye.
fn intrinsics(camera: &Value) -> Option<([f64; 9], &'static str)> {
    let projection = &camera["projection"];
    if let (Some(f), Some(cx), Some(cy)) = (
        projection["f"].as_f64(),
        projection["cx"].as_f64(),
        projection["cy"].as_f64(),
    ) {
        return Some(([f, 0.0, cx, 0.0, f, cy, 0.0, 0.0, 1.0], "kannala_brandt"));
    }
    let mut k = [0.0; 9];
    for (i, value) in k.iter_mut().enumerate() {
        *value = camera["K"][i / 3][i % 3].as_f64()?;
    }
    Some((k, "plumb_bob"))
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
        let mut views = RigViews::new(rig);
        let mut writer = SessionWriter::new(Cursor::new(Vec::new()), Path::new("a.mcap")).unwrap();
        views.begin(&mut writer, at(1_000)).unwrap();
        let record = b"01   10.00  20.00  30.00   0.00   0.00   0.00\r\n";
        // In portions, and a rest that states no pose.
        let stream = [&record[..], record, record, &record[..9]].concat();
        for (i, portion) in stream.chunks(20).enumerate() {
            let arrived_at = at(2_000 + i as i64);
            views
                .tracker_bytes(&mut writer, portion, arrived_at)
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
        let views = RigViews::new(json!({"scene_camera": {"image_size": ["a", 1]}, "tracker": 3}));
        views
            .begin(&mut writer, MonotonicTime::from_nanos(1))
            .unwrap();
        let bytes = writer.finish().unwrap().into_inner();
        assert_eq!(mcap::MessageStream::new(&bytes).unwrap().count(), 0);
    }
}
