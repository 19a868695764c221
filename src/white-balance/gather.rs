//! Finds surfaces that both cameras see, and averages them in both pictures.

use super::chart::Photograph;
use super::view::{EnvironmentRay, environment_ray, mirror, picture_size};
use glam::{DVec2, DVec3};
use penumbra_camera::EnvironmentView;
use penumbra_camera::PinholeCamera;
use penumbra_camera::Vignetting;
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use penumbra_scene::{Hit, RayCaster};

/// One patch of a real surface in both pictures, linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhotometricPair {
    /// Mean in the scene camera's picture.
    pub scene: DVec3,
    /// Mean in the environment camera's picture, divided by the mirror's reflectance.
    pub environment: DVec3,
    /// Expected variance of ln(scene / environment); infinite where a channel is clipped
    /// or too dark in either picture.
    pub variance: DVec3,
    /// Neighbours on one surface share a cluster: their errors are correlated.
    pub cluster: u32,
}

/// Both pictures of one instant, the cameras and their poses.
#[derive(Clone, Copy, Debug)]
pub struct Overlap<'a> {
    /// The scene camera's picture.
    pub scene: Photograph<'a>,
    /// The scene camera.
    pub scene_camera: &'a PinholeCamera,
    /// The scene camera's pose.
    pub world_from_scene_camera: RigidTransform,
    /// The environment camera's picture at its base exposure.
    pub environment: Photograph<'a>,
    /// Geometry of the environment camera's view.
    pub environment_view: &'a EnvironmentView,
    /// Vignetting of the scene and the environment camera.
    pub vignetting: [Option<Vignetting>; 2],
}

/// Density of the patches and expected errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GatherOptions {
    /// Distance between blocks, pixels of the environment picture.
    pub spacing: u32,
    /// Side of a block, pixels of the environment picture; odd.
    pub block: u32,
    /// Side of a cluster, pixels of the scene picture.
    pub cluster: u32,
    /// Standard deviation of both cameras' noise at black, linear (1 = full scale).
    pub noise: f64,
    /// Standard deviation of the shift of a patch between the pictures, in sides of the patch.
    pub misregistration: f64,
}

impl Default for GatherOptions {
    fn default() -> Self {
        Self {
            spacing: 6,
            block: 5,
            cluster: 48,
            noise: 0.003,
            misregistration: 0.3,
        }
    }
}

/// Lowest code that counts as clipped (JPEG smears 255 a little).
const SATURATED: u8 = 248;
/// Minimum ratio of a mean to a pixel's standard deviation; below it, clipping at black biases the
/// mean.
const MIN_SIGNAL_TO_NOISE: f64 = 2.5;
/// Minimum cosine between a surface's normal and either view.
const MIN_COSINE: f64 = 0.12;
/// Relative difference of a patch's radiance between two views: no surface is perfectly matt.
const MATTNESS: f64 = 0.02;
/// Maximum ratio of standard deviation to mean within a patch; beyond it, the patch contains an
/// edge.
const MAX_CONTRAST: f64 = 0.4;

/// Returns the patches of real surfaces (ground and phantoms, in `caster`) that both cameras see,
/// unclipped and away from edges; none where a picture's size differs from its camera's.
pub fn gather_pairs(
    overlap: &Overlap,
    caster: &RayCaster,
    options: &GatherOptions,
) -> Vec<PhotometricPair> {
    let picture = overlap.environment.picture;
    let size = (picture.width, picture.height);
    if picture_size(overlap.environment_view) != Some(size) || !has_scene_size(overlap) {
        return Vec::new();
    }
    // A block has a middle pixel.
    let options = &GatherOptions {
        block: options.block | 1,
        ..*options
    };
    let margin = options.block / 2 + 1;
    let steps = |length: u32| (margin..length.saturating_sub(margin)).step_by(step(options));
    steps(size.1)
        .flat_map(|y| steps(size.0).map(move |x| (x, y)))
        .filter_map(|(x, y)| pair_at(overlap, caster, options, x, y))
        .collect()
}

fn step(options: &GatherOptions) -> usize {
    options.spacing.max(1) as usize
}

fn has_scene_size(overlap: &Overlap) -> bool {
    let (picture, camera) = (overlap.scene.picture, overlap.scene_camera);
    (picture.width, picture.height) == (camera.width, camera.height)
}

