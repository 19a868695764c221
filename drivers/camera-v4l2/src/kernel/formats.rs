//! The capabilities and the formats of an open device.
//!
//! The frame rate is accessed by calls of the crate `v4l` 0.14. Its other calls have defects, so
//! raw commands are used instead, and the crate's conversions where they are safe:
//! - `query_caps` and `enum_formats` panic on texts that are not UTF-8. The kernel limits a
//!   product name to 31 bytes and may cut it in the middle of a character.
//! - `format` and `set_format` panic on colour spaces and transfer functions that the crate
//!   does not know. v4l2loopback passes on any value that its writer has set.
//! - `enum_formats`, `enum_framesizes` and `enum_frameintervals` read lists of any length.

use super::ioctl::{self, Argument, retrying};
use super::{BUFFER_TYPE, V4l2Device, text};
use crate::device::{Capabilities, CaptureFormat, Formats};
use crate::fourcc;
use penumbra_interface::{CameraFormat, CameraSize, SizeSteps};
use rustix::io::{Errno, Result};
use v4l::capability::Flags;
use v4l::frameinterval::{FrameInterval, FrameIntervalEnum};
use v4l::framesize::{FrameSize, FrameSizeEnum};
use v4l::video::Capture;
use v4l::{Fraction, parameters, v4l_sys as sys};

/// More entries than any list of a camera has: a driver's list may never end.
const MAX_LISTED: u32 = 256;

impl Formats for V4l2Device {
    fn capabilities(&self) -> Result<Capabilities> {
        let mut found = sys::v4l2_capability::zeroed();
        self.send(&ioctl::QUERYCAP, &mut found)?;
        // `capabilities` applies to all nodes of the device, `device_caps` to this one.
        let of_all_nodes = Flags::from(found.capabilities);
        let flags = if of_all_nodes.contains(Flags::DEVICE_CAPS) {
            Flags::from(found.device_caps)
        } else {
            of_all_nodes
        };
        Ok(Capabilities {
            driver: text(found.driver),
            card: text(found.card),
            bus: text(found.bus_info),
            captures: flags.contains(Flags::VIDEO_CAPTURE),
            multiplanar: flags.contains(Flags::VIDEO_CAPTURE_MPLANE),
            streams: flags.contains(Flags::STREAMING),
        })
    }

    fn formats(&self) -> Vec<CameraFormat> {
        let described = (0..MAX_LISTED).map_while(|index| self.format_at(index));
        described
            .map(|format| {
                let letters = format.pixelformat.to_le_bytes();
                CameraFormat {
                    fourcc: fourcc::to_text(letters),
                    description: text(format.description),
                    usable: fourcc::pixel_format(letters).is_some(),
                    sizes: self.sizes(format.pixelformat),
                }
            })
            .collect()
    }

    fn format(&self) -> Result<CaptureFormat> {
        let mut format = format_argument();
        self.send(&ioctl::G_FMT, &mut format)?;
        Ok(self.with_rate(&format))
    }

