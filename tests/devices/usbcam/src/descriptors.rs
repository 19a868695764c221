//! The USB descriptors of a camera.
//!
//! Sources: Universal Serial Bus 2.0, chapter 9.6; USB Device Class Definition for Video
//! Devices 1.0, chapter 3, and its payload documents "Uncompressed" and "Motion-JPEG".

use crate::stream::{FORMATS, Format, PAYLOAD};

/// The names of a camera. The serial number identifies a replugged camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Model.
    pub product: &'static str,
    /// Serial number.
    pub serial: &'static str,
    /// Whether it has a focus motor with an automatic mode.
    pub has_focus: bool,
}

/// The cameras of a rig. The environment camera's fisheye lens has a fixed focus.
pub const CAMERAS: [Identity; 2] = [
    Identity {
        product: "Scene Camera",
        serial: "SC0001",
        has_focus: true,
    },
    Identity {
        product: "Environment Camera",
        serial: "EC0001",
        has_focus: false,
    },
];

/// Device descriptor: 1209:0001, which pid.codes reserves for tests; strings 1, 2 and 3.
pub const DEVICE: [u8; 18] = [
    18, 1, 0x00, 0x02, 0xef, 2, 1, 64, 0x09, 0x12, 0x01, 0x00, 0x00, 0x01, 1, 2, 3, 1,
];

/// String descriptor `index`.
#[must_use]
pub fn string(identity: Identity, index: u8) -> Vec<u8> {
    let text = match index {
        0 => return vec![4, 3, 0x09, 0x04], // the languages: English
        1 => "Penumbra",
        2 => identity.product,
        _ => identity.serial,
    };
    let mut descriptor = vec![0, 3];
    descriptor.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
    descriptor[0] = descriptor.len() as u8;
    descriptor
}

/// Configuration descriptor: a control interface, and a streaming interface with bulk transfer.
#[must_use]
pub fn configuration(identity: Identity) -> Vec<u8> {
    let control = control_interface(identity);
    let streaming = streaming_interface();
    let mut descriptor = vec![9, 2, 0, 0, 2, 1, 0, 0x80, 250];
    descriptor.extend([8, 0x0b, 0, 2, 0x0e, 3, 0, 2]); // both interfaces are one function
    descriptor.extend([9, 4, 0, 0, 0, 0x0e, 1, 0, 2]);
    descriptor.extend(control);
    descriptor.extend([9, 4, 1, 0, 1, 0x0e, 2, 0, 0]);
    descriptor.extend(streaming);
    descriptor.extend([7, 5, 0x81, 2, 0x00, 0x02, 0]);
    put_length(&mut descriptor, 2);
    descriptor
}

/// Camera terminal 1, processing unit 2 and the output towards the computer, 3.
fn control_interface(identity: Identity) -> Vec<u8> {
    // Automatic exposure mode and priority, exposure time; focus and its automatic mode.
    let [focus, focus_auto] = if identity.has_focus {
        [0x20, 0x02]
    } else {
        [0, 0]
    };
    let mut interface = vec![13, 0x24, 1, 0x00, 0x01, 0, 0, 0x00, 0x6c, 0xdc, 0x02, 1, 1];
    interface.extend([18, 0x24, 2, 1, 0x01, 0x02, 0, 0, 0, 0, 0, 0, 0, 0, 3]);
    interface.extend([0x0e | focus, 0, focus_auto]);
    // Brightness, contrast, sharpness, temperature; gain, power line, automatic white balance.
    interface.extend([11, 0x24, 5, 2, 1, 0, 0, 2, 0x53, 0x16, 0]);
    interface.extend([9, 0x24, 3, 3, 0x01, 0x01, 0, 2, 0]);
    put_length(&mut interface, 5);
    interface
}

fn streaming_interface() -> Vec<u8> {
    let count = FORMATS.len() as u8;
    let mut interface = vec![13 + count, 0x24, 1, count, 0, 0, 0x81, 0, 3, 0, 0, 0, 1];
    interface.extend(vec![0; FORMATS.len()]);
    for (index, (format, sizes)) in FORMATS.iter().enumerate() {
        interface.extend(format_descriptor(
            *format,
            index as u8 + 1,
            sizes.len() as u8,
        ));
        for (size, (width, height)) in sizes.iter().enumerate() {
            interface.extend(frame_descriptor(*format, size as u8 + 1, *width, *height));
        }
        interface.extend([6, 0x24, 0x0d, 1, 1, 4]); // primaries and tone curve of sRGB
    }
    put_length(&mut interface, 4);
    interface
}

fn format_descriptor(format: Format, index: u8, sizes: u8) -> Vec<u8> {
    match format {
        Format::Yuyv => {
            let mut descriptor = vec![27, 0x24, 4, index, sizes];
            descriptor.extend(*b"YUY2\0\0\x10\0\x80\0\0\xaa\0\x38\x9b\x71");
            descriptor.extend([16, 1, 0, 0, 0, 0]);
            descriptor
        }
        Format::Mjpeg => vec![11, 0x24, 6, index, sizes, 1, 1, 0, 0, 0, 0],
    }
}

fn frame_descriptor(format: Format, index: u8, width: u16, height: u16) -> Vec<u8> {
    let subtype = match format {
        Format::Yuyv => 5,
        Format::Mjpeg => 7,
    };
    let bytes = u32::from(width) * u32::from(height) * 2;
    let intervals = crate::stream::INTERVALS;
    let length = 26 + 4 * intervals.len() as u8;
    let mut descriptor = vec![length, 0x24, subtype, index, 0];
    descriptor.extend(width.to_le_bytes());
    descriptor.extend(height.to_le_bytes());
    for value in [bytes * 8 * 5, bytes * 8 * 30, bytes, intervals[0]] {
        descriptor.extend(value.to_le_bytes());
    }
    descriptor.push(intervals.len() as u8);
    descriptor.extend(intervals.iter().flat_map(|interval| interval.to_le_bytes()));
    descriptor
}

fn put_length(descriptor: &mut [u8], at: usize) {
    let length = descriptor.len() as u16;
    descriptor[at..at + 2].copy_from_slice(&length.to_le_bytes());
}

const _: () = assert!(
    PAYLOAD.is_multiple_of(512),
    "a multiple of the packet size of a high-speed bulk endpoint"
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configuration_is_a_chain_of_descriptors() {
        for identity in CAMERAS {
            let descriptor = configuration(identity);
            let mut rest = descriptor.as_slice();
            while !rest.is_empty() {
                assert!(
                    rest[0] >= 2 && usize::from(rest[0]) <= rest.len(),
                    "{rest:?}"
                );
                rest = &rest[usize::from(rest[0])..];
            }
            assert_eq!(
                usize::from(u16::from_le_bytes([descriptor[2], descriptor[3]])),
                descriptor.len()
            );
        }
    }
}
