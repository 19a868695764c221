//! What an open device is and can stream.
//!
//! Frame rates go through the calls of the crate `v4l` 0.14, and sizes and frame intervals
//! through its conversions. Its other calls are not safe with every driver, so raw commands
//! stand in for them: `query_caps` and `enum_formats` panic on texts that are not UTF-8 (the
//! kernel cuts a long name in the middle of a character), `format` and `set_format` panic on
//! colour spaces that the crate does not know (v4l2loopback passes on whatever its writer
//! says), and the `enum_` calls read the driver's lists without a limit.

use super::ioctl::{self, Argument, retrying};
use super::{BUFFER_TYPE, Node, text};
use crate::fourcc;
use crate::video::{Capabilities, Geometry, Modes};
use penumbra_interface::{CameraFormat, CameraSize, SizeSteps};
use rustix::io::{Errno, Result};
use v4l::capability::Flags;
use v4l::frameinterval::{FrameInterval, FrameIntervalEnum};
use v4l::framesize::{FrameSize, FrameSizeEnum};
use v4l::video::Capture;
use v4l::{Fraction, parameters, v4l_sys as sys};

/// More entries than any list of a camera has. A list that never ends is cut off here.
const MAX_LISTED: u32 = 256;

impl Modes for Node {
    fn capabilities(&self) -> Result<Capabilities> {
        let mut found = sys::v4l2_capability::zeroed();
        self.send(&ioctl::QUERYCAP, &mut found)?;
        // `capabilities` are those of all nodes of the device, `device_caps` of this one.
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
                    fourcc: fourcc::text(letters),
                    description: text(format.description),
                    usable: fourcc::pixel_format(letters).is_some(),
                    sizes: self.sizes(format.pixelformat),
                }
            })
            .collect()
    }

    fn geometry(&self) -> Result<Geometry> {
        let mut format = capture_format();
        self.send(&ioctl::G_FMT, &mut format)?;
        Ok(self.with_rate(&format))
    }

    fn set_geometry(&mut self, wanted: &Geometry) -> Result<Geometry> {
        let mut format = capture_format();
        format.fmt.pix.width = wanted.width;
        format.fmt.pix.height = wanted.height;
        format.fmt.pix.pixelformat = u32::from_le_bytes(wanted.fourcc);
        format.fmt.pix.field = sys::v4l2_field_V4L2_FIELD_NONE;
        self.send(&ioctl::S_FMT, &mut format)?;
        if let Some(rate) = wanted.frames_per_second {
            // Many drivers have one rate only and refuse this. The rate is read back below.
            match self.set_rate(rate) {
                Ok(()) | Err(Errno::INVAL | Errno::NOTTY) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(self.with_rate(&format))
    }
}

impl Node {
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
                    break; // A range is the only entry of its list.
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

    /// Frames per second, fastest first; for a range of rates its two ends.
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
                    break; // A range is the only entry of its list.
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

    /// The format that the driver reported, with the frame rate that is set now.
    fn with_rate(&self, format: &sys::v4l2_format) -> Geometry {
        // SAFETY: the driver filled in this member for our buffer type; every bit pattern is a
        // valid value of it.
        let pix = unsafe { format.fmt.pix };
        let parameters = retrying(|| self.device.params()).ok();
        Geometry {
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

/// The argument of the format commands for the buffers that this driver streams.
fn capture_format() -> sys::v4l2_format {
    sys::v4l2_format {
        type_: BUFFER_TYPE,
        ..sys::v4l2_format::zeroed()
    }
}

/// Frames per second, from the seconds of one frame.
fn per_second(interval: Fraction) -> Option<f64> {
    let Fraction {
        numerator,
        denominator,
    } = interval;
    (numerator != 0 && denominator != 0).then(|| f64::from(denominator) / f64::from(numerator))
}