    fn set_format(&mut self, wanted: &CaptureFormat) -> Result<CaptureFormat> {
        let mut format = format_argument();
        format.fmt.pix.width = wanted.width;
        format.fmt.pix.height = wanted.height;
        format.fmt.pix.pixelformat = u32::from_le_bytes(wanted.fourcc);
        format.fmt.pix.field = sys::v4l2_field_V4L2_FIELD_NONE;
        self.send(&ioctl::S_FMT, &mut format)?;
        if let Some(rate) = wanted.frames_per_second {
            // Drivers with a single rate may refuse to set it. The rate is read back below.
            match self.set_rate(rate) {
                Ok(()) | Err(Errno::INVAL | Errno::NOTTY) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(self.with_rate(&format))
    }
}

impl V4l2Device {
    fn format_at(&self, index: u32) -> Option<sys::v4l2_fmtdesc> {
        let mut format = sys::v4l2_fmtdesc {
            index,
            type_: BUFFER_TYPE,
            ..sys::v4l2_fmtdesc::zeroed()
        };
        self.send(&ioctl::ENUM_FMT, &mut format).ok()?;
        Some(format)
    }

    fn sizes(&self, pixel_format: u32) -> Vec<CameraSize> {
        let size = |width, height, steps| CameraSize {
            width,
            height,
            steps,
            frames_per_second: self.rates(pixel_format, width, height),
        };
        let mut sizes = Vec::new();
        for found in (0..MAX_LISTED).map_while(|index| self.size_at(pixel_format, index)) {
            match found {
                FrameSizeEnum::Discrete(found) => {
                    sizes.push(size(found.width, found.height, None));
                }
                FrameSizeEnum::Stepwise(found) => {
                    let steps = SizeSteps {
                        min_width: found.min_width,
                        min_height: found.min_height,
                        step_width: found.step_width,
                        step_height: found.step_height,
                    };
                    sizes.push(size(found.max_width, found.max_height, Some(steps)));
                    break; // A range is the only entry of a list.
                }
            }
        }
        sizes
    }

    fn size_at(&self, pixel_format: u32, index: u32) -> Option<FrameSizeEnum> {
        let mut found = sys::v4l2_frmsizeenum {
            index,
            pixel_format,
            ..sys::v4l2_frmsizeenum::zeroed()
        };
        self.send(&ioctl::ENUM_FRAMESIZES, &mut found).ok()?;
        FrameSize::try_from(found).ok().map(|found| found.size)
    }

    /// Frames per second, fastest first; the two limits of a range of rates.
    fn rates(&self, pixel_format: u32, width: u32, height: u32) -> Vec<f64> {
        let mut rates = Vec::new();
        let mut interval = sys::v4l2_frmivalenum {
            pixel_format,
            width,
            height,
            ..sys::v4l2_frmivalenum::zeroed()
        };
        for found in (0..MAX_LISTED).map_while(|index| {
            interval.index = index;
            self.interval(interval)
        }) {
            match found {
                FrameIntervalEnum::Discrete(interval) => rates.extend(per_second(interval)),
                FrameIntervalEnum::Stepwise(found) => {
                    rates.extend([found.min, found.max].into_iter().filter_map(per_second));
                    break; // A range is the only entry of a list.
                }
            }
        }
        rates.sort_by(|a, b| b.total_cmp(a));
        rates
    }

    fn interval(&self, mut wanted: sys::v4l2_frmivalenum) -> Option<FrameIntervalEnum> {
        self.send(&ioctl::ENUM_FRAMEINTERVALS, &mut wanted).ok()?;
        let found = FrameInterval::try_from(wanted).ok()?;
        Some(found.interval)
    }

    /// A format that the driver has returned, with the present frame rate.
    fn with_rate(&self, format: &sys::v4l2_format) -> CaptureFormat {
        // SAFETY: every bit pattern is a valid value of this member. Drivers set it for this
        // type of buffers.
        let pix = unsafe { format.fmt.pix };
        let parameters = retrying(|| self.device.params()).ok();
        CaptureFormat {
            width: pix.width,
            height: pix.height,
            fourcc: pix.pixelformat.to_le_bytes(),
            bytes_per_line: pix.bytesperline,
            frames_per_second: parameters.and_then(|found| per_second(found.interval)),
        }
    }

    fn set_rate(&self, frames_per_second: f64) -> Result<()> {
        let mut parameters = retrying(|| self.device.params())?;
        let settable = parameters::Capabilities::TIME_PER_FRAME;
        if !parameters.capabilities.contains(settable) {
            return Err(Errno::NOTTY);
        }
        let thousandths = (frames_per_second.clamp(0.001, 1e6) * 1000.0).round() as u32;
        parameters.interval = Fraction::new(1000, thousandths);
        retrying(|| self.device.set_params(&parameters)).map(|_| ())
    }
}

/// The argument of the format commands.
fn format_argument() -> sys::v4l2_format {
    sys::v4l2_format {
        type_: BUFFER_TYPE,
        ..sys::v4l2_format::zeroed()
    }
}

/// Frames per second, from the seconds per frame.
fn per_second(interval: Fraction) -> Option<f64> {
    let Fraction {
        numerator,
        denominator,
    } = interval;
    (numerator != 0 && denominator != 0).then(|| f64::from(denominator) / f64::from(numerator))
}
