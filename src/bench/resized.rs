//! A recording whose scene camera has another resolution.

use super::BenchError;
use super::camera_session::{TemporaryFile, compress};
use image::imageops::{FilterType, crop_imm, resize};
use penumbra_interface::{Frame, PixelFormat};
use penumbra_picture::{Picture, YuvEncoding};
use penumbra_session::{Session, SessionEvent, SessionWriter};
use serde_json::Value;
use std::path::Path;

/// Attachment with the calibration.
const RIG: &str = "rig.json";

/// Copies `session` with pictures of the scene camera enlarged or reduced to `size`; what does not
/// fit its aspect ratio is cut off on both sides. The calibration is adapted.
pub(super) fn resized(session: &Path, size: (u32, u32)) -> Result<TemporaryFile, BenchError> {
    let original = Session::open(session)?;
    let file = TemporaryFile::session("live");
    let mut writer = SessionWriter::create(file.path())?;
    let mut fit = None;
    for attachment in original.attachments() {
        if attachment.name == RIG {
            let mut rig: Value = serde_json::from_slice(&attachment.data)?;
            fit = Fit::adapt(&mut rig["scene_camera"], size);
            writer.attach(RIG, rig.to_string().as_bytes())?;
        } else {
            writer.attach(&attachment.name, &attachment.data)?;
        }
    }
    let fit = fit.ok_or(BenchError::NoCalibration)?;
    for event in original.events() {
        match event? {
            SessionEvent::Scene(frame) => {
                writer.event(&SessionEvent::Scene(fit.frame(frame)?))?;
            }
            event => writer.event(&event)?,
        }
    }
    writer.finish()?;
    Ok(file)
}

/// How pictures fit into another size.
struct Fit {
    size: (u32, u32),
    /// Their size before what does not fit is cut off.
    whole: (u32, u32),
}

impl Fit {
    /// Changes the calibration of a scene camera; `None` if it has none.
    fn adapt(camera: &mut Value, size: (u32, u32)) -> Option<Self> {
        let side = |value: &Value| value.as_f64().filter(|v| *v > 0.0);
        let (width, height) = (
            side(&camera["image_size"][0])?,
            side(&camera["image_size"][1])?,
        );
        let scale = (f64::from(size.0) / width).max(f64::from(size.1) / height);
        let whole = [width, height].map(|v| (v * scale).round() as u32);
        let fit = Self {
            size,
            whole: (whole[0], whole[1]),
        };
        let (left, top) = fit.margin();
        for (row, cut) in [(0, left), (1, top)] {
            let k = &mut camera["K"][row];
            k[row] = (k[row].as_f64()? * scale).into();
            // Pixels have their centres at integers.
            let centre = (k[2].as_f64()? + 0.5) * scale - 0.5 - f64::from(cut);
            k[2] = centre.into();
        }
        camera["image_size"] = serde_json::json!([size.0, size.1]);
        Some(fit)
    }

    /// Pixels cut off on the left and at the top.
    const fn margin(&self) -> (u32, u32) {
        (
            (self.whole.0 - self.size.0) / 2,
            (self.whole.1 - self.size.1) / 2,
        )
    }

    fn frame(&self, frame: Frame) -> Result<Frame, BenchError> {
        let picture = Picture::decode(&frame, &YuvEncoding::default())?;
        let codes = image::RgbImage::from_fn(picture.width, picture.height, |x, y| {
            image::Rgb(picture.rgb(x, y))
        });
        let whole = resize(&codes, self.whole.0, self.whole.1, FilterType::Triangle);
        let (left, top) = self.margin();
        let part = crop_imm(&whole, left, top, self.size.0, self.size.1).to_image();
        Ok(Frame {
            data: compress(part.as_raw(), self.size)?.into(),
            format: PixelFormat::Jpeg,
            width: 0,
            height: 0,
            stride: 0,
            ..frame
        })
    }
}
