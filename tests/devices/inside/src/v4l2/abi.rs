//! What goes over to the kernel, and the numbers of the requests.

use rustix::ioctl::{Opcode, opcode};

pub const CAPTURE: u32 = 1;
pub const MAPPED: u32 = 1;
pub const FLAG_ERROR: u32 = 0x40;
pub const FLAG_MONOTONIC: u32 = 0x2000;
pub const BUFFERS: u32 = 4;

#[repr(C)]
pub struct Format {
    pub kind: u32,
    pub _align: u32,
    pub width: u32,
    pub height: u32,
    pub pixel_format: u32,
    pub rest: [u32; 47],
}

#[repr(C)]
pub struct RequestBuffers {
    pub count: u32,
    pub kind: u32,
    pub memory: u32,
    pub rest: [u32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub struct Buffer {
    pub index: u32,
    pub kind: u32,
    pub used: u32,
    pub flags: u32,
    pub field: u32,
    pub seconds: i64,
    pub micros: i64,
    pub timecode: [u32; 4],
    pub sequence: u32,
    pub memory: u32,
    pub offset: u64,
    pub length: u32,
    pub _reserved: u32,
    pub _request: u32,
}

#[repr(C)]
pub struct Control {
    pub id: u32,
    pub value: i32,
}

#[repr(C)]
pub struct EventSubscription {
    pub kind: u32,
    pub id: u32,
    pub rest: [u32; 6],
}

#[repr(C, align(8))]
pub struct Event {
    pub kind: u32,
    pub rest: [u32; 33],
}

const _: () = assert!(size_of::<Format>() == 208 && size_of::<Buffer>() == 88);
const _: () = assert!(size_of::<RequestBuffers>() == 20 && size_of::<Event>() == 136);

const fn read_write<T>(number: u8) -> Opcode {
    opcode::read_write::<T>(b'V', number)
}
const fn write<T>(number: u8) -> Opcode {
    opcode::write::<T>(b'V', number)
}
pub const S_FMT: Opcode = read_write::<Format>(5);
pub const REQBUFS: Opcode = read_write::<RequestBuffers>(8);
pub const QUERYBUF: Opcode = read_write::<Buffer>(9);
pub const QBUF: Opcode = read_write::<Buffer>(15);
pub const DQBUF: Opcode = read_write::<Buffer>(17);
pub const STREAMON: Opcode = write::<u32>(18);
pub const STREAMOFF: Opcode = write::<u32>(19);
pub const G_CTRL: Opcode = read_write::<Control>(27);
pub const S_CTRL: Opcode = read_write::<Control>(28);
pub const DQEVENT: Opcode = opcode::read::<Event>(b'V', 89);
pub const SUBSCRIBE_EVENT: Opcode = write::<EventSubscription>(90);
pub const EVENT_CONTROL: u32 = 3;

/// A request about this mapped buffer.
pub fn mapped(index: u32) -> Buffer {
    Buffer {
        index,
        kind: CAPTURE,
        memory: MAPPED,
        ..Buffer::default()
    }
}
