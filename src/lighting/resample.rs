//! Resamples the picture's pixels to the cube's texels without loss or gain of energy.

use super::cube::{CubeGrid, face_direction};
use super::geodesic::triangle_solid_angle;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::PlacedView;
use std::ops::Range;

/// Tests whether a ray (origin, direction; world) ends on a proxy of a real object.
pub type Hidden<'a> = dyn Fn(DVec3, DVec3) -> bool + 'a;

/// Direction and solid angle of each pixel of the environment camera's picture. Row-major.
#[derive(Clone, Debug)]
pub struct PixelDirections {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Unit direction, world; undefined where the solid angle is zero.
    pub directions: Vec<Vec3>,
    /// Solid angle, steradians; zero for pixels that see nothing of the environment.
    pub solid_angles: Vec<f32>,
}

impl PixelDirections {
    /// Computes every pixel of a view. Pixels whose ray is `hidden` count as unseen.
    #[must_use]
    pub fn new(view: &PlacedView, hidden: Option<&Hidden>) -> Self {
        let (width, height) = view.size();
        Self::within(view, hidden, 0..width, 0..height)
    }

    /// The same for a mirrored sphere that covers a small part of the picture: only the pixels
    /// around it are evaluated, and objects in front of it hide it.
    #[must_use]
    pub fn around_mirror(view: &PlacedView, hidden: Option<&Hidden>) -> Self {
        let (columns, rows) = view.bounds();
        let mut pixels = Self::within(view, hidden, columns.clone(), rows.clone());
        let Some(hides) = hidden else { return pixels };
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let i = (y * pixels.width + x) as usize;
            let at = DVec2::new(f64::from(x), f64::from(y));
            let ray = view.camera_ray(at).filter(|_| pixels.solid_angles[i] > 0.0);
            if ray.is_some_and(|ray| hides(ray.origin, ray.direction)) {
                pixels.solid_angles[i] = 0.0;
            }
        }
        pixels
    }

    fn within(
        view: &PlacedView,
        hidden: Option<&Hidden>,
        columns: Range<u32>,
        rows: Range<u32>,
    ) -> Self {
        let (width, height) = view.size();
        let count = width as usize * height as usize;
        let mut directions = vec![Vec3::Z; count];
        let mut solid_angles = vec![0.0; count];
        let corner_row = |y: f64| -> Vec<Option<DVec3>> {
            (columns.start..=columns.end)
                .map(|x| view.direction(DVec2::new(f64::from(x) - 0.5, y - 0.5)))
                .collect()
        };
        let mut above = corner_row(f64::from(rows.start));
        for y in rows {
            let below = corner_row(f64::from(y) + 1.0);
            for (k, x) in columns.clone().enumerate() {
                let quad = [above[k], above[k + 1], below[k + 1], below[k]];
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                let i = (y * width + x) as usize;
                (directions[i], solid_angles[i]) = observe_pixel(view, hidden, pixel, quad);
            }
            above = below;
        }
        Self {
            width,
            height,
            directions,
            solid_angles,
        }
    }
}

fn observe_pixel(
    view: &PlacedView,
    hidden: Option<&Hidden>,
    pixel: DVec2,
    quad: [Option<DVec3>; 4],
) -> (Vec3, f32) {
    let ([Some(a), Some(b), Some(c), Some(d)], Some(ray)) = (quad, view.ray(pixel)) else {
        return (Vec3::Z, 0.0);
    };
    if hidden.is_some_and(|hides| hides(ray.origin, ray.direction)) {
        return (Vec3::Z, 0.0);
    }
    let direction = view.direction(pixel).unwrap_or(ray.direction).as_vec3();
    let solid_angle = triangle_solid_angle(a, b, c) + triangle_solid_angle(a, c, d);
    (direction, solid_angle as f32)
}

/// The pixels of each texel and their weights, whose sum is one.
///
/// Every texel is sampled on a grid fine enough that neighbouring samples are at most half a pixel
/// apart, and each sample reads the picture bilinearly; the samples of a texel are weighted by
/// their solid angles. The tents of bilinear interpolation add up to one on such a grid, so a
/// source of a single pixel keeps its energy.
#[derive(Clone, Debug, Default)]
pub struct GatherTable {
    starts: Vec<u32>,
    entries: Vec<(u32, f32)>,
    /// Visible part of each texel, 0..=1.
    pub coverage: Vec<f32>,
}

impl GatherTable {
    /// Builds the table for a cube of `size` texels along a side. `seen` is the solid angle of each
    /// pixel, zero for unseen ones. No texel gets more than `finest` samples along a side; with one
    /// or two, all get the same number (for pictures coarser than the cube).
    #[must_use]
    pub fn new(view: &PlacedView, seen: &[f32], size: u32, finest: u32) -> Self {
        let mut table = Self::default();
        let mut scratch = Vec::new();
        table.starts.push(0);
        for face in 0..6 {
            for (y, x) in (0..size * size).map(|i| (i / size, i % size)) {
                let texel = Texel { face, x, y, size };
                scratch.clear();
                let covered = texel.gather(view, seen, finest, &mut scratch);
                table.push(covered, &mut scratch);
            }
        }
        table
    }

