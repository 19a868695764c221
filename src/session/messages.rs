//! Conversion between the messages of the streams and the types of the drivers.

use super::topics::Camera;
use bytes::Bytes;
use foxglove::messages::{
    CameraCalibration, CompressedImage, FrameTransform, Quaternion, RawImage, Timestamp, Vector3,
};
use foxglove::{Decode, Encode};
use glam::{DQuat, DVec3};
use penumbra_interface::{
    BayerPattern, Exposure, Frame, MonotonicTime, PixelFormat, PoseSample, RigidTransform,
};
use serde::{Deserialize, Serialize};

const NANOS_PER_SECOND: i64 = 1_000_000_000;

/// Converts MCAP's unsigned nanoseconds; saturates after 292 years.
pub(super) fn recorded_time(nanos: u64) -> MonotonicTime {
    MonotonicTime::from_nanos(i64::try_from(nanos).unwrap_or(i64::MAX))
}

/// Converts to Protobuf's time stamp; `None` before zero or after 136 years.
pub(super) fn timestamp(time: MonotonicTime) -> Option<Timestamp> {
    let nanos = time.as_nanos();
    let seconds = u32::try_from(nanos.div_euclid(NANOS_PER_SECOND)).ok()?;
    let rest = u32::try_from(nanos.rem_euclid(NANOS_PER_SECOND)).ok()?;
    Timestamp::new_checked(seconds, rest)
}

fn time(timestamp: Timestamp) -> MonotonicTime {
    let nanos = i64::from(timestamp.sec()) * NANOS_PER_SECOND + i64::from(timestamp.nsec());
    MonotonicTime::from_nanos(nanos)
}

/// Encodes a message of one of Foxglove's schemas.
pub(super) fn encode<M: Encode>(message: &M) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::with_capacity(message.encoded_len().unwrap_or_default());
    message.encode(&mut bytes).map_err(|e| e.to_string())?;
    Ok(bytes)
}

/// Data of a frame that are stored beside its image.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrameContext {
    pub sequence: u64,
    pub published_at: MonotonicTime,
    pub arrived_at: MonotonicTime,
    pub exposure: Option<Exposure>,
    pub bracket_ev: f64,
}

/// Returns whether a format is stored as `foxglove.RawImage`.
pub(super) const fn is_raw(format: PixelFormat) -> bool {
    !matches!(format, PixelFormat::Jpeg | PixelFormat::Png)
}

pub(super) fn compressed_image(camera: Camera, frame: &Frame, stamp: Timestamp) -> CompressedImage {
    CompressedImage {
        timestamp: Some(stamp),
        frame_id: camera.frame_id().to_owned(),
        data: frame.data.clone(),
        format: match frame.format {
            PixelFormat::Png => "png",
            _ => "jpeg",
        }
        .to_owned(),
    }
}

/// A composited picture; it shows what the scene camera sees.
pub(super) fn composite_image(jpeg: Bytes, stamp: Timestamp) -> CompressedImage {
    CompressedImage {
        timestamp: Some(stamp),
        frame_id: Camera::Scene.frame_id().to_owned(),
        data: jpeg,
        format: "jpeg".to_owned(),
    }
}

pub(super) fn raw_image(camera: Camera, frame: &Frame, stamp: Timestamp) -> RawImage {
    let (encoding, tight) = match frame.format {
        PixelFormat::Yuyv => ("yuyv", frame.width.saturating_mul(2)),
        PixelFormat::Nv12 => ("nv12", frame.width),
        PixelFormat::Rgb8 => ("rgb8", frame.width.saturating_mul(3)),
        PixelFormat::Bayer8(pattern) => (bayer_name(pattern), frame.width),
        PixelFormat::Grey8 | PixelFormat::Jpeg | PixelFormat::Png => ("mono8", frame.width),
    };
    RawImage {
        timestamp: Some(stamp),
        frame_id: camera.frame_id().to_owned(),
        width: frame.width,
        height: frame.height,
        encoding: encoding.to_owned(),
        step: if frame.stride == 0 {
            tight
        } else {
            frame.stride
        },
        data: frame.data.clone(),
    }
}

/// Name of a Bayer pattern in `foxglove.RawImage`.
const fn bayer_name(pattern: BayerPattern) -> &'static str {
    match pattern {
        BayerPattern::Rggb => "bayer_rggb8",
        BayerPattern::Bggr => "bayer_bggr8",
        BayerPattern::Grbg => "bayer_grbg8",
        BayerPattern::Gbrg => "bayer_gbrg8",
    }
}

