//! The ioctl commands that this driver uses, each bound to the C structure of its argument.
//!
//! Structures and constants come from the kernel's header `linux/videodev2.h`, which bindgen
//! translates when the crate `v4l` is built (`v4l::v4l_sys`). Command numbers come from
//! `v4l::v4l2::vidioc`.

use rustix::io::{Errno, Result, retry_on_intr};
use rustix::ioctl::opcode;
use std::ffi::c_int;
use std::marker::PhantomData;
use std::ptr::from_mut;
use v4l::device::Handle;
use v4l::v4l_sys as sys;
use v4l::v4l2::{self, vidioc};

/// The number of an ioctl command, in the C library's type.
type Number = vidioc::_IOC_TYPE;

/// A value that the kernel reads and overwrites.
///
/// # Safety
/// Every bit pattern must be a valid value of the type.
pub unsafe trait Argument: Sized {
    /// All zeros, which is what the kernel requires in unused fields.
    fn zeroed() -> Self {
        // SAFETY: every bit pattern is a valid value, by the contract of the trait.
        unsafe { std::mem::zeroed() }
    }
}

macro_rules! argument {
    ($($name:ty),* $(,)?) => {$(
        // SAFETY: integers, and C structures and unions of integers and raw pointers.
        unsafe impl Argument for $name {}
    )*};
}

argument!(
    c_int,
    sys::v4l2_buffer,
    sys::v4l2_capability,
    sys::v4l2_control,
    sys::v4l2_event,
    sys::v4l2_event_subscription,
    sys::v4l2_ext_control,
    sys::v4l2_ext_controls,
    sys::v4l2_fmtdesc,
    sys::v4l2_format,
    sys::v4l2_frmivalenum,
    sys::v4l2_frmsizeenum,
    sys::v4l2_query_ext_ctrl,
    sys::v4l2_querymenu,
    sys::v4l2_requestbuffers,
);

/// An ioctl command and the type of its argument.
pub struct Command<T> {
    number: Number,
    argument: PhantomData<T>,
}

impl<T: Argument> Command<T> {
    /// Does not compile if the command has an argument of another size, because the kernel
    /// would write past the end of `T`.
    const fn new(number: Number) -> Self {
        // Bits 16 to 29 of the number are the size of the argument (asm-generic/ioctl.h).
        assert!((number >> 16) & 0x3fff == size_of::<T>() as Number);
        Self {
            number,
            argument: PhantomData,
        }
    }

    #[cfg(test)]
    pub const fn number(&self) -> Number {
        self.number
    }

    /// Sends the command to the driver behind `handle`, again if a signal interrupted it.
    pub fn send(&self, handle: &Handle, argument: &mut T) -> Result<()> {
        retrying(|| {
            // SAFETY: the command takes a `T` (see the list below; `new` has checked the size),
            // which is exclusively borrowed during the call, and whatever the kernel writes is
            // a valid `T`. The only pointer in an argument, `v4l2_ext_controls::controls`, is
            // set in `V4l2Device::extended_control` to one control that outlives the call.
            unsafe { v4l2::ioctl(handle.fd(), self.number, from_mut(argument).cast()) }
        })
    }
}

/// Calls a function of the crate `v4l`, again if a signal interrupted it, and returns its error
/// as an error number.
pub fn retrying<R>(mut call: impl FnMut() -> std::io::Result<R>) -> Result<R> {
    retry_on_intr(|| call().map_err(|error| Errno::from_io_error(&error).unwrap_or(Errno::IO)))
}

pub const QUERYCAP: Command<sys::v4l2_capability> = Command::new(vidioc::VIDIOC_QUERYCAP);
pub const ENUM_FMT: Command<sys::v4l2_fmtdesc> = Command::new(vidioc::VIDIOC_ENUM_FMT);
pub const G_FMT: Command<sys::v4l2_format> = Command::new(vidioc::VIDIOC_G_FMT);
pub const S_FMT: Command<sys::v4l2_format> = Command::new(vidioc::VIDIOC_S_FMT);
pub const REQBUFS: Command<sys::v4l2_requestbuffers> = Command::new(vidioc::VIDIOC_REQBUFS);
pub const QUERYBUF: Command<sys::v4l2_buffer> = Command::new(vidioc::VIDIOC_QUERYBUF);
pub const QBUF: Command<sys::v4l2_buffer> = Command::new(vidioc::VIDIOC_QBUF);
pub const DQBUF: Command<sys::v4l2_buffer> = Command::new(vidioc::VIDIOC_DQBUF);
pub const STREAMON: Command<c_int> = Command::new(vidioc::VIDIOC_STREAMON);
pub const STREAMOFF: Command<c_int> = Command::new(vidioc::VIDIOC_STREAMOFF);
pub const G_CTRL: Command<sys::v4l2_control> = Command::new(vidioc::VIDIOC_G_CTRL);
pub const S_CTRL: Command<sys::v4l2_control> = Command::new(vidioc::VIDIOC_S_CTRL);
pub const QUERYMENU: Command<sys::v4l2_querymenu> = Command::new(vidioc::VIDIOC_QUERYMENU);
pub const G_EXT_CTRLS: Command<sys::v4l2_ext_controls> = Command::new(vidioc::VIDIOC_G_EXT_CTRLS);
pub const S_EXT_CTRLS: Command<sys::v4l2_ext_controls> = Command::new(vidioc::VIDIOC_S_EXT_CTRLS);
pub const ENUM_FRAMESIZES: Command<sys::v4l2_frmsizeenum> =
    Command::new(vidioc::VIDIOC_ENUM_FRAMESIZES);
pub const ENUM_FRAMEINTERVALS: Command<sys::v4l2_frmivalenum> =
    Command::new(vidioc::VIDIOC_ENUM_FRAMEINTERVALS);
pub const QUERY_EXT_CTRL: Command<sys::v4l2_query_ext_ctrl> =
    Command::new(vidioc::VIDIOC_QUERY_EXT_CTRL);
// The crate `v4l` does not have the numbers of the event commands.
pub const DQEVENT: Command<sys::v4l2_event> =
    Command::new(opcode::read::<sys::v4l2_event>(b'V', 89) as Number);
pub const SUBSCRIBE_EVENT: Command<sys::v4l2_event_subscription> =
    Command::new(opcode::write::<sys::v4l2_event_subscription>(b'V', 90) as Number);
