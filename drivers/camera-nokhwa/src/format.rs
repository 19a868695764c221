//! Converts formats and sizes between nokhwa's types and Penumbra's.

use bytes::Bytes;
use nokhwa::utils::{CameraFormat, FrameFormat, RequestedFormat, RequestedFormatType, Resolution};
use penumbra_interface::{CameraSettings, PixelFormat, StreamMode};

/// The formats that Penumbra reads, best for measuring light first.
const READABLE: [FrameFormat; 5] = [
    FrameFormat::YUYV,
    FrameFormat::NV12,
    FrameFormat::RAWRGB,
    FrameFormat::MJPEG,
    FrameFormat::GRAY,
];

pub(crate) const fn pixel_format(format: FrameFormat) -> Option<PixelFormat> {
    match format {
        FrameFormat::MJPEG => Some(PixelFormat::Jpeg),
        FrameFormat::YUYV => Some(PixelFormat::Yuyv),
        FrameFormat::NV12 => Some(PixelFormat::Nv12),
        FrameFormat::GRAY => Some(PixelFormat::Grey8),
        FrameFormat::RAWRGB => Some(PixelFormat::Rgb8),
        FrameFormat::RAWBGR => None,
    }
}

/// The format to request from nokhwa.
pub(crate) fn requested(settings: &CameraSettings) -> RequestedFormat<'static> {
    let wanted = |format: &&FrameFormat| {
        let format = pixel_format(**format);
        settings.formats.is_empty() || format.is_some_and(|f| settings.formats.contains(&f))
    };
    let formats: Vec<FrameFormat> = READABLE.iter().filter(wanted).copied().collect();
    let first = formats.first().copied().unwrap_or(FrameFormat::MJPEG);
    let rate = settings
        .frames_per_second
        .unwrap_or(30.0)
        .clamp(1.0, 1000.0)
        .round() as u32;
    let kind = match (settings.width, settings.height) {
        (0, _) | (_, 0) => RequestedFormatType::HighestFrameRate(rate),
        (width, height) => {
            let size = Resolution::new(width, height);
            RequestedFormatType::Closest(CameraFormat::new(size, first, rate))
        }
    };
    // The type requires a static list.
    RequestedFormat::with_formats(kind, listed(&formats))
}

/// Returns a static list: a single format, or all of them.
fn listed(formats: &[FrameFormat]) -> &'static [FrameFormat] {
    let single = READABLE.iter().position(|format| formats == [*format]);
    single.map_or(&READABLE, |place| &READABLE[place..=place])
}

/// The mode of the stream; `None` if Penumbra cannot read its format.
pub(crate) fn mode(format: CameraFormat) -> Option<StreamMode> {
    Some(StreamMode {
        width: format.width(),
        height: format.height(),
        format: pixel_format(format.format())?,
        frames_per_second: Some(f64::from(format.frame_rate())),
    })
}

/// The bytes of the picture without padding: nokhwa returns the complete buffer.
pub(crate) fn cut(data: &Bytes, mode: &StreamMode) -> Bytes {
    let pixels = mode.width as usize * mode.height as usize;
    let len = match mode.format {
        PixelFormat::Yuyv => pixels * 2,
        PixelFormat::Nv12 => pixels + pixels / 2,
        PixelFormat::Rgb8 => pixels * 3,
        PixelFormat::Grey8 | PixelFormat::Bayer8(_) => pixels,
        PixelFormat::Jpeg | PixelFormat::Png => {
            data.len() - data.iter().rev().take_while(|&&byte| byte == 0).count()
        }
    };
    data.slice(..len.min(data.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mode_of(format: PixelFormat) -> StreamMode {
        StreamMode {
            width: 4,
            height: 2,
            format,
            frames_per_second: None,
        }
    }

    #[test]
    fn padding_is_removed() {
        let data = Bytes::from([vec![7; 20], vec![0; 30]].concat());
        for (format, len) in [
            (PixelFormat::Yuyv, 16),
            (PixelFormat::Nv12, 12),
            (PixelFormat::Rgb8, 24),
            (PixelFormat::Grey8, 8),
            (PixelFormat::Jpeg, 20),
        ] {
            assert_eq!(cut(&data, &mode_of(format)).len(), len, "{format:?}");
        }
        let short = Bytes::from_static(b"xy");
        assert_eq!(cut(&short, &mode_of(PixelFormat::Yuyv)).len(), 2);
    }

    #[test]
    fn single_format_is_requested_alone() {
        assert_eq!(listed(&[FrameFormat::MJPEG]), &[FrameFormat::MJPEG]);
        assert_eq!(listed(&READABLE), &READABLE);
    }
}
