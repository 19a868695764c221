//! System-dependent parts: the handle of an open port, reading with a time limit, and writing.
//!
//! Both systems offer the same functions: `preflight` before `serialport` opens the port,
//! `prepare` after it, then `read` and `write_all`.

#[cfg(unix)]
mod unix;
#[cfg(unix)]
pub(super) use unix::{
    NativePort, Preflight, is_gone, is_pseudo_terminal, preflight, prepare, read, write_all,
};

#[cfg(windows)]
mod windows;
#[cfg(windows)]
pub(super) use windows::{
    NativePort, Preflight, is_gone, is_pseudo_terminal, preflight, prepare, read, write_all,
};
