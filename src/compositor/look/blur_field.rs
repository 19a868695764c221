//! Motion during the exposure and circle of confusion, by cell of the picture.
//!
//! Both change slowly over an object, so that they are computed on the CPU for cells of some pixels,
//! from the boxes around the virtual parts: a cell that sees a box has the motion of its part at the
//! depth of the box, other cells that of the ground. Beside a part the picture shows its blurred
//! outline, so that cells there take the part's values. Where the ground lies in the shadow that the
//! brightest light casts of a moving part, cells have the motion of the shadow.

use super::super::cover::Corners;
use super::super::frame_input::FrameInput;
use super::Look;
use super::uniform::{MAX_TAPS, TAPS};
use glam::{DMat3, DMat4, DVec2, DVec3, Vec3Swizzles};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;

/// Pixels a side of a cell.
pub const CELL: u32 = 16;
/// Maximum length of a motion, and maximum diameter of a circle of confusion, pixels.
const MAX_EXTENT: f64 = 48.0;
/// Motions and circles up to this extent are not visible, pixels.
const MIN_EXTENT: f64 = 0.3;
/// Cells around a part that take its values: as many as its outline can be blurred into.
const MAX_RING: usize = 3;
/// Dominance of the brightest light below which its shadows are too weak to show their motion.
const MIN_DOMINANCE: f64 = 0.05;
/// Distances to which the ground is assumed to extend, metres.
const GROUND_RANGE: std::ops::Range<f64> = 0.05..20.0;

/// A part, with its box in the world and its displacement during the exposure.
pub struct BlurredBox {
    pub corners: Corners,
    /// World at the end of the exposure from world at its begin; `None` for a part at rest.
    pub moved: Option<[DMat4; 2]>,
}

/// Motion (x, y) and radius of the circle of confusion, pixels, of one cell.
type Blur = [f32; 4];

/// The field, and the camera for which its rays were computed.
#[derive(Default)]
pub struct BlurField {
    camera: Option<PinholeCamera>,
    across: usize,
    /// Direction (x, y, 1) that each cell's centre shows, row by row.
    rays: Vec<DVec2>,
    cells: Vec<Blur>,
    /// Depth and number of the part that each cell sees.
    seen: Vec<Option<f64>>,
    spread: Vec<Blur>,
}

/// A box prepared for intersection with rays: the frame in which it is the unit cube.
struct Slab {
    unit_from_world: DMat3,
    origin: DVec3,
}

impl BlurField {
    /// Number of cells across and down.
    pub fn size(&self) -> (u32, u32) {
        let down = self.cells.len().checked_div(self.across).unwrap_or(0);
        (self.across as u32, down as u32)
    }

    /// The cells, row by row.
    pub fn cells(&self) -> &[Blur] {
        &self.cells
    }

    /// Number of samples for blurs of up to `extent` pixels.
    pub fn taps(extent: f64) -> usize {
        let enough = TAPS.iter().find(|(most, _)| extent <= *most);
        enough.map_or(MAX_TAPS, |(_, count)| *count)
    }

