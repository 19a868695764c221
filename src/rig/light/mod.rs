//! The light of a frame, at the scene camera's white point.
//!
//! In the order in which data flows: the `scheduler` decides which light a frame is composed
//! in and when its own is estimated; between two estimates it is interpolated, in a recording by
//! the `timeline`, in a live rig by the `transition`, and `blended` makes it; the `worker` runs the
//! estimate, on its own thread in a live rig; the [`estimator`] turns environment pictures, gains ([`estimator`]) and the radiance of
//! real surfaces (`surfaces`) into lighting, and `indirect` adds the light that moving virtual
//! objects reflect. `bracket_response` checks the environment
//! camera's tone curve, `chart` matches both cameras by pictures of a chart, `places` finds where lamps (`known_lamp`) are: as stated
//! (`stated_lights`), from several views of them (`lamp_views`, with `bright_spots` in the scene camera's picture), and
//! from real shadows; `unseen_lamps` finds those that the environment camera does not see, from what the scene camera's picture shows of
//! real surfaces (`sight`), and `agreement` says how well real shadows confirm the light. `scene_tables` holds what the estimator derives from a scene; a changed scene
//! reaches it through `updates`. `state` and `view` are the data in between.

pub mod agreement;
pub mod blended;
pub(crate) mod bracket_response;
mod bright_spots;
pub(crate) mod chart;
pub mod estimator;
mod indirect;
mod known_lamp;
mod lamp_views;
mod places;
pub mod report;
pub(crate) mod scene_tables;
pub(crate) mod scheduler;
mod sight;
pub mod state;
mod stated_lights;
mod surfaces;
mod timeline;
mod transition;
mod unseen_lamps;
pub(crate) mod updates;
pub mod view;
pub(crate) mod worker;