    fn push(&mut self, covered: f32, found: &mut [(u32, f32)]) {
        found.sort_unstable_by_key(|e| e.0);
        let first = self.entries.len();
        for &(pixel, weight) in found.iter() {
            match self.entries[first..].last_mut() {
                Some(last) if last.0 == pixel => last.1 += weight,
                _ => self.entries.push((pixel, weight)),
            }
        }
        let total: f32 = self.entries[first..].iter().map(|e| e.1).sum();
        for entry in &mut self.entries[first..] {
            entry.1 /= total.max(f32::MIN_POSITIVE);
        }
        self.starts.push(self.entries.len() as u32);
        self.coverage.push(covered);
    }

    /// Computes the part of each texel that comes from the given pixels, 0..=1, into `shares`.
    pub fn shares(&self, pixels: &[u32], marks: &mut Vec<bool>, shares: &mut Vec<f32>) {
        shares.clear();
        marks.clear();
        let Some(&last) = pixels.iter().max() else {
            shares.resize(self.coverage.len(), 0.0);
            return;
        };
        marks.resize(last as usize + 1, false);
        pixels.iter().for_each(|&i| marks[i as usize] = true);
        let marked = |i: u32| marks.get(i as usize) == Some(&true);
        shares.extend(self.starts.windows(2).map(|range| {
            self.entries[range[0] as usize..range[1] as usize]
                .iter()
                .filter(|(i, _)| marked(*i))
                .map(|(_, w)| w)
                .sum::<f32>()
        }));
    }

    /// Computes texel values from pixel values; zero where nothing is seen.
    pub fn apply(&self, pixels: &[Vec3], texels: &mut Vec<Vec3>) {
        texels.clear();
        texels.extend(self.starts.windows(2).map(|range| {
            self.entries[range[0] as usize..range[1] as usize]
                .iter()
                .map(|&(i, w)| pixels[i as usize] * w)
                .sum::<Vec3>()
        }));
    }
}

struct Texel {
    face: usize,
    x: u32,
    y: u32,
    size: u32,
}

impl Texel {
    fn direction(&self, s: f64, t: f64) -> DVec3 {
        let n = f64::from(self.size);
        face_direction(
            self.face,
            (f64::from(self.x) + s) / n,
            (f64::from(self.y) + t) / n,
        )
    }

    /// Samples along a side so that samples are at most half a pixel apart.
    fn samples_a_side(&self, view: &PlacedView, finest: u32) -> u32 {
        let at = |s, t| view.pixel(self.direction(s, t));
        let middle = at(0.5, 0.5);
        let reach = [at(0.0, 0.5), at(1.0, 0.5), at(0.5, 0.0), at(0.5, 1.0)]
            .into_iter()
            .filter_map(|p| Some(2.0 * p?.distance(middle?)))
            .fold(1.0, f64::max);
        ((2.0 * reach).ceil() as u32).clamp(2, finest)
    }

    /// Adds (pixel, weight) pairs to `found`; returns the visible part of the texel.
    fn gather(
        &self,
        view: &PlacedView,
        seen: &[f32],
        finest: u32,
        found: &mut Vec<(u32, f32)>,
    ) -> f32 {
        let n = if finest > 2 {
            self.samples_a_side(view, finest)
        } else {
            finest
        };
        let (mut covered, mut total) = (0.0, 0.0);
        for (j, i) in (0..n * n).map(|k| (k / n, k % n)) {
            let at = |k: u32| (f64::from(k) + 0.5) / f64::from(n);
            let direction = self.direction(at(i), at(j));
            // dω = ds dt / (1 + a² + b²)^(3/2), and the largest component of the unit
            // vector is (1 + a² + b²)^(−1/2).
            let weight = direction.abs().max_element().powi(3) as f32;
            total += weight;
            if let Some(pixel) = view.pixel(direction) {
                covered += spread(pixel, weight, view.size(), seen, found);
            }
        }
        covered / total
    }
}

/// Distributes a sample over the four pixels around it; returns the weight on visible ones.
fn spread(
    pixel: DVec2,
    weight: f32,
    (width, height): (u32, u32),
    seen: &[f32],
    found: &mut Vec<(u32, f32)>,
) -> f32 {
    let base = pixel.floor();
    let (fx, fy) = ((pixel.x - base.x) as f32, (pixel.y - base.y) as f32);
    let mut fallen = 0.0;
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let (x, y) = (base.x as i64 + dx, base.y as i64 + dy);
        if x < 0 || y < 0 || x >= i64::from(width) || y >= i64::from(height) {
            continue;
        }
        let i = y as usize * width as usize + x as usize;
        let share = |d: i64, f: f32| if d == 0 { 1.0 - f } else { f };
        let part = weight * share(dx, fx) * share(dy, fy);
        if part > 0.0 && seen.get(i).is_some_and(|&w| w > 0.0) {
            found.push((i as u32, part));
            fallen += part;
        }
    }
    fallen
}