    /// Motion and radius of the circle of confusion at `pixel`, interpolated between cells.
    pub fn at(&self, pixel: DVec2) -> [f64; 3] {
        let at = (pixel + 0.5) / f64::from(CELL) - 0.5;
        let corner = at.floor();
        let part = at - corner;
        let (across, down) = self.size();
        let mut sum = [0.0; 3];
        for (i, j) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let x = (corner.x as i64 + i).clamp(0, i64::from(across) - 1) as usize;
            let y = (corner.y as i64 + j).clamp(0, i64::from(down) - 1) as usize;
            let share = |k: i64, p: f64| if k == 1 { p } else { 1.0 - p };
            let weight = share(i, part.x) * share(j, part.y);
            let cell = self.cells[y * self.across + x];
            for (sum, value) in sum.iter_mut().zip(cell) {
                *sum += f64::from(value) * weight;
            }
        }
        sum
    }

    /// Fills the field for a picture of `camera`; returns the largest extent of a blur in it,
    /// pixels: 0 if nothing is blurred visibly.
    pub fn update(
        &mut self,
        camera: &PinholeCamera,
        input: &FrameInput<'_>,
        boxes: &[BlurredBox],
        ground: Option<f64>,
    ) -> f64 {
        self.fit(camera);
        self.cells.fill([0.0; 4]);
        let Some(pose) = input.world_from_camera else {
            return 0.0;
        };
        if input.look.motion.is_none() && input.look.depth_of_field.is_none() {
            return 0.0;
        }
        let scene = Scene {
            camera,
            pose,
            look: &input.look,
            ground,
            distance: mean_distance(boxes, &pose),
        };
        self.seen.fill(None);
        for (cell, ray) in self.cells.iter_mut().zip(&self.rays) {
            *cell = scene.blur(*ray, scene.ground_depth(*ray), |_| DVec3::ZERO);
        }
        for part in boxes {
            self.draw(&scene, part);
        }
        self.spread();
        let light = input.brightest.as_dvec3();
        let moves = |part: &&BlurredBox| part.moved.is_some_and(|[a, b]| a != b);
        if light.z > 0.0 && light.length() > MIN_DOMINANCE && boxes.iter().any(|b| moves(&b)) {
            let to_light = light.normalize();
            for part in boxes.iter().filter(moves) {
                self.draw_shadow(&scene, part, to_light);
            }
            self.spread();
        }
        let extent = |c: &Blur| f64::from(c[0].hypot(c[1]) + 2.0 * c[2]);
        let largest = self.cells.iter().map(extent).fold(0.0, f64::max);
        if largest < MIN_EXTENT { 0.0 } else { largest }
    }

    /// Computes the rays of the cells for a new camera.
    fn fit(&mut self, camera: &PinholeCamera) {
        if self.camera.as_ref() == Some(camera) {
            return;
        }
        let (across, down) = (camera.width.div_ceil(CELL), camera.height.div_ceil(CELL));
        let centre = |i: u32| (f64::from(i) + 0.5) * f64::from(CELL) - 0.5;
        let cells = (0..down).flat_map(|y| (0..across).map(move |x| (x, y)));
        self.rays = cells
            .map(|(x, y)| {
                let ray = camera.unproject(DVec2::new(centre(x), centre(y)));
                let direction = ray.truncate() / ray.z.max(1e-6);
                if direction.is_finite() {
                    direction
                } else {
                    DVec2::ZERO
                }
            })
            .collect();
        self.across = across as usize;
        self.cells = vec![[0.0; 4]; self.rays.len()];
        self.spread = self.cells.clone();
        self.seen = vec![None; self.rays.len()];
        self.camera = Some(camera.clone());
    }

    /// Draws a part into the cells that see its box, unless they see a nearer one.
    fn draw(&mut self, scene: &Scene<'_>, part: &BlurredBox) {
        let slab = Slab::new(&part.corners);
        let eye = slab.unit_from_world * (scene.pose.translation - slab.origin);
        let unit_from_camera = slab.unit_from_world * DMat3::from_quat(scene.pose.rotation);
        let cells = self.cells.iter_mut().zip(&mut self.seen).zip(&self.rays);
        for ((cell, seen), ray) in cells {
            if let Some(depth) = mean_depth(eye, unit_from_camera * ray.extend(1.0))
                && seen.is_none_or(|nearer| depth < nearer)
            {
                *seen = Some(depth);
                let moved = part.moved.as_ref();
                let shift = |world: DVec3| {
                    moved.map_or(DVec3::ZERO, |[begin, end]| {
                        end.transform_point3(world) - begin.transform_point3(world)
                    })
                };
                *cell = scene.blur(*ray, depth, shift);
            }
        }
    }

    /// Draws the shadow of a moving part into the cells that see the ground where the part hides the
    /// light from it.
    fn draw_shadow(&mut self, scene: &Scene<'_>, part: &BlurredBox, to_light: DVec3) {
        let (Some([begin, end]), Some(height)) = (&part.moved, scene.ground) else {
            return;
        };
        let slab = Slab::new(&part.corners);
        let towards = slab.unit_from_world * to_light;
        let cells = self.cells.iter_mut().zip(&mut self.seen).zip(&self.rays);
        for ((cell, seen), ray) in cells.filter(|c| c.0.1.is_none()) {
            let depth = scene.ground_depth(*ray);
            let ground = scene.pose.transform_point(ray.extend(1.0) * depth);
            let from = slab.unit_from_world * (ground - slab.origin);
            if (ground.z - height).abs() < 1e-6 * depth
                && let Some(distance) = mean_depth(from, towards)
            {
                let caster = ground + to_light * distance;
                let shift = end.transform_point3(caster) - begin.transform_point3(caster);
                let fallen = to_light.xy() * (shift.z / to_light.z);
                *seen = Some(depth);
                *cell = scene.blur(*ray, depth, |_| (shift.xy() - fallen).extend(0.0));
            }
        }
    }

    /// Gives cells beside a part or the shadow of a moving one its values, as far as its blur reaches,
    /// and counts them to it.
    fn spread(&mut self) {
        self.spread.copy_from_slice(&self.cells);
        let (across, down) = self.size();
        let (across, down) = (across as usize, down as usize);
        for y in 0..down {
            for x in 0..across {
                let own = y * across + x;
                if self.seen[own].is_some() {
                    continue;
                }
                let rows = y.saturating_sub(MAX_RING)..(y + MAX_RING + 1).min(down);
                let near = rows.flat_map(|v| {
                    let columns = x.saturating_sub(MAX_RING)..(x + MAX_RING + 1).min(across);
                    columns.map(move |u| (u, v))
                });
                let reached = near.filter(|(u, v)| {
                    let other = v * across + u;
                    let [dx, dy, r, _] = self.cells[other];
                    let rings = u.abs_diff(x).max(v.abs_diff(y));
                    // A cell's outline may lie anywhere in it.
                    let reach = 0.5 * dx.abs().max(dy.abs()) + r;
                    let limit = rings.saturating_sub(1) as f32 * CELL as f32;
                    self.seen[other].is_some() && reach >= limit
                });
                let nearest = reached.min_by_key(|(u, v)| u.abs_diff(x).max(v.abs_diff(y)));
                if let Some((u, v)) = nearest {
                    self.spread[own] = self.cells[v * across + u];
                    self.spread[own][3] = 1.0;
                }
            }
        }
        std::mem::swap(&mut self.cells, &mut self.spread);
        for (cell, seen) in self.cells.iter_mut().zip(&mut self.seen) {
            if std::mem::take(&mut cell[3]) != 0.0 {
                *seen = Some(f64::INFINITY);
            }
        }
    }
}

