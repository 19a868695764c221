//! Pure functions of time stamps: clock offsets, pose history, pairing into one rig frame.
