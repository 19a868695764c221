//! The passes of a frame. Each file holds one pass, its output pictures, and the pipelines of the
//! shader of the same name. In the order in which they run:
//!
//! | pass | draws |
//! |---|---|
//! | [`exposure`] | the real picture in another exposure |
//! | [`shadow_map`] | depth of casters from dome lights |
//! | [`lamp_map`] | depth of casters from virtual lights |
//! | [`phantom_geometry`] | depth and normals of the real scene |
//! | [`virtual_geometry`] | shape and material of virtual objects |
//! | [`tiles`] | the lights that affect each tile |
//! | [`shadow_buffer`] | light that surfaces lose |
//! | [`edge_tiles`] | the tiles in which edges of the real scene matter |
//! | [`lamp_response`] | light that virtual lights add, by the paper's response |
//! | [`surroundings`] | the shadowed real picture for reflections |
//! | [`composite`] | the finished picture |
//! | [`present`] | the finished picture on a window |

pub mod composite;
pub mod edge_tiles;
pub mod exposure;
pub mod lamp_map;
pub mod lamp_response;
pub mod phantom_geometry;
pub mod present;
pub mod shadow_buffer;
pub mod shadow_map;
pub mod surroundings;
pub mod tiles;
pub mod virtual_geometry;
