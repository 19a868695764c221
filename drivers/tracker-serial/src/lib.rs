//! Protocols of serial 6-DOF trackers, decoded without I/O.
//!
//! Each protocol is a module of its own that turns bytes, pushed as they arrive and split
//! anywhere, into [`PoseSample`](penumbra_interface::PoseSample)s. None of them opens a
//! port, reads a clock or allocates per record, so a recorded stream and a live one decode
//! alike. On garbage a decoder slides one byte and tries again; it never flushes.

pub mod fastrak;
