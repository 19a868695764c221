//! The camera's own look on everything virtual: the composed picture gets the camera's depth of
//! field, motion blur, sharpness and grain wherever virtual objects or their shadows changed it.
//! The real picture has all of them already (Klein & Murray, "Simulating low-cost cameras for
//! augmented reality compositing", IEEE TVCG 16(3), 2010).
//!
//! | module | content |
//! |---|---|
//! | `input` | the look of a frame |
//! | `grain` | a tile of noise with the correlation of the camera's |
//! | `blur_field` | motion and circle of confusion by cell of the picture |
//! | `uniform` | the data that the shaders read |
//! | `stage` | the passes: tiles, layers, blur, spread, finish |
//! | `camera_look` | the stage that suits a frame, and its blur field |

mod blur_field;
mod camera_look;
pub mod grain;
mod input;
mod stage;
mod uniform;

pub(crate) use blur_field::{BlurField, BlurredBox, CELL};
pub(crate) use camera_look::{CameraLook, LookFit};
pub use input::Look;
pub(crate) use uniform::{MAX_TAPS, filtered_class, reach, samples, without_sharpening};
