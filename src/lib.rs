//! Penumbra composites virtual objects into a live picture so that their light,
//! reflections and soft shadows agree with the real scene.
//!
//! The layout, in the order a frame travels: `drivers/*` (crates of their own) and
//! [`session`] yield bytes with arrival times; `capture` turns them into pictures and
//! poses; [`sync`] brings them to one instant; [`calibration`] knows the rig's geometry,
//! white point and exposure; [`environment`] turns the environment camera's picture into
//! light; [`scene`] holds what is virtual and the proxies of what is real. The
//! [`compositor`], the only module that records GPU commands, makes one picture of it
//! all, and [`output`] shows it. [`rig`] wires these together and is the only place that
//! spawns; [`config`] says with what settings; [`status`] tells what is going on.

pub mod bench;
pub mod doctor;
pub mod rig;