impl Slab {
    fn new(corners: &Corners) -> Self {
        // Corner i has bit 0 set at the far end of the first axis, and so on.
        let [origin, x, y, z] = [0, 1, 2, 4].map(|i| corners[i]);
        // Flat boxes get some thickness.
        let axes = [x - origin, y - origin, z - origin];
        let longest = axes.iter().map(|a| a.length()).fold(1e-6, f64::max);
        let thick = |a: DVec3, b: DVec3, c: DVec3| {
            if a.length() > 1e-3 * longest {
                a
            } else {
                b.cross(c).try_normalize().unwrap_or(DVec3::Z) * 1e-3 * longest
            }
        };
        let [a, b, c] = axes;
        let world_from_unit = DMat3::from_cols(thick(a, b, c), thick(b, c, a), thick(c, a, b));
        Self {
            unit_from_world: world_from_unit.inverse(),
            origin,
        }
    }
}

/// Mean parameter at which a ray is in the unit cube; `None` if it misses it.
fn mean_depth(eye: DVec3, direction: DVec3) -> Option<f64> {
    let (mut from, mut to) = (0.0, f64::INFINITY);
    for axis in 0..3 {
        let (d, e) = (direction[axis], eye[axis]);
        let ends = [-e / d, (1.0 - e) / d];
        if d == 0.0 {
            if !(0.0..=1.0).contains(&e) {
                return None;
            }
            continue;
        }
        from = ends[0].min(ends[1]).max(from);
        to = ends[0].max(ends[1]).min(to);
    }
    (from < to && to.is_finite()).then_some(0.5 * (from + to))
}

/// What the cells have in common.
struct Scene<'a> {
    camera: &'a PinholeCamera,
    pose: RigidTransform,
    look: &'a Look,
    ground: Option<f64>,
    /// Mean distance of the parts, metres.
    distance: f64,
}

impl Scene<'_> {
    /// Depth of the ground along the axis of the camera, or of the objects where the ray misses it.
    fn ground_depth(&self, ray: DVec2) -> f64 {
        let direction = self.pose.rotation * ray.extend(1.0);
        let depth = self
            .ground
            .map(|height| (height - self.pose.translation.z) / direction.z);
        depth
            .filter(|d| GROUND_RANGE.contains(d))
            .unwrap_or(self.distance)
    }

    /// Blur of the point at `depth` that a ray sees; `shift` is its own displacement, world.
    fn blur(&self, ray: DVec2, depth: f64, shift: impl Fn(DVec3) -> DVec3) -> Blur {
        let point = ray.extend(1.0) * depth;
        let focal = self.camera.focal;
        let mut motion = DVec2::ZERO;
        if let Some(exposure) = &self.look.motion {
            let own = shift(self.pose.transform_point(point));
            let shift = exposure.displacement(point) + self.pose.rotation.inverse() * own;
            motion = (shift.truncate() - ray * shift.z) / depth * focal;
        }
        let circle = self
            .look
            .depth_of_field
            .map_or(0.0, |d| d.circle(focal.max_element(), depth));
        let motion = motion.clamp_length_max(MAX_EXTENT);
        let radius = 0.5 * circle.min(MAX_EXTENT);
        [motion.x as f32, motion.y as f32, radius as f32, 0.0]
    }
}

fn mean_distance(boxes: &[BlurredBox], pose: &RigidTransform) -> f64 {
    let to_camera = pose.inverse();
    let corners = boxes.iter().flat_map(|b| &b.corners);
    let depths = corners.map(|c| to_camera.transform_point(*c).z);
    let (sum, count) = depths.fold((0.0, 0.0), |(sum, count), z| (sum + z, count + 1.0));
    if count > 0.0 {
        (sum / count).max(GROUND_RANGE.start)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests;
