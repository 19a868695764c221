//! How bright a picture is, roughly and cheaply: to see an exposure change.

use crate::fourcc;
use crate::stream::Layout;
use penumbra_interface::PixelFormat;

/// One byte of so many is looked at, in rows and along them.
const EVERY: usize = 8;

/// Measures brightness; keeps its decoder and buffer.
#[derive(Default)]
pub(crate) struct Brightness {
    decoder: Option<turbojpeg::Decompressor>,
    grey: Vec<u8>,
}

impl Brightness {
    /// Mean code of a picture, log₂; `None` if it cannot be decoded. Not linear light: it
    /// is only compared with other pictures of the same camera.
    pub(crate) fn stops(&mut self, layout: &Layout, data: &[u8]) -> Option<f64> {
        let mean = match layout.format {
            PixelFormat::Jpeg => self.jpeg(data)?,
            _ => raw(layout, data)?,
        };
        Some((mean + 0.5).log2())
    }

    /// An eighth of the size is the mean of each block, so that no cosine is computed.
    fn jpeg(&mut self, data: &[u8]) -> Option<f64> {
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
        // A warning comes after the whole picture was decoded as well as possible.
        let _ = decoder.decompress(data, target);
        mean(self.grey.iter())
    }
}

/// Mean of the luma, or of all colours, of an uncompressed picture.
fn raw(layout: &Layout, data: &[u8]) -> Option<f64> {
    let (row, _) = fourcc::tight(layout.format, layout.width, layout.height)?;
    let stride = row.max(layout.stride) as usize;
    let luma = data.chunks(stride).take(layout.height as usize);
    let rows = luma
        .step_by(EVERY)
        .map(|line| &line[..line.len().min(row as usize)]);
    // YUYV: every second byte is luma. An odd step visits all colours of RGB and Bayer.
    let step = match layout.format {
        PixelFormat::Yuyv => EVERY,
        _ => EVERY + 1,
    };
    let mut bayer_phase = 0;
    mean(rows.flat_map(|line| {
        bayer_phase += 1;
        let skip = if layout.format == PixelFormat::Yuyv {
            0
        } else {
            bayer_phase % 2
        };
        line.iter().skip(skip).step_by(step)
    }))
}

fn mean<'a>(bytes: impl Iterator<Item = &'a u8>) -> Option<f64> {
    let (sum, count) = bytes.fold((0_u64, 0_u64), |(sum, count), byte| {
        (sum + u64::from(*byte), count + 1)
    });
    (count > 0).then(|| sum as f64 / count as f64)
}