fn bayer_pattern(encoding: &str) -> Option<BayerPattern> {
    let named = |pattern: &BayerPattern| bayer_name(*pattern) == encoding;
    BayerPattern::ALL.into_iter().find(named)
}

/// Decodes a `foxglove.CompressedImage` to a frame.
pub(super) fn frame_from_compressed(data: Bytes, context: FrameContext) -> Result<Frame, String> {
    let image = <CompressedImage as Decode>::decode(data).map_err(|e| e.to_string())?;
    let format = match image.format.as_str() {
        "jpeg" | "jpg" => PixelFormat::Jpeg,
        "png" => PixelFormat::Png,
        other => return Err(format!("image format {other:?} is not jpeg or png")),
    };
    Ok(frame(context, image.timestamp, format, image.data))
}

/// Decodes a `foxglove.RawImage` to a frame, if its sizes are consistent.
pub(super) fn frame_from_raw(data: Bytes, context: FrameContext) -> Result<Frame, String> {
    let image = <RawImage as Decode>::decode(data).map_err(|e| e.to_string())?;
    let (width, height, step) = (image.width, image.height, u64::from(image.step));
    let (format, tight, halves) = match image.encoding.as_str() {
        "yuyv" | "yuv422_yuy2" => (PixelFormat::Yuyv, 2 * u64::from(width), 2),
        "nv12" => (PixelFormat::Nv12, u64::from(width), 3),
        "rgb8" => (PixelFormat::Rgb8, 3 * u64::from(width), 2),
        "mono8" | "8UC1" => (PixelFormat::Grey8, u64::from(width), 2),
        other => match bayer_pattern(other) {
            Some(pattern) => (PixelFormat::Bayer8(pattern), u64::from(width), 2),
            None => return Err(format!("image encoding {other:?} is not supported")),
        },
    };
    let even = width % 2 == 0 && height % 2 == 0;
    let possible = match format {
        PixelFormat::Nv12 => even,
        PixelFormat::Yuyv => width % 2 == 0,
        _ => true,
    };
    // The last row may lack its padding.
    let rows = u64::from(height) * halves / 2;
    let needed = step
        .saturating_mul(rows.saturating_sub(1))
        .saturating_add(tight);
    let sized = (1..=1 << 16).contains(&width) && (1..=1 << 16).contains(&height);
    if !sized || !possible || step < tight || (image.data.len() as u64) < needed {
        let (len, encoding) = (image.data.len(), &image.encoding);
        return Err(format!(
            "{len} bytes do not fit a {width}x{height} {encoding} picture"
        ));
    }
    let stride = if step == tight { 0 } else { image.step };
    Ok(Frame {
        width,
        height,
        stride,
        ..frame(context, image.timestamp, format, image.data)
    })
}

fn frame(
    context: FrameContext,
    stamp: Option<Timestamp>,
    format: PixelFormat,
    data: Bytes,
) -> Frame {
    Frame {
        data,
        format,
        width: 0,
        height: 0,
        stride: 0,
        sequence: context.sequence,
        captured_at: stamp.map_or(context.published_at, time),
        arrived_at: context.arrived_at,
        exposure: context.exposure,
        bracket_ev: context.bracket_ev,
        controls: None,
    }
}

/// JSON of an `…/exposure` message: data for which `foxglove.CompressedImage` has no field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct ExposureMessage {
    pub sequence: u64,
    pub bracket_ev: f64,
    pub exposure_micros: Option<f64>,
    pub gain: Option<f64>,
}

/// JSON schema of [`ExposureMessage`].
pub(super) const EXPOSURE_SCHEMA: &[u8] = br#"{"title":"penumbra.Exposure","type":"object","properties":{"sequence":{"type":"integer","description":"the camera's frame counter"},"bracket_ev":{"type":"number","description":"stops relative to the base exposure"},"exposure_micros":{"type":["number","null"],"description":"shutter time, microseconds"},"gain":{"type":["number","null"],"description":"linear gain, 1 = none"}}}"#;

impl ExposureMessage {
    pub fn from_frame(frame: &Frame) -> Self {
        Self {
            sequence: frame.sequence,
            bracket_ev: frame.bracket_ev,
            exposure_micros: frame.exposure.map(|e| e.exposure_micros),
            gain: frame.exposure.map(|e| e.gain),
        }
    }

