//! Levels of detail: index buffers with fewer triangles for virtual parts that are small in the
//! picture, where triangles smaller than a pixel cost time without being visible.

use super::cover::{Corners, corners};
use super::mesh_buffers::{index_buffer, placed_indices};
use crate::compiled::Device;
use glam::{DMat3, DMat4};
use penumbra_scene::{Part, coarser};

/// Errors of the coarser levels as shares of the part's extent.
const ERRORS: [f64; 2] = [1.0 / 5000.0, 1.0 / 1250.0];
/// Maximum error in the picture, pixels. The quadric error is an average; the error of the worst
/// point is two to three times as large.
const MAX_ERROR_PIXELS: f64 = 0.2;

/// One level of detail.
pub struct Level {
    pub indices: wgpu::Buffer,
    pub count: u32,
    error_m: f64,
}

/// All levels of a part, the finest first, and the one to draw.
pub struct Details {
    levels: Vec<Level>,
    corners: Option<Corners>,
    /// Ratio of the part's size to the size for which the errors hold.
    growth: f64,
    chosen: usize,
}

impl Details {
    /// Uploads the part's triangles and, with `coarse`, coarser levels.
    pub fn new(device: &Device, part: &Part, coarse: bool) -> Self {
        let level = |indices: &[u32], error_m| Level {
            indices: index_buffer(device, &placed_indices(part, indices)),
            count: indices.len() as u32,
            error_m,
        };
        let corners = corners(
            part.mesh.vertices.iter().map(|v| v.position.as_dvec3()),
            part.world_from_part,
        );
        let mut levels = vec![level(&part.mesh.indices, 0.0)];
        if let Some(corners) = corners.filter(|_| coarse) {
            let extent = corners[0].distance(corners[7]);
            let textured = part.material.is_textured();
            levels.extend(ERRORS.iter().filter_map(|share| {
                let error = extent * share / scale(part);
                coarser(&part.mesh, error as f32, textured).map(|i| level(&i, extent * share))
            }));
        }
        Self {
            levels,
            corners,
            growth: 1.0,
            chosen: 0,
        }
    }

    /// The box around the part, world.
    pub const fn corners(&self) -> Option<&Corners> {
        self.corners.as_ref()
    }

    /// Sets the box after the part has moved or changed its size.
    pub fn set_corners(&mut self, corners: Corners) {
        let across = |c: &Corners| c[0].distance(c[7]);
        let before = self.corners.as_ref().map_or(0.0, across);
        if before > 0.0 {
            self.growth *= across(&corners) / before;
        }
        self.corners = Some(corners);
    }

    /// Chooses the coarsest level whose error is not visible; `focal` is the focal length, pixels.
    pub fn choose(&mut self, clip_from_world: DMat4, focal: f64) {
        let nearest = self.corners.iter().flatten().fold(f64::INFINITY, |z, c| {
            z.min((clip_from_world * c.extend(1.0)).w)
        });
        let pixels_per_metre = self.growth * focal / nearest.max(1e-3);
        self.chosen = self
            .levels
            .iter()
            .rposition(|l| l.error_m * pixels_per_metre <= MAX_ERROR_PIXELS)
            .unwrap_or(0);
    }

    /// The chosen level.
    pub fn level(&self) -> &Level {
        &self.levels[self.chosen]
    }
}

/// The maximum length in the world of a metre of the part.
fn scale(part: &Part) -> f64 {
    let linear = DMat3::from_mat4(part.world_from_part);
    [linear.x_axis, linear.y_axis, linear.z_axis]
        .iter()
        .fold(f64::MIN_POSITIVE, |most, axis| most.max(axis.length()))
}
