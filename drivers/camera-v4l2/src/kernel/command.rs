//! The commands, each bound to the structure that it reads and writes.

use super::abi::{
    Buffer, Capability, Control, Event, EventSubscription, ExtControls, FmtDesc, Format,
    FrmIvalEnum, FrmSizeEnum, QueryExtCtrl, QueryMenu, RequestBuffers, StreamParm,
};
use rustix::fd::AsFd;
use rustix::io::{Result, retry_on_intr};
use rustix::ioctl::{Ioctl, IoctlOutput, Opcode, ioctl, opcode};
use std::ffi::c_void;
use std::marker::PhantomData;

/// One command of the kernel's interface and the type of its argument.
pub struct Command<T> {
    opcode: Opcode,
    argument: PhantomData<T>,
}

impl<T> Command<T> {
    const fn read(number: u8) -> Self {
        Self::new(opcode::read::<T>(b'V', number))
    }

    const fn write(number: u8) -> Self {
        Self::new(opcode::write::<T>(b'V', number))
    }

    const fn read_write(number: u8) -> Self {
        Self::new(opcode::read_write::<T>(b'V', number))
    }

    const fn new(opcode: Opcode) -> Self {
        Self {
            opcode,
            argument: PhantomData,
        }
    }

    /// Gives the command to the driver behind `fd`, again where a signal came between.
    pub fn call(&self, fd: impl AsFd, value: &mut T) -> Result<()> {
        retry_on_intr(|| {
            let call = Call {
                opcode: self.opcode,
                value: &mut *value,
            };
            // SAFETY: `T` has the layout of the kernel's argument of this command (the sizes
            // are asserted in abi.rs, and the opcode carries them), it outlives the call,
            // and every bit pattern that the kernel may write is a valid `T`. The one
            // pointer in an argument, `ExtControls::controls`, is set by its caller to a
            // living `ExtControl` and `count` to 1.
            unsafe { ioctl(fd.as_fd(), call) }
        })
    }
}

struct Call<'a, T> {
    opcode: Opcode,
    value: &'a mut T,
}

// SAFETY: the pointer is to a living, exclusively borrowed `T` whose size is in the opcode.
unsafe impl<T> Ioctl for Call<'_, T> {
    type Output = ();
    const IS_MUTATING: bool = true;

    fn opcode(&self) -> Opcode {
        self.opcode
    }

    fn as_ptr(&mut self) -> *mut c_void {
        std::ptr::from_mut(self.value).cast()
    }

    unsafe fn output_from_ptr(_: IoctlOutput, _: *mut c_void) -> Result<()> {
        Ok(())
    }
}

pub const QUERYCAP: Command<Capability> = Command::read(0);
pub const ENUM_FMT: Command<FmtDesc> = Command::read_write(2);
pub const G_FMT: Command<Format> = Command::read_write(4);
pub const S_FMT: Command<Format> = Command::read_write(5);
pub const REQBUFS: Command<RequestBuffers> = Command::read_write(8);
pub const QUERYBUF: Command<Buffer> = Command::read_write(9);
pub const QBUF: Command<Buffer> = Command::read_write(15);
pub const DQBUF: Command<Buffer> = Command::read_write(17);
pub const STREAMON: Command<i32> = Command::write(18);
pub const STREAMOFF: Command<i32> = Command::write(19);
pub const G_PARM: Command<StreamParm> = Command::read_write(21);
pub const S_PARM: Command<StreamParm> = Command::read_write(22);
pub const G_CTRL: Command<Control> = Command::read_write(27);
pub const S_CTRL: Command<Control> = Command::read_write(28);
pub const QUERYMENU: Command<QueryMenu> = Command::read_write(37);
pub const G_EXT_CTRLS: Command<ExtControls> = Command::read_write(71);
pub const S_EXT_CTRLS: Command<ExtControls> = Command::read_write(72);
pub const ENUM_FRAMESIZES: Command<FrmSizeEnum> = Command::read_write(74);
pub const ENUM_FRAMEINTERVALS: Command<FrmIvalEnum> = Command::read_write(75);
pub const DQEVENT: Command<Event> = Command::read(89);
pub const SUBSCRIBE_EVENT: Command<EventSubscription> = Command::write(90);
pub const QUERY_EXT_CTRL: Command<QueryExtCtrl> = Command::read_write(103);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opcodes_are_those_of_the_c_header() {
        assert_eq!(DQBUF.opcode, 0xc058_5611);
        assert_eq!(DQEVENT.opcode, 0x8088_5659);
        assert_eq!(SUBSCRIBE_EVENT.opcode, 0x4020_565a);
    }
}
