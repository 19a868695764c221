//! Where the environment camera stands and how it looks.
//!
//! `circle` finds a fisheye's image circle, `ball` the outline of a mirrored sphere: `optics`. `bright`
//! and `beams` find lights, `turn` which light is which; `tags` finds printed fiducials through a
//! fisheye, `pairs` reads what a user clicked on. What is seen by the environment camera and known in
//! the world are `sights`; `resection` makes them into a pose, and `solve` says how good that is.
//! [`EnvironmentStep`] is the step of calibration.

mod ball;
mod ball_search;
mod bright;
mod circle;
mod circle_search;
#[cfg(test)]
mod drawn;
mod gathered;
mod initial_poses;
mod light_directions;
mod mirror;
mod observations;
mod optics;
mod page;
mod pairs;
mod rays;
mod resection;
mod sharpen;
mod solve;
mod step;
mod tags;
mod turn;
mod verdict;
mod view;

pub use ball::{NoOutline, Outline, RoughBall, outline};
pub use circle::{ImageCircle, NoCircle, image_circle};
pub use pairs::{Clicked, Pair, PairError, pairs};
pub use resection::{NoPose, Placed, Sight, Target, Unknowns, place};
pub use step::{Asked, EnvironmentStep, Kind, KnownRig, NotReady};
pub use tags::tags;
pub use turn::{Beam, Match, NoMatch, bring_together};
pub use view::View;
