//! The compositor on the software Vulkan driver, compared with its CPU reference (the "twin"), with
//! closed-form ground truth, and with a few golden pictures.
#![expect(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

mod area_lamps;
mod auto_exposure;
mod baking;
mod comparison;
mod compiled;
mod exposure;
mod exposure_by_paper;
mod gloss;
mod golden;
mod indirect_light;
mod lamp_cost;
mod lamp_response;
mod lamps;
mod lens;
mod light_probe;
mod look;
mod moving;
mod nearby;
mod plane_sources;
mod planes;
mod present;
mod real_edges;
mod relief;
mod reproject;
mod rolling;
mod settings;
mod shadows;
mod soft_dots;
mod soft_shadows;
mod stage;
mod unchanged;
mod vignetting;
mod virtual_surfaces;
