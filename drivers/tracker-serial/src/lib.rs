//! Protocols of serial 6-DOF trackers, decoded without I/O.