/// Fills every texel from coarser and coarser means of the visible texels around it (pull–push,
/// Gortler et al. 1996).
#[must_use]
pub fn inpaint(size: u32, texels: &[Vec3], coverage: &[f32], grid: &CubeGrid) -> Vec<Vec3> {
    let n = size as usize;
    let mut pyramid = vec![
        texels
            .iter()
            .zip(coverage)
            .zip(&grid.solid_angles)
            .map(|((t, c), w)| (*t * (c * w), c * w))
            .collect::<Vec<_>>(),
    ];
    let mut side = n;
    while side > 1 {
        let fine = &pyramid[pyramid.len() - 1];
        pyramid.push(pull(side, fine));
        side /= 2;
    }
    let all = pyramid[pyramid.len() - 1]
        .iter()
        .fold((Vec3::ZERO, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
    let mut filled = vec![mean(all, Vec3::ZERO); 6];
    for level in pyramid.iter().rev() {
        let side = ((level.len() / 6) as f64).sqrt() as usize;
        filled = push(side, level, &filled);
    }
    filled
}

fn mean((sum, weight): (Vec3, f32), otherwise: Vec3) -> Vec3 {
    if weight > 1e-9 {
        sum / weight
    } else {
        otherwise
    }
}

fn pull(side: usize, fine: &[(Vec3, f32)]) -> Vec<(Vec3, f32)> {
    let half = side / 2;
    (0..6 * half * half)
        .map(|i| {
            let (face, y, x) = (i / (half * half), i / half % half, i % half);
            let at = |dy: usize, dx: usize| fine[(face * side + 2 * y + dy) * side + 2 * x + dx];
            [at(0, 0), at(0, 1), at(1, 0), at(1, 1)]
                .into_iter()
                .fold((Vec3::ZERO, 0.0), |a, b| (a.0 + b.0, a.1 + b.1))
        })
        .collect()
}

fn push(side: usize, level: &[(Vec3, f32)], coarse: &[Vec3]) -> Vec<Vec3> {
    let half = (side / 2).max(1);
    level
        .iter()
        .enumerate()
        .map(|(i, cell)| {
            let (face, y, x) = (i / (side * side), i / side % side, i % side);
            let (cy, cx) = if side > 1 { (y / 2, x / 2) } else { (0, 0) };
            mean(*cell, coarse[(face * half + cy) * half + cx])
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_camera::{EnvironmentView, FisheyeLens};
    use penumbra_interface::RigidTransform;

    pub(super) fn fisheye() -> PlacedView {
        let view = EnvironmentView::Fisheye {
            lens: FisheyeLens {
                width: 480,
                height: 480,
                focal: 151.0,
                centre: DVec2::new(241.2, 238.6),
                distortion: [0.0; 4],
                max_theta: std::f64::consts::FRAC_PI_2,
            },
            world_from_camera: RigidTransform::IDENTITY,
        };
        PlacedView::new(&view, None, None).unwrap()
    }

    #[test]
    fn pixels_cover_the_hemisphere_once() {
        let pixels = PixelDirections::new(&fisheye(), None);
        let sum: f64 = pixels.solid_angles.iter().map(|&w| f64::from(w)).sum();
        // Pixels cut by the rim are excluded: half a pixel of 237.
        assert!(
            (sum / (2.0 * std::f64::consts::PI) - 1.0).abs() < 0.006,
            "{sum}"
        );
    }

    #[test]
    fn source_of_one_pixel_keeps_its_energy() {
        let view = fisheye();
        let pixels = PixelDirections::new(&view, None);
        let table = GatherTable::new(&view, &pixels.solid_angles, 64, 24);
        let grid = CubeGrid::new(64);
        let mut texels = Vec::new();
        for (x, y) in [
            (241, 238),
            (100, 160),
            (300, 411),
            (250, 20),
            (133, 131),
            (390, 200),
        ] {
            let i = y * 480 + x;
            let mut picture = vec![Vec3::ZERO; 480 * 480];
            picture[i] = Vec3::ONE;
            table.apply(&picture, &mut texels);
            let energy: f32 = texels
                .iter()
                .zip(&grid.solid_angles)
                .map(|(l, w)| l.x * w)
                .sum();
            let ratio = energy / pixels.solid_angles[i];
            assert!((ratio - 1.0).abs() < 0.01, "({x}, {y}): {ratio}");
        }
    }

    #[test]
    fn constant_is_preserved_and_holes_are_filled() {
        let view = fisheye();
        let hidden = |_: DVec3, d: DVec3| d.x > 0.5;
        let pixels = PixelDirections::new(&view, Some(&hidden));
        let table = GatherTable::new(&view, &pixels.solid_angles, 16, 24);
        let mut texels = Vec::new();
        table.apply(&vec![Vec3::splat(0.7); 480 * 480], &mut texels);
        let texels = inpaint(16, &texels, &table.coverage, &CubeGrid::new(16));
        assert!(texels.iter().all(|t| (t.x - 0.7).abs() < 1e-4));
        let right = super::super::cube::texel_of(16, Vec3::X + Vec3::Z * 0.2);
        assert!(table.coverage[right] < 0.01);
    }
}
