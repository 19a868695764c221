//! Composes augmented pictures on the GPU: from the camera picture, pose, light and scene it makes
//! the picture with virtual objects, their shadows and their reflections. No other crate records
//! GPU commands.
//!
//! The steps of a frame ([`Compositor::compose`], file `frame.rs`):
//!
//! 1. Place moving parts, fit size and shader variant, upload picture, light and uniforms; trace
//!    what glossy surfaces mirror of their neighbourhood.
//! 2. Undistort the camera picture; draw it in the exposure of the frame.
//! 3. Draw the shadow maps that are out of date, of dome lights and of virtual lights.
//! 4. Draw the visible surfaces: phantoms (proxies of the real scene) and virtual objects.
//! 5. Sort the picture into tiles by the lights that matter there.
//! 6. Shadow buffer: the light that each surface lacks, from shadow maps or shadowing planes.
//! 7. Add the light of virtual lights on real surfaces; gather the surroundings for reflections.
//! 8. Composite: the real picture times its shadow factor, virtual surfaces shaded on top.
//! 9. Distort the picture as the camera does; give its virtual parts the camera's look; warp it to
//!    the pose of its display.
//! 10. Measure the added light for the automatic exposure; copy the picture for reading.
//!
//! Modules, in the order in which data flows:
//!
//! | module | content |
//! |---|---|
//! | [`gpu`], `compiled`, [`requirements`], `bindings`, `textures`, `texels`, `recorder`, [`timing`] | the device and short forms of wgpu |
//! | `gpu_data`, `shaders`, `response_table` | the data that shaders read, and their text |
//! | `mesh_buffers`, `materials`, `detail`, `moving`, `emitters`, `scene_buffers`, `scene_upload` | the scene on the device |
//! | `caster_hull`, `shadow_slots`, `cover` | the choice of shadow maps to draw again and of covered tiles |
//! | `light_maps`, `gloss_maps`, `indirect_light_maps`, `lamp_maps`, `lamp_layers`, `lamp_coverage`, `lamp_screens` | the light on the device |
//! | `settings`, `frame_input`, `frame_view`, `frame_uniform` | the input of a frame |
//! | `passes`, `pipelines`, `sized_resources` | the passes and their pictures |
//! | `lens`, [`exposure`], [`planes`], [`look`], `reproject` | stages: groups of passes that run as one step |
//! | `reflections` | what glossy surfaces mirror of their neighbourhood, traced by the processor |
//! | `compositor`, `prepare`, `frame` | the state kept between frames; uploads; the passes in order |
//! | [`readback`] | the finished picture in memory |
//! | [`mod@reference`] | the same picture computed on the CPU, for tests |

mod bindings;
mod caster_hull;
mod compiled;
mod compositor;
mod cover;
mod detail;
mod emitters;
pub mod exposure;
mod frame;
mod frame_input;
mod frame_uniform;
mod frame_view;
mod gloss_maps;
pub mod gpu;
mod gpu_data;
mod indirect_light_maps;
mod lamp_coverage;
mod lamp_layers;
mod lamp_maps;
mod lamp_screens;
mod lens;
mod light_maps;
pub mod look;
mod materials;
mod mesh_buffers;
mod moving;
mod passes;
mod pipelines;
pub mod planes;
mod prepare;
pub mod readback;
mod recorder;
pub mod reference;
mod reflections;
mod reproject;
pub mod requirements;
mod response_table;
mod scene_buffers;
mod scene_upload;
mod settings;
mod shaders;
mod shadow_slots;
mod sized_resources;
mod surface_light;
mod texels;
mod textures;
pub mod timing;

pub use compiled::Device;
pub use compositor::Compositor;
pub use exposure::Exposure;
pub use frame_input::{ComingLight, FrameInput};
pub use gpu::{Gpu, GpuError};
pub use lens::LensOutput;
pub use look::Look;
pub use materials::{fitted, max_side};
pub use passes::present::PresentPass;
pub use reproject::Reprojection;
pub use scene_upload::{SceneUploader, UploadedScene};
pub use settings::CompositorSettings;
pub use shadow_slots::Refresh;