fn pair_at(
    overlap: &Overlap,
    caster: &RayCaster,
    options: &GatherOptions,
    x: u32,
    y: u32,
) -> Option<PhotometricPair> {
    let quad = Quad::trace(overlap, caster, options, x, y)?;
    let here = DVec2::new(f64::from(x), f64::from(y));
    let environment = read_block(overlap.environment, options.block, x, y);
    let scene = read_quad(overlap.scene, &quad);
    let variance = DVec3::from_array([0, 1, 2].map(|c| {
        let channels = (&scene.0[c], &environment.0[c]);
        variance_of_log_ratio(channels.0, channels.1, options)
    }));
    let centre = quad.centre() / f64::from(options.cluster.max(1));
    let cell = (centre.y as u32) * 512 + centre.x as u32;
    variance
        .cmplt(DVec3::INFINITY)
        .any()
        .then(|| PhotometricPair {
            scene: scene.means() / sensitivity(overlap.vignetting[0], quad.centre()),
            environment: environment.means()
                / (quad.attenuation * sensitivity(overlap.vignetting[1], here)),
            variance,
            cluster: cell ^ quad.surface.wrapping_mul(0x9E37_79B1),
        })
}

/// Relative sensitivity of a camera at a pixel, 1 in the centre.
fn sensitivity(vignetting: Option<Vignetting>, pixel: DVec2) -> f64 {
    vignetting.map_or(1.0, |v| v.at(pixel))
}

fn variance_of_log_ratio(scene: &Channel, environment: &Channel, options: &GatherOptions) -> f64 {
    let one = |channel: &Channel| {
        let noise = options.noise.hypot(channel.step);
        let contrast = channel.contrast(noise);
        if channel.clipped || channel.mean < MIN_SIGNAL_TO_NOISE * noise || contrast > MAX_CONTRAST
        {
            return f64::INFINITY;
        }
        let relative = noise / channel.mean;
        relative * relative / channel.independent + (options.misregistration * contrast).powi(2)
    };
    one(scene) + one(environment) + MATTNESS * MATTNESS
}

/// The scene camera's view of the surface that a block of environment pixels shows.
struct Quad {
    /// Pixels, in the order top left, top right, bottom left, bottom right of the block.
    corners: [DVec2; 4],
    surface: u32,
    attenuation: DVec3,
}

/// Maximum length of a quad's diagonal, pixels of the scene picture.
const MAX_QUAD: f64 = 80.0;

impl Quad {
    fn trace(
        overlap: &Overlap,
        caster: &RayCaster,
        options: &GatherOptions,
        x: u32,
        y: u32,
    ) -> Option<Self> {
        let centre = DVec2::new(f64::from(x), f64::from(y));
        let (middle, ray) = surface_at(overlap, caster, centre)?;
        let mut corners = [DVec2::ZERO; 4];
        let offsets = [(-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)];
        for (corner, (dx, dy)) in corners.iter_mut().zip(offsets) {
            let offset = f64::from(options.block) * DVec2::new(dx, dy);
            let (hit, corner_ray) = surface_at(overlap, caster, centre + offset)?;
            let same = hit.surface == middle.surface && hit.normal.dot(middle.normal) > 0.95;
            if !same || corner_ray.mirrored != ray.mirrored {
                return None;
            }
            *corner = project_to_scene_camera(overlap, caster, &hit)?;
        }
        let quad = Self {
            corners,
            surface: middle.surface,
            attenuation: ray.attenuation,
        };
        (quad.extent() <= MAX_QUAD).then_some(quad)
    }

    fn centre(&self) -> DVec2 {
        0.25 * self.corners.iter().sum::<DVec2>()
    }

    /// Length of the longer diagonal.
    fn extent(&self) -> f64 {
        let [a, b, c, d] = self.corners;
        a.distance(d).max(b.distance(c))
    }

    /// The pixel at `u`, `v` in 0..=1 of the block.
    fn at(&self, u: f64, v: f64) -> DVec2 {
        let [a, b, c, d] = self.corners;
        a.lerp(b, u).lerp(c.lerp(d, u), v)
    }
}

/// The surface point that a pixel of the environment camera shows, unless it is a mirror or seen
/// too obliquely.
fn surface_at(
    overlap: &Overlap,
    caster: &RayCaster,
    pixel: DVec2,
) -> Option<(Hit, EnvironmentRay)> {
    let ray = environment_ray(overlap.environment_view, pixel)?;
    let hit = caster.nearest(ray.origin, ray.direction)?;
    let facing = -hit.normal.dot(ray.direction) > MIN_COSINE;
    (facing && !hit.mirror).then_some((hit, ray))
}

