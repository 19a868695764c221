//! The units of length in which magnetic trackers measure.

/// Metres in an inch: the default unit of Polhemus and Ascension trackers.
pub const METRES_PER_INCH: f64 = 0.0254;

/// Metres in a centimetre, which Polhemus trackers can be switched to.
pub const METRES_PER_CENTIMETRE: f64 = 0.01;
