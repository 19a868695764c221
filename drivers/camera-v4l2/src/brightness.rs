//! The approximate brightness of a frame, to see when a new exposure time takes effect.

use crate::fourcc;
use crate::stream::FrameLayout;
use penumbra_interface::PixelFormat;

/// Of uncompressed frames, one row and one byte in this many are read.
const SAMPLE_STEP: usize = 8;

/// Measures brightness. Keeps its JPEG decoder and buffer from frame to frame.
#[derive(Default)]
pub(crate) struct BrightnessMeter {
    decoder: Option<turbojpeg::Decompressor>,
    grey: Vec<u8>,
}

impl BrightnessMeter {
    /// The base-2 logarithm of a frame's mean code value; `None` if it cannot be decoded.
    ///
    /// This is not linear light. It is only good for comparing frames of one camera.
    pub(crate) fn measure(&mut self, layout: &FrameLayout, data: &[u8]) -> Option<f64> {
        let mean = match layout.format {
            PixelFormat::Jpeg => self.mean_of_jpeg(data)?,
            _ => mean_of_raw(layout, data)?,
        };
        // Half a code value keeps black finite.
        Some((mean + 0.5).log2())
    }

    /// Decodes at an eighth of the size: every block becomes its mean, without an inverse DCT.
    fn mean_of_jpeg(&mut self, data: &[u8]) -> Option<f64> {
        if self.decoder.is_none() {
            self.decoder = turbojpeg::Decompressor::new().ok();
        }
        let decoder = self.decoder.as_mut()?;
        let eighth = turbojpeg::ScalingFactor::ONE_EIGHTH;
        decoder.set_scaling_factor(eighth).ok()?;
        let header = decoder.read_header(data).ok()?.scaled(eighth);
        self.grey
            .resize(header.width.checked_mul(header.height)?, 0);
        let target = turbojpeg::Image {
            pixels: self.grey.as_mut_slice(),
            width: header.width,
            pitch: header.width,
            height: header.height,
            format: turbojpeg::PixelFormat::GRAY,
        };
        // libjpeg-turbo warns only after it has decoded what it could.
        let _ = decoder.decompress(data, target);
        mean(self.grey.iter())
    }
}

/// The mean of the luma, or of all colours, of an uncompressed frame.
fn mean_of_raw(layout: &FrameLayout, data: &[u8]) -> Option<f64> {
    let (row, _) = fourcc::packed_rows(layout.format, layout.width, layout.height)?;
    // A width of 0 is the driver's fault and must not become a panic.
    let stride = row.max(layout.stride).max(1) as usize;
    // Rows of chroma planes follow those of the picture and are left out.
    let rows = data.chunks(stride).take(layout.height as usize);
    let rows = rows
        .step_by(SAMPLE_STEP)
        .map(|line| &line[..line.len().min(row as usize)]);
    // Every second byte of YUYV is luma. With an odd step and alternating starts, all colours
    // of RGB and Bayer formats are sampled.
    let is_yuyv = layout.format == PixelFormat::Yuyv;
    let step = if is_yuyv {
        SAMPLE_STEP
    } else {
        SAMPLE_STEP + 1
    };
    mean(rows.enumerate().flat_map(|(n, line)| {
        let skip = if is_yuyv { 0 } else { (n + 1) % 2 };
        line.iter().skip(skip).step_by(step)
    }))
}

fn mean<'a>(bytes: impl Iterator<Item = &'a u8>) -> Option<f64> {
    let (sum, count) = bytes.fold((0_u64, 0_u64), |(sum, count), byte| {
        (sum + u64::from(*byte), count + 1)
    });
    (count > 0).then(|| sum as f64 / count as f64)
}