    pub fn exposure(&self) -> Option<Exposure> {
        Some(Exposure {
            exposure_micros: self.exposure_micros?,
            gain: self.gain?,
        })
    }
}

/// Converts `parent_from_child` to a `foxglove.FrameTransform`.
pub(super) fn frame_transform(
    parent: &str,
    child: &str,
    pose: RigidTransform,
    stamp: Timestamp,
) -> FrameTransform {
    let (t, q) = (pose.translation, pose.rotation);
    FrameTransform {
        timestamp: Some(stamp),
        parent_frame_id: parent.to_owned(),
        child_frame_id: child.to_owned(),
        translation: Some(Vector3 {
            x: t.x,
            y: t.y,
            z: t.z,
        }),
        rotation: Some(Quaternion {
            x: q.x,
            y: q.y,
            z: q.z,
            w: q.w,
        }),
    }
}

/// Name of a receiver's frame.
pub(super) fn sensor_frame(station: u8) -> String {
    format!("sensor_{station}")
}

/// Decodes the pose in a `foxglove.FrameTransform` whose child is `sensor_<station>`.
pub(super) fn pose_sample(data: Bytes, arrived_at: MonotonicTime) -> Result<PoseSample, String> {
    let transform = <FrameTransform as Decode>::decode(data).map_err(|e| e.to_string())?;
    let station = transform.child_frame_id.strip_prefix("sensor_");
    let station = station.and_then(|n| n.parse().ok()).unwrap_or(1);
    let t = transform.translation.ok_or("a pose without translation")?;
    let q = transform.rotation.ok_or("a pose without rotation")?;
    let translation = DVec3::new(t.x, t.y, t.z);
    let rotation = DQuat::from_xyzw(q.x, q.y, q.z, q.w);
    let is_unit = (rotation.length() - 1.0).abs() < 0.01;
    if translation.is_finite() && is_unit {
        Ok(PoseSample {
            station,
            transmitter_from_sensor: RigidTransform::new(rotation.normalize(), translation),
            arrived_at,
            error: None,
        })
    } else {
        Err("a pose that is not a rigid transform".to_owned())
    }
}

/// A camera's lens, for viewers. `distortion`: name of the model and its coefficients.
pub(super) fn camera_calibration(
    camera: Camera,
    (width, height): (u32, u32),
    k: [f64; 9],
    (model, distortion): (&str, Vec<f64>),
    stamp: Timestamp,
) -> CameraCalibration {
    let [fx, _, cx, _, fy, cy, ..] = k;
    CameraCalibration {
        timestamp: Some(stamp),
        frame_id: camera.frame_id().to_owned(),
        width,
        height,
        distortion_model: model.to_owned(),
        d: distortion,
        k: k.to_vec(),
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rejects_raw_pictures_with_inconsistent_sizes() {
        let context = FrameContext {
            sequence: 1,
            published_at: MonotonicTime::default(),
            arrived_at: MonotonicTime::default(),
            exposure: None,
            bracket_ev: 0.0,
        };
        let check = |width, height, step, encoding: &str, len| {
            let image = RawImage {
                width,
                height,
                step,
                encoding: encoding.to_owned(),
                data: vec![0; len].into(),
                ..RawImage::default()
            };
            frame_from_raw(encode(&image).unwrap().into(), context).is_ok()
        };
        assert!(check(4, 2, 12, "rgb8", 24));
        assert!(
            check(4, 2, 16, "rgb8", 28),
            "the last row's padding may be missing"
        );
        assert!(!check(4, 2, 12, "rgb8", 23));
        assert!(!check(4, 2, 11, "rgb8", 24));
        assert!(check(4, 2, 4, "nv12", 12) && !check(4, 2, 4, "nv12", 11));
        assert!(!check(3, 2, 6, "yuyv", 12), "4:2:2 needs pairs of pixels");
        assert!(!check(u32::MAX, u32::MAX, u32::MAX, "mono8", 10));
        assert!(!check(0, 2, 0, "mono8", 0));
        assert!(!check(4, 2, 12, "bgr8", 24));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(data in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = pose_sample(data.into(), MonotonicTime::default());
        }

        #[test]
        fn time_stamps_round_trip(nanos in 0..i64::from(u32::MAX) * NANOS_PER_SECOND) {
            let at = MonotonicTime::from_nanos(nanos);
            prop_assert_eq!(time(timestamp(at).unwrap()), at);
        }
    }
}
