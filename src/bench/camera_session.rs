//! A recording of one second of two simulated cameras, for replay.

use super::BenchError;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_session::{Camera, SessionWriter};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Frame rate of each camera, Hz.
pub(super) const RATE: u32 = 30;
/// JPEG quality of a typical webcam.
const QUALITY: i32 = 85;
/// Arrival of a picture after the middle of its exposure, nanoseconds.
const AGE: i64 = 20_000_000;
/// Delay of the environment camera's pictures after the scene camera's, nanoseconds.
const OFFSET: i64 = 11_000_000;

/// A file that is removed when dropped.
pub(super) struct TemporaryFile(PathBuf);

impl TemporaryFile {
    /// Names a session of the purpose `name`; nothing is created.
    pub fn session(name: &str) -> Self {
        let name = format!("penumbra-bench-{name}-{}.mcap", std::process::id());
        Self(std::env::temp_dir().join(name))
    }

    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        // The file is in the folder for temporary files, so a failure to remove it does no harm.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// A session that is removed when dropped.
pub(super) struct CameraSession {
    file: TemporaryFile,
    /// Mean length of a picture, bytes.
    pub picture_bytes: f64,
}

impl CameraSession {
    /// One second of [`RATE`] pictures of both cameras, all different, with the calibration
    /// of a rig whose environment camera has a fisheye lens.
    pub fn write((width, height): (u32, u32)) -> Result<Self, BenchError> {
        let mut session = Self {
            file: TemporaryFile::session("cameras"),
            picture_bytes: 0.0,
        };
        session.fill((width, height))?;
        Ok(session)
    }

    pub fn path(&self) -> &Path {
        self.file.path()
    }

    fn fill(&mut self, size: (u32, u32)) -> Result<(), BenchError> {
        let mut writer = SessionWriter::create(self.path())?;
        writer.attach("rig.json", rig(size).to_string().as_bytes())?;
        let mut bytes = 0;
        for i in 0..RATE {
            let at = i64::from(i) * 1_000_000_000 / i64::from(RATE);
            for (camera, offset) in [(Camera::Scene, 0), (Camera::Environment, OFFSET)] {
                let frame = frame(size, i, AGE + at + offset)?;
                bytes += frame.data.len();
                writer.frame(camera, &frame)?;
            }
        }
        writer.finish()?;
        self.picture_bytes = bytes as f64 / f64::from(2 * RATE);
        Ok(())
    }
}

fn frame(size: (u32, u32), number: u32, arrived_at: i64) -> Result<Frame, BenchError> {
    Ok(Frame {
        data: jpeg(size, number)?.into(),
        format: PixelFormat::Jpeg,
        width: size.0,
        height: size.1,
        stride: 0,
        sequence: u64::from(number),
        captured_at: MonotonicTime::from_nanos(arrived_at - AGE),
        arrived_at: MonotonicTime::from_nanos(arrived_at),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    })
}

/// A moving gradient with slight noise.
fn jpeg((width, height): (u32, u32), number: u32) -> Result<Vec<u8>, BenchError> {
    let mut noise = 12_345_u32.wrapping_add(number);
    let moved = number as f32 * 0.2;
    let pixels: Vec<u8> = (0..width * height)
        .flat_map(|i| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let shade = 120.0 + 60.0 * (x * 0.01 + moved).sin() + 40.0 * (y * 0.021).cos();
            let shade = shade + (noise >> 29) as f32;
            [shade as u8, (shade * 0.8) as u8, (shade * 0.6 + 20.0) as u8]
        })
        .collect();
    compress(&pixels, (width, height))
}

/// Compresses the RGB codes of a picture as a webcam does: chroma is subsampled 4:2:2.
pub(super) fn compress(pixels: &[u8], (width, height): (u32, u32)) -> Result<Vec<u8>, BenchError> {
    let image = turbojpeg::Image {
        pixels,
        width: width as usize,
        pitch: 3 * width as usize,
        height: height as usize,
        format: turbojpeg::PixelFormat::RGB,
    };
    let coded = turbojpeg::compress(image, QUALITY, turbojpeg::Subsamp::Sub2x1)?;
    Ok(coded.to_vec())
}

/// Both cameras at the transmitter; the fisheye looks up, its circle as high as its picture.
fn rig((width, height): (u32, u32)) -> serde_json::Value {
    let (cx, cy) = (f64::from(width - 1) / 2.0, f64::from(height - 1) / 2.0);
    let (focal, quarter) = (f64::from(width), std::f64::consts::FRAC_PI_2);
    let here = json!({"position": [0.0, 0.0, 0.0], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]});
    json!({
        "name": "bench",
        "scene_camera": {
            "image_size": [width, height],
            "K": [[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]],
        },
        "environment_camera": {
            "kind": "fisheye",
            "image_size": [width, height],
            "T_world_cam": here,
            "projection": {"f": cy / quarter, "cx": cx, "cy": cy, "max_theta_rad": quarter},
        },
        "tracker": {
            "T_world_source": here,
            "T_sensor_cam": here,
            "fastrak": {"units": "centimetres"},
        },
    })
}