/// Pixel of a surface point in the scene picture; `None` where it is hidden or outside.
fn project_to_scene_camera(overlap: &Overlap, caster: &RayCaster, hit: &Hit) -> Option<DVec2> {
    let world_from_camera = overlap.world_from_scene_camera;
    let eye = world_from_camera.translation;
    let (direction, distance) = (hit.point - eye).normalize_and_length();
    let first = caster.nearest(eye, direction)?;
    let hidden = first.distance < distance - (0.002 + 0.005 * distance);
    let facing = -hit.normal.dot(direction) > MIN_COSINE;
    if hidden || !facing || is_behind_mirror(overlap, eye, direction, distance) {
        return None;
    }
    let in_camera = world_from_camera.inverse().transform_point(hit.point);
    let pixel = overlap.scene_camera.project(in_camera)?;
    let inside = |p: f64, size: u32| p >= 2.0 && p <= f64::from(size) - 3.0;
    let camera = overlap.scene_camera;
    (inside(pixel.x, camera.width) && inside(pixel.y, camera.height)).then_some(pixel)
}

/// Whether the mirrored sphere or its stand hides a point at `distance` metres.
fn is_behind_mirror(overlap: &Overlap, eye: DVec3, direction: DVec3, distance: f64) -> bool {
    mirror(overlap.environment_view).is_some_and(|sphere| {
        let to_centre = sphere.centre_in_world - eye;
        let near = to_centre.dot(direction) < distance + sphere.radius;
        near && to_centre.cross(direction).length() < 1.1 * sphere.radius
    })
}

/// Statistics of a patch in one picture.
struct Reading([Channel; 3]);

#[derive(Clone, Copy, Debug, Default)]
struct Channel {
    mean: f64,
    variance: f64,
    /// Standard deviation of quantisation, linear.
    step: f64,
    /// Number of pixels with independent noise.
    independent: f64,
    clipped: bool,
}

impl Reading {
    fn means(&self) -> DVec3 {
        DVec3::from_array([0, 1, 2].map(|c| self.0[c].mean))
    }
}

impl Channel {
    /// Ratio of the standard deviation that noise does not explain to the mean.
    fn contrast(&self, noise: f64) -> f64 {
        (self.variance - noise * noise).max(0.0).sqrt() / self.mean.max(1e-9)
    }
}

fn read_block(photograph: Photograph, block: u32, x: u32, y: u32) -> Reading {
    let half = block / 2;
    let rows = (y - half)..=(y + half);
    let codes = rows
        .flat_map(|v| ((x - half)..=(x + half)).map(move |u| (u, v)))
        .map(|(u, v)| photograph.picture.rgb(u, v));
    summarise(photograph, codes, f64::INFINITY)
}

/// Samples the quad on a regular grid, at the nearest pixels.
fn read_quad(photograph: Photograph, quad: &Quad) -> Reading {
    let [a, b, c, d] = quad.corners;
    let width = a.distance(b).max(c.distance(d));
    let height = a.distance(c).max(b.distance(d));
    let count = |length: f64| length.ceil().clamp(2.0, 12.0) as u32;
    let (columns, rows) = (count(width), count(height));
    let area = 0.5 * (d - a).perp_dot(c - b).abs();
    let codes = (0..rows).flat_map(|j| (0..columns).map(move |i| (i, j)));
    let codes = codes.map(|(i, j)| {
        let u = (f64::from(i) + 0.5) / f64::from(columns);
        let v = (f64::from(j) + 0.5) / f64::from(rows);
        nearest(photograph.picture, quad.at(u, v))
    });
    summarise(photograph, codes, area.max(1.0))
}

fn nearest(picture: &Picture, pixel: DVec2) -> [u8; 3] {
    let clamp = |p: f64, size: u32| (p.round().max(0.0) as u32).min(size.saturating_sub(1));
    picture.rgb(
        clamp(pixel.x, picture.width),
        clamp(pixel.y, picture.height),
    )
}

/// Averages pixels. `max_pixels` limits the number of independent pixels.
fn summarise(
    photograph: Photograph,
    codes: impl Iterator<Item = [u8; 3]>,
    max_pixels: f64,
) -> Reading {
    let table = photograph.response.linear_from_code();
    let mut channels = [Channel::default(); 3];
    let mut count = 0.0;
    for rgb in codes {
        count += 1.0;
        for (channel, code) in channels.iter_mut().zip(rgb) {
            let linear = f64::from(table[usize::from(code)]);
            channel.mean += linear;
            channel.variance += linear * linear;
            channel.clipped |= code >= SATURATED;
        }
    }
    for channel in &mut channels {
        channel.mean /= count;
        channel.variance = (channel.variance / count - channel.mean * channel.mean).max(0.0);
        let code = photograph.response.code_from_linear(channel.mean as f32);
        channel.step = f64::from(photograph.response.step(code)) / 12f64.sqrt();
        // JPEG shares chroma among 2×2 pixels, so a quarter of them have independent errors.
        channel.independent = (0.25 * count.min(max_pixels)).max(1.0);
    }
    Reading(channels)
}

#[cfg(test)]
mod tests;
