//! Structures of `linux/videodev2.h` on 64-bit machines, field by field.
//!
//! Unions are spelled as the members that are used, padded to the union's size; the sizes
//! are compared with those that the C compiler gives below. Source: the kernel's
//! `include/uapi/linux/videodev2.h`; names are its names without the prefix.

use bytemuck::Zeroable;

pub const BUF_TYPE_VIDEO_CAPTURE: u32 = 1;
pub const MEMORY_MMAP: u32 = 1;
pub const FIELD_NONE: u32 = 1;

pub const CAP_VIDEO_CAPTURE: u32 = 0x1;
pub const CAP_VIDEO_CAPTURE_MPLANE: u32 = 0x1000;
pub const CAP_STREAMING: u32 = 0x0400_0000;
pub const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
pub const CAP_TIMEPERFRAME: u32 = 0x1000;

pub const SIZE_DISCRETE: u32 = 1;
pub const EVENT_CTRL: u32 = 3;
pub const EVENT_CTRL_CH_VALUE: u32 = 1;
pub const CTRL_FLAG_NEXT_CTRL: u32 = 0x8000_0000;

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct Capability {
    pub driver: [u8; 16],
    pub card: [u8; 32],
    pub bus_info: [u8; 32],
    pub version: u32,
    pub capabilities: u32,
    pub device_caps: u32,
    pub reserved: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct FmtDesc {
    pub index: u32,
    pub kind: u32,
    pub flags: u32,
    pub description: [u8; 32],
    pub pixelformat: u32,
    pub mbus_code: u32,
    pub reserved: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct FrmSizeEnum {
    pub index: u32,
    pub pixel_format: u32,
    pub kind: u32,
    /// Discrete: width, height. Stepwise: min, max, step of the width, then of the height.
    pub size: [u32; 6],
    pub reserved: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct FrmIvalEnum {
    pub index: u32,
    pub pixel_format: u32,
    pub width: u32,
    pub height: u32,
    pub kind: u32,
    /// Discrete: numerator, denominator, seconds. Stepwise: min, max, step, as fractions.
    pub interval: [u32; 6],
    pub reserved: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct PixFormat {
    pub width: u32,
    pub height: u32,
    pub pixelformat: u32,
    pub field: u32,
    pub bytesperline: u32,
    pub sizeimage: u32,
    pub colorspace: u32,
    pub private: u32,
    pub flags: u32,
    pub ycbcr_enc: u32,
    pub quantization: u32,
    pub xfer_func: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct Format {
    pub kind: u32,
    pub padding: u32,
    pub pix: PixFormat,
    pub rest: [u64; 19],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct StreamParm {
    pub kind: u32,
    pub capability: u32,
    pub capturemode: u32,
    pub numerator: u32,
    pub denominator: u32,
    pub extendedmode: u32,
    pub readbuffers: u32,
    pub rest: [[u32; 22]; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct RequestBuffers {
    pub count: u32,
    pub kind: u32,
    pub memory: u32,
    pub capabilities: u32,
    pub flags: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct Buffer {
    pub index: u32,
    pub kind: u32,
    pub bytesused: u32,
    pub flags: u32,
    pub field: u32,
    pub padding: u32,
    pub seconds: i64,
    pub micros: i64,
    pub timecode: [u32; 4],
    pub sequence: u32,
    pub memory: u32,
    /// The offset to map is the first of them, whatever the byte order.
    pub offset: [u32; 2],
    pub length: u32,
    pub reserved2: u32,
    pub request_fd: i32,
    pub padding2: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct Control {
    pub id: u32,
    pub value: i32,
}

#[repr(C, packed(4))]
#[derive(Clone, Copy, Zeroable)]
pub struct ExtControl {
    pub id: u32,
    pub size: u32,
    pub reserved: u32,
    pub value: i64,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct ExtControls {
    pub which: u32,
    pub count: u32,
    pub error_idx: u32,
    pub request_fd: i32,
    pub reserved: u32,
    pub padding: u32,
    pub controls: *mut ExtControl,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct QueryExtCtrl {
    pub id: u32,
    pub kind: u32,
    pub name: [u8; 32],
    pub minimum: i64,
    pub maximum: i64,
    pub step: u64,
    pub default_value: i64,
    pub flags: u32,
    pub elem_size: u32,
    pub elems: u32,
    pub nr_of_dims: u32,
    pub dims: [u32; 4],
    pub reserved: [u32; 32],
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct QueryMenu {
    pub id: u32,
    pub index: u32,
    /// A text, or for integer menus a 64-bit number in the first eight bytes.
    pub name: [u8; 32],
    pub reserved: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct Event {
    pub kind: u32,
    pub padding: u32,
    /// Of `v4l2_event_ctrl`.
    pub changes: u32,
    pub control_kind: u32,
    pub value: i64,
    pub flags: u32,
    pub rest: [u32; 11],
    pub pending: u32,
    pub sequence: u32,
    pub timestamp: [i64; 2],
    pub id: u32,
    pub reserved: [u32; 8],
    pub padding2: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Zeroable)]
pub struct EventSubscription {
    pub kind: u32,
    pub id: u32,
    pub flags: u32,
    pub reserved: [u32; 5],
}

// What gcc gives on x86_64 and aarch64; a wrong one would let the kernel write past the end.
const _: () = {
    assert!(size_of::<Capability>() == 104);
    assert!(size_of::<FmtDesc>() == 64);
    assert!(size_of::<FrmSizeEnum>() == 44);
    assert!(size_of::<FrmIvalEnum>() == 52);
    assert!(size_of::<Format>() == 208);
    assert!(size_of::<StreamParm>() == 204);
    assert!(size_of::<RequestBuffers>() == 20);
    assert!(size_of::<Buffer>() == 88);
    assert!(std::mem::offset_of!(Buffer, sequence) == 56);
    assert!(std::mem::offset_of!(Buffer, offset) == 64);
    assert!(size_of::<Control>() == 8);
    assert!(size_of::<ExtControl>() == 20);
    assert!(size_of::<ExtControls>() == 32);
    assert!(size_of::<QueryExtCtrl>() == 232);
    assert!(size_of::<QueryMenu>() == 44);
    assert!(size_of::<Event>() == 136);
    assert!(std::mem::offset_of!(Event, id) == 96);
    assert!(size_of::<EventSubscription>() == 32);
};
