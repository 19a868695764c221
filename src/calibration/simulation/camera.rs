//! The renderer of a simulated camera: casts rays through its lens at flat panels in a room.
//!
//! A pixel whose four corners see the same cell gets the mean of the four values; the others are
//! supersampled. Edges are accurate to a hundredth of a pixel with little more than one ray per
//! pixel.

use super::panel::Panel;
use super::room::Room;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;

/// Rays along each side of a supersampled pixel.
const SAMPLES: u32 = 6;
/// Margin around the bounding box of a panel's projected corners, pixels: distortion may bend its
/// edges outwards.
const BOUNDS_MARGIN: f64 = 12.0;

/// A camera whose rays are computed once for all pictures.
#[derive(Clone, Debug)]
pub struct SimulatedCamera {
    lens: Lens,
    /// Rays through the corners of the pixels, `width + 1` in a row; `None` outside the lens's field
    /// of view.
    rays: Vec<Option<DVec3>>,
}

/// Intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Hit {
    /// Number of the cell, counted over all panels from 1; 0 is the room.
    cell: u32,
    /// Linear reflectance.
    reflectance: f32,
}

/// A panel that faces a camera in one pose.
struct VisiblePanel<'a> {
    panel: &'a Panel,
    /// Number of its first cell.
    first_cell: u32,
    panel_from_camera: DMat3,
    /// The camera's centre in the panel's frame, metres.
    camera_centre: DVec3,
    /// Bounds in the picture, pixels.
    low: DVec2,
    high: DVec2,
}

/// Result of a pixel without a ray.
const NO_RAY: Hit = Hit {
    cell: u32::MAX,
    reflectance: 0.0,
};

impl SimulatedCamera {
    /// Creates a camera with this lens.
    #[must_use]
    pub fn new(lens: &Lens) -> Self {
        let mut rays = Vec::new();
        for y in 0..=lens.height {
            for x in 0..=lens.width {
                let corner = DVec2::new(f64::from(x), f64::from(y)) - 0.5;
                rays.push(lens.unproject(corner));
            }
        }
        Self {
            lens: lens.clone(),
            rays,
        }
    }

    /// Returns the lens.
    #[must_use]
    pub const fn lens(&self) -> &Lens {
        &self.lens
    }

    /// Adds the rendered picture, linear and weighted by `share`, to `out` (`width · height`
    /// values); `world_from_camera` returns the pose at the exposure of a row.
    pub fn add_picture(
        &self,
        room: &Room,
        world_from_camera: &dyn Fn(u32) -> RigidTransform,
        share: f32,
        out: &mut [f32],
    ) {
        let (width, height) = (self.lens.width as usize, self.lens.height as usize);
        let mut previous = vec![NO_RAY; width + 1];
        let mut row = previous.clone();
        for y in 0..=height {
            let pose = world_from_camera((y as u32).min(self.lens.height - 1));
            let view = View {
                room,
                pose,
                panels: self.visible_panels(room, pose),
            };
            for (x, slot) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64, y as f64) - 0.5;
                *slot = view.trace(self.rays[y * (width + 1) + x], at);
            }
            if y > 0 {
                for x in 0..width {
                    let hits = [previous[x], previous[x + 1], row[x], row[x + 1]];
                    let reflectance = if hits.iter().all(|h| h.cell == hits[0].cell) {
                        0.25 * hits.iter().map(|h| h.reflectance).sum::<f32>()
                    } else {
                        self.supersampled(&view, x, y - 1)
                    };
                    out[(y - 1) * width + x] += share * reflectance;
                }
            }
            std::mem::swap(&mut previous, &mut row);
        }
    }

    /// Returns the mean over a pixel's area.
    fn supersampled(&self, view: &View, x: usize, y: usize) -> f32 {
        let stride = self.lens.width as usize + 1;
        let corner = |dx: usize, dy: usize| self.rays[(y + dy) * stride + x + dx];
        let (Some(a), Some(b), Some(c), Some(d)) =
            (corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1))
        else {
            return 0.0;
        };
        let at = DVec2::new(x as f64, y as f64);
        let mut sum = 0.0;
        for i in 0..SAMPLES * SAMPLES {
            let u = (f64::from(i % SAMPLES) + 0.5) / f64::from(SAMPLES);
            let v = (f64::from(i / SAMPLES) + 0.5) / f64::from(SAMPLES);
            let ray = a.lerp(b, u).lerp(c.lerp(d, u), v);
            sum += view.trace(Some(ray), at).reflectance;
        }
        sum / (SAMPLES * SAMPLES) as f32
    }

    /// Returns the panels that face the camera.
    fn visible_panels<'a>(&self, room: &'a Room, pose: RigidTransform) -> Vec<VisiblePanel<'a>> {
        let camera_from_world = pose.inverse();
        let mut next_cell = 1;
        let mut out = Vec::with_capacity(room.panels.len());
        for panel in &room.panels {
            let first_cell = next_cell;
            next_cell += panel.reflectance.len() as u32;
            let panel_from_camera = panel.world_from_panel.inverse() * pose;
            // The back of a panel is invisible.
            if panel_from_camera.translation.z >= 0.0 {
                continue;
            }
            let corners = panel.corners();
            let pixels = corners.map(|c| self.lens.project(camera_from_world.transform_point(c)));
            let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
            for pixel in pixels.iter().flatten() {
                (low, high) = (low.min(*pixel), high.max(*pixel));
            }
            if pixels.contains(&None) {
                (low, high) = (DVec2::MIN, DVec2::MAX);
            }
            out.push(VisiblePanel {
                panel,
                first_cell,
                panel_from_camera: DMat3::from_quat(panel_from_camera.rotation),
                camera_centre: panel_from_camera.translation,
                low: low - BOUNDS_MARGIN,
                high: high + BOUNDS_MARGIN,
            });
        }
        out
    }
}

/// A room seen from one pose of a camera.
struct View<'a> {
    room: &'a Room,
    pose: RigidTransform,
    panels: Vec<VisiblePanel<'a>>,
}

impl View<'_> {
    /// Returns the first intersection of a ray (camera's frame) through the pixel `at`.
    fn trace(&self, ray: Option<DVec3>, at: DVec2) -> Hit {
        let Some(ray) = ray else { return NO_RAY };
        let mut nearest = (f64::INFINITY, NO_RAY);
        for visible in &self.panels {
            if at.cmplt(visible.low).any() || at.cmpgt(visible.high).any() {
                continue;
            }
            let ray = visible.panel_from_camera * ray;
            let t = -visible.camera_centre.z / ray.z;
            if t.is_nan() || t <= 0.0 || t >= nearest.0 {
                continue;
            }
            if let Some(cell) = visible
                .panel
                .cell_at((visible.camera_centre + ray * t).truncate())
            {
                let hit = Hit {
                    cell: visible.first_cell + cell as u32,
                    reflectance: visible.panel.reflectance[cell],
                };
                nearest = (t, hit);
            }
        }
        let (walls, reflectance) = self
            .room
            .wall_hit(self.pose.translation, self.pose.rotation * ray);
        if walls < nearest.0 {
            return Hit {
                cell: 0,
                reflectance,
            };
        }
        nearest.1
    }
}
