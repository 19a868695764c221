//! The renderer of a simulated camera: casts rays through its lens at flat panels in a room.
//!
//! A pixel whose four corners see the same cell gets that cell's value; the others are
//! supersampled. So edges are accurate to a hundredth of a pixel with little more than one ray per
//! pixel.

use super::panel::Panel;
use super::room::Room;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;

/// Rays along each side of a pixel that an edge crosses.
const SAMPLES: u32 = 6;
/// Pixels by which a panel's picture may be larger than its corners say (a bent lens).
const ROOM_FOR_BENDS: f64 = 12.0;

/// A camera whose rays are computed once for many pictures.
#[derive(Clone, Debug)]
pub struct SimulatedCamera {
    lens: Lens,
    /// Rays through the corners of the pixels, `width + 1` in a row; none where the lens has
    /// none.
    rays: Vec<Option<DVec3>>,
}

/// Intersection of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Met {
    /// Which cell of which thing; 0 is the room.
    what: u32,
    light: f32,
}

/// A panel as seen by a camera in one pose.
struct Facing<'a> {
    panel: &'a Panel,
    number: u32,
    panel_from_camera: DMat3,
    eye: DVec3,
    /// Where in the picture it may be.
    low: DVec2,
    high: DVec2,
}

const DARK: Met = Met {
    what: u32::MAX,
    light: 0.0,
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

    /// Adds `share` of what it sees, linear, to `out` (`width · height` values);
    /// `world_from_camera` says where it is while it exposes a row.
    pub fn add(
        &self,
        room: &Room,
        world_from_camera: &dyn Fn(u32) -> RigidTransform,
        share: f32,
        out: &mut [f32],
    ) {
        let (width, height) = (self.lens.width as usize, self.lens.height as usize);
        let mut before = vec![DARK; width + 1];
        let mut row = before.clone();
        for y in 0..=height {
            let pose = world_from_camera((y as u32).min(self.lens.height - 1));
            let facing = self.facing(room, pose);
            let looks = Looks { room, pose, facing };
            for (x, slot) in row.iter_mut().enumerate() {
                let at = DVec2::new(x as f64, y as f64) - 0.5;
                *slot = looks.along(self.rays[y * (width + 1) + x], at);
            }
            if y > 0 {
                for x in 0..width {
                    let met = [before[x], before[x + 1], row[x], row[x + 1]];
                    let light = if met.iter().all(|m| m.what == met[0].what) {
                        0.25 * met.iter().map(|m| m.light).sum::<f32>()
                    } else {
                        self.mean(&looks, x, y - 1)
                    };
                    out[(y - 1) * width + x] += share * light;
                }
            }
            std::mem::swap(&mut before, &mut row);
        }
    }

    /// Returns the mean over the square of a pixel.
    fn mean(&self, looks: &Looks, x: usize, y: usize) -> f32 {
        let wide = self.lens.width as usize + 1;
        let corner = |dx: usize, dy: usize| self.rays[(y + dy) * wide + x + dx];
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
            sum += looks.along(Some(ray), at).light;
        }
        sum / (SAMPLES * SAMPLES) as f32
    }

    fn facing<'a>(&self, room: &'a Room, pose: RigidTransform) -> Vec<Facing<'a>> {
        let camera_from_world = pose.inverse();
        let mut first = 1;
        let mut out = Vec::with_capacity(room.panels.len());
        for panel in &room.panels {
            let number = first;
            first += panel.light.len() as u32;
            let panel_from_camera = panel.world_from_panel.inverse() * pose;
            // The back of a panel is blank.
            if panel_from_camera.translation.z >= 0.0 {
                continue;
            }
            let corners = panel.corners();
            let seen = corners.map(|c| self.lens.project(camera_from_world.transform_point(c)));
            let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
            for pixel in seen.iter().flatten() {
                (low, high) = (low.min(*pixel), high.max(*pixel));
            }
            if seen.contains(&None) {
                (low, high) = (DVec2::MIN, DVec2::MAX);
            }
            out.push(Facing {
                panel,
                number,
                panel_from_camera: DMat3::from_quat(panel_from_camera.rotation),
                eye: panel_from_camera.translation,
                low: low - ROOM_FOR_BENDS,
                high: high + ROOM_FOR_BENDS,
            });
        }
        out
    }
}

struct Looks<'a> {
    room: &'a Room,
    pose: RigidTransform,
    facing: Vec<Facing<'a>>,
}

impl Looks<'_> {
    /// Returns the first intersection of a ray (camera's frame) through a pixel.
    fn along(&self, ray: Option<DVec3>, at: DVec2) -> Met {
        let Some(ray) = ray else { return DARK };
        let mut nearest = (f64::INFINITY, DARK);
        for facing in &self.facing {
            if at.cmplt(facing.low).any() || at.cmpgt(facing.high).any() {
                continue;
            }
            let ray = facing.panel_from_camera * ray;
            let t = -facing.eye.z / ray.z;
            if t.is_nan() || t <= 0.0 || t >= nearest.0 {
                continue;
            }
            if let Some(cell) = facing.panel.cell_at((facing.eye + ray * t).truncate()) {
                let met = Met {
                    what: facing.number + cell as u32,
                    light: facing.panel.light[cell],
                };
                nearest = (t, met);
            }
        }
        let (walls, light) = self
            .room
            .behind(self.pose.translation, self.pose.rotation * ray);
        if walls < nearest.0 {
            return Met { what: 0, light };
        }
        nearest.1
    }
}
