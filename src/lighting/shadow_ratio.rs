//! Estimates the brightness of a clipped source from the darkness of the shadows in the scene
//! camera's own picture.
//!
//! ```text
//!  A point p of the ground has the radiance I(p) = ρ(p)/π (a(p) + f b(p)): a is the irradiance
//!  by the unclipped part of the sphere's picture, b that by its clipped part at the clipped
//!  value, both without the directions that the phantoms hide from p (for which a includes the
//!  light reflected by the phantoms), and f is the ratio of the clipped source's true brightness
//!  to the clipped value. The reflectance ρ is unknown, but where it is independent of the
//!  shadows, the correct f minimises their traces in
//!      ln I(p) − ln (a(p) + f b(p)),
//!  measured with a loss that a marker or a seam in the wood cannot dominate.
//! ```

use super::cube::texel_of;
use super::resample::{Hidden, PixelDirections};
use super::sources::LUMINANCE;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::PinholeCamera;
use penumbra_camera::PlacedView;
use penumbra_interface::RigidTransform;

/// Pixels between the sampled points of the ground.
const STEP: u32 = 8;
/// Cells along a side of a cube face into which the light is summed.
const CELLS: u32 = 4;
/// Maximum number of clipped directions that are traced individually.
const MAX_CLIPPED_DIRECTIONS: usize = 24;
/// Minimum scale of the loss: the typical standard deviation of ln ρ of one surface.
const MIN_SCALE: f32 = 0.15;
/// Minimum number of points in shadow, and out of it.
const MIN_POINTS: usize = 24;

/// The ground and the objects on it.
pub(super) struct Ground<'a> {
    pub height: f64,
    pub world_from_camera: RigidTransform,
    pub camera: &'a PinholeCamera,
    pub hidden: Option<&'a Hidden<'a>>,
    /// Luminance of the occluders as the scene camera sees it; 0 if unknown.
    pub hider: f32,
}

/// Light from one direction.
struct LightDirection {
    direction: DVec3,
    /// Luminance of the irradiance on the ground.
    irradiance: f32,
    /// The same for a radiance of 1.
    form: f32,
}

/// Irradiance of a point of the ground by unclipped and by clipped light.
struct Point {
    radiance: f32,
    rest: f32,
    clipped: f32,
}

/// Returns the factor f on clipped pixels; `None` if the picture shows too little shadow.
/// `luminance_at` returns the linear luminance of a pixel of the scene picture.
pub(super) fn clipped_factor(
    view: &PlacedView,
    pixels: &PixelDirections,
    radiance: &[Vec3],
    clipped: &[u32],
    ground: &Ground,
    luminance_at: impl Fn(u32, u32) -> Option<f32>,
) -> Option<f32> {
    let (rest, bright) = light_directions(pixels, radiance, clipped);
    let points = points(view, ground, &rest, &bright, luminance_at);
    let max_clipped = points.iter().map(|p| p.clipped).fold(0.0, f32::max);
    let dark = points
        .iter()
        .filter(|p| p.clipped < 0.6 * max_clipped)
        .count();
    if max_clipped <= 0.0 || dark < MIN_POINTS || points.len() - dark < MIN_POINTS {
        return None;
    }
    // 12 factors an octave from 1 to 1024.
    let scale = texture_scale(&points);
    let losses: Vec<f32> = (0..=120).map(|k| loss(&points, factor(k), scale)).collect();
    let (k, min_loss) = losses
        .iter()
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(b.1))?;
    // At either end of the range only a bound is known.
    let inside = k > 0 && k < 120;
    let is_conclusive = losses[0] > 1.02 * min_loss && losses[120] > 1.02 * min_loss;
    (inside && is_conclusive).then(|| factor(k))
}

fn factor(k: usize) -> f32 {
    (k as f32 / 12.0).exp2()
}

/// Sums the picture's light into cells; clipped directions are subsampled evenly.
fn light_directions(
    pixels: &PixelDirections,
    radiance: &[Vec3],
    clipped: &[u32],
) -> (Vec<LightDirection>, Vec<LightDirection>) {
    let energy = |i: usize| {
        let cosine = pixels.directions[i].z.max(0.0) * pixels.solid_angles[i];
        radiance[i].dot(LUMINANCE) * cosine
    };
    let mut cells = vec![(Vec3::ZERO, 0.0f32, 0.0f32); (6 * CELLS * CELLS) as usize];
    for i in (0..radiance.len()).filter(|&i| pixels.solid_angles[i] > 0.0) {
        let e = energy(i);
        let cell = &mut cells[texel_of(CELLS, pixels.directions[i])];
        cell.0 += pixels.directions[i] * e;
        cell.1 += e;
        cell.2 += pixels.directions[i].z.max(0.0) * pixels.solid_angles[i];
    }
    for &i in clipped {
        let (d, e) = (pixels.directions[i as usize], energy(i as usize));
        let cell = &mut cells[texel_of(CELLS, d)];
        cell.0 -= d * e;
        cell.1 -= e;
    }
    let rest = cells
        .into_iter()
        .filter(|c| c.1 > 1e-7)
        .filter_map(|(d, irradiance, form)| {
            let direction = d.try_normalize()?.as_dvec3();
            Some(LightDirection {
                direction,
                irradiance,
                form,
            })
        });
    let stride = clipped.len().div_ceil(MAX_CLIPPED_DIRECTIONS).max(1);
    let bright = clipped.chunks(stride).map(|group| LightDirection {
        direction: pixels.directions[group[group.len() / 2] as usize].as_dvec3(),
        irradiance: group.iter().map(|&i| energy(i as usize)).sum(),
        form: 0.0,
    });
    (rest.collect(), bright.collect())
}

