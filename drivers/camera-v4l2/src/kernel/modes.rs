//! What an open device can stream.

use super::abi::{
    BUF_TYPE_VIDEO_CAPTURE, CAP_DEVICE_CAPS, CAP_STREAMING, CAP_TIMEPERFRAME, CAP_VIDEO_CAPTURE,
    CAP_VIDEO_CAPTURE_MPLANE, Capability, FIELD_NONE, FmtDesc, Format, FrmIvalEnum, FrmSizeEnum,
    PixFormat, SIZE_DISCRETE, StreamParm,
};
use super::{Node, command, text};
use crate::fourcc;
use crate::video::{Capabilities, Geometry, Modes};
use bytemuck::Zeroable;
use penumbra_interface::{CameraFormat, CameraSize, SizeSteps};
use rustix::io::{Errno, Result};

/// Longer lists than any camera has: a driver that does not end its list is cut here.
const MAX_LISTED: u32 = 256;

impl Modes for Node {
    fn capabilities(&self) -> Result<Capabilities> {
        let mut capability = Capability::zeroed();
        command::QUERYCAP.call(&self.fd, &mut capability)?;
        // `capabilities` are those of all nodes of the device; `device_caps` of this one.
        let own = if capability.capabilities & CAP_DEVICE_CAPS == 0 {
            capability.capabilities
        } else {
            capability.device_caps
        };
        Ok(Capabilities {
            driver: text(&capability.driver),
            card: text(&capability.card),
            bus: text(&capability.bus_info),
            captures: own & CAP_VIDEO_CAPTURE != 0,
            multiplanar: own & CAP_VIDEO_CAPTURE_MPLANE != 0,
            streams: own & CAP_STREAMING != 0,
        })
    }

    fn formats(&self) -> Vec<CameraFormat> {
        let described = (0..MAX_LISTED).map_while(|index| {
            let mut format = FmtDesc {
                index,
                kind: BUF_TYPE_VIDEO_CAPTURE,
                ..FmtDesc::zeroed()
            };
            command::ENUM_FMT.call(&self.fd, &mut format).ok()?;
            Some(format)
        });
        described
            .map(|format| {
                let letters = format.pixelformat.to_le_bytes();
                CameraFormat {
                    fourcc: fourcc::text(letters),
                    description: text(&format.description),
                    usable: fourcc::pixel_format(letters).is_some(),
                    sizes: self.sizes(format.pixelformat),
                }
            })
            .collect()
    }

    fn geometry(&self) -> Result<Geometry> {
        let mut format = asked(PixFormat::zeroed());
        command::G_FMT.call(&self.fd, &mut format)?;
        Ok(geometry(&format.pix, self.rate().ok().flatten()))
    }

    fn set_geometry(&mut self, wanted: &Geometry) -> Result<Geometry> {
        let mut format = asked(PixFormat {
            width: wanted.width,
            height: wanted.height,
            pixelformat: u32::from_le_bytes(wanted.fourcc),
            field: FIELD_NONE,
            ..PixFormat::zeroed()
        });
        command::S_FMT.call(&self.fd, &mut format)?;
        if let Some(rate) = wanted.frames_per_second {
            // Many drivers have one rate only and refuse; what is in force is read below.
            match self.set_rate(rate) {
                Ok(()) | Err(Errno::INVAL | Errno::NOTTY) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(geometry(&format.pix, self.rate().ok().flatten()))
    }
}

impl Node {
    fn sizes(&self, pixel_format: u32) -> Vec<CameraSize> {
        let mut sizes = Vec::new();
        for index in 0..MAX_LISTED {
            let mut found = FrmSizeEnum {
                index,
                pixel_format,
                ..FrmSizeEnum::zeroed()
            };
            if command::ENUM_FRAMESIZES.call(&self.fd, &mut found).is_err() {
                break;
            }
            let [
                min_width,
                max_width,
                step_width,
                min_height,
                max_height,
                step_height,
            ] = found.size;
            if found.kind == SIZE_DISCRETE {
                sizes.push(self.size(pixel_format, min_width, max_width, None));
                continue;
            }
            let steps = SizeSteps {
                min_width,
                min_height,
                step_width,
                step_height,
            };
            sizes.push(self.size(pixel_format, max_width, max_height, Some(steps)));
            break;
        }
        sizes
    }

    fn size(&self, fourcc: u32, width: u32, height: u32, steps: Option<SizeSteps>) -> CameraSize {
        CameraSize {
            width,
            height,
            steps,
            frames_per_second: self.rates(fourcc, width, height),
        }
    }

    fn rates(&self, pixel_format: u32, width: u32, height: u32) -> Vec<f64> {
        let mut rates = Vec::new();
        for index in 0..MAX_LISTED {
            let mut found = FrmIvalEnum {
                index,
                pixel_format,
                width,
                height,
                ..FrmIvalEnum::zeroed()
            };
            let asked = command::ENUM_FRAMEINTERVALS.call(&self.fd, &mut found);
            if asked.is_err() {
                break;
            }
            let interval = &found.interval;
            rates.extend(per_second(interval[0], interval[1]));
            if found.kind != SIZE_DISCRETE {
                rates.extend(per_second(interval[2], interval[3]));
                break;
            }
        }
        rates.sort_by(|a, b| b.total_cmp(a));
        rates
    }

    fn rate(&self) -> Result<Option<f64>> {
        let mut parm = StreamParm {
            kind: BUF_TYPE_VIDEO_CAPTURE,
            ..StreamParm::zeroed()
        };
        command::G_PARM.call(&self.fd, &mut parm)?;
        Ok(per_second(parm.numerator, parm.denominator))
    }

    fn set_rate(&self, rate: f64) -> Result<()> {
        let mut parm = StreamParm {
            kind: BUF_TYPE_VIDEO_CAPTURE,
            ..StreamParm::zeroed()
        };
        command::G_PARM.call(&self.fd, &mut parm)?;
        if parm.capability & CAP_TIMEPERFRAME == 0 {
            return Err(Errno::NOTTY);
        }
        parm.numerator = 1000;
        parm.denominator = (rate.clamp(0.001, 1e6) * 1000.0).round() as u32;
        command::S_PARM.call(&self.fd, &mut parm)
    }
}

fn asked(pix: PixFormat) -> Format {
    Format {
        kind: BUF_TYPE_VIDEO_CAPTURE,
        pix,
        ..Format::zeroed()
    }
}

const fn geometry(pix: &PixFormat, frames_per_second: Option<f64>) -> Geometry {
    Geometry {
        width: pix.width,
        height: pix.height,
        fourcc: pix.pixelformat.to_le_bytes(),
        bytes_per_line: pix.bytesperline,
        frames_per_second,
    }
}

/// Frames a second from the seconds of one, a fraction.
fn per_second(numerator: u32, denominator: u32) -> Option<f64> {
    (numerator != 0 && denominator != 0).then(|| f64::from(denominator) / f64::from(numerator))
}