fn points(
    view: &PlacedView,
    ground: &Ground,
    rest: &[LightDirection],
    bright: &[LightDirection],
    luminance_at: impl Fn(u32, u32) -> Option<f32>,
) -> Vec<Point> {
    let (width, height) = (ground.camera.width, ground.camera.height);
    let grid = (STEP..height.saturating_sub(1))
        .step_by(STEP as usize)
        .flat_map(|y| {
            (STEP..width.saturating_sub(1))
                .step_by(STEP as usize)
                .map(move |x| (x, y))
        });
    grid.filter_map(|(x, y)| {
        let at = ground.point(view, DVec2::new(f64::from(x), f64::from(y)))?;
        let radiance = luminance_at(x, y).filter(|l| *l > 0.004)?;
        let arriving = |light: &LightDirection| match ground.blocks(view, at, light.direction) {
            true => ground.hider * light.form,
            false => light.irradiance,
        };
        let sum = |light_directions: &[LightDirection]| {
            light_directions.iter().map(arriving).sum::<f32>()
        };
        Some(Point {
            radiance,
            rest: sum(rest),
            clipped: sum(bright),
        })
    })
    .collect()
}

impl Ground<'_> {
    /// Returns the point of the ground that a pixel shows, if it is near enough to the sphere.
    fn point(&self, view: &PlacedView, pixel: DVec2) -> Option<DVec3> {
        let eye = self.world_from_camera.translation;
        let ray = self.world_from_camera.rotation * self.camera.unproject(pixel);
        let t = (self.height - eye.z) / ray.z;
        let (centre, _) = view.sphere()?;
        let near = t.is_finite() && t > 0.0 && t < 2.0 * centre.distance(eye);
        // A millimetre up, so that the ground does not occlude itself.
        let point = eye + ray * t + DVec3::Z * 1e-3;
        let in_sight = near && !self.blocks(view, eye, ray);
        in_sight.then_some(point)
    }

    fn blocks(&self, view: &PlacedView, origin: DVec3, direction: DVec3) -> bool {
        let ball = view.sphere().is_some_and(|(centre, radius)| {
            let to = centre - origin;
            let along = to.dot(direction);
            along > 0.0 && to.length_squared() - along * along < radius * radius
        });
        ball || self.hidden.is_some_and(|hides| hides(origin, direction))
    }
}

/// Residuals ln I − ln (a + f b) of the lit points and of the others.
fn residuals(points: &[Point], f: f32) -> (Vec<f32>, Vec<f32>) {
    let max_clipped = points.iter().map(|p| p.clipped).fold(0.0, f32::max);
    let of = |p: &Point| p.radiance.ln() - (p.rest + f * p.clipped).max(1e-9).ln();
    let is_lit = |p: &&Point| p.clipped > 0.9 * max_clipped;
    let lit = points.iter().filter(is_lit).map(of).collect();
    let rest = points.iter().filter(|p| !is_lit(p)).map(of).collect();
    (lit, rest)
}

/// Robust scale of ln ρ over the lit points (1.5 MAD): a chequered floor needs a wider loss than a
/// table.
fn texture_scale(points: &[Point]) -> f32 {
    let (mut lit, _) = residuals(points, 4.0);
    let middle = median(&mut lit);
    let mut deviations: Vec<f32> = lit.iter().map(|r| (r - middle).abs()).collect();
    (1.5 * median(&mut deviations)).max(MIN_SCALE)
}

/// In place and in single precision: the order of the values determines the rounding of the sums
/// in [`loss`].
fn median(values: &mut [f32]) -> f32 {
    if values.is_empty() {
        return 0.0;
    }
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}

/// Geman–McClure loss of the shadowed points about the robust mean of the lit ones.
fn loss(points: &[Point], f: f32, scale: f32) -> f32 {
    let (mut lit, shadowed) = residuals(points, f);
    let mut centre = median(&mut lit);
    for _ in 0..8 {
        let (mut sum, mut total) = (0.0, 0.0);
        for r in &lit {
            let x = (r - centre) / scale;
            let weight = 1.0 / (1.0 + x * x).powi(2);
            sum += weight * r;
            total += weight;
        }
        centre = sum / total.max(f32::MIN_POSITIVE);
    }
    let each = shadowed.iter().map(|r| {
        let x2 = ((r - centre) / scale).powi(2);
        x2 / (1.0 + x2)
    });
    each.sum::<f32>() / points.len() as f32
}
