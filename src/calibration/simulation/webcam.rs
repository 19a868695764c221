//! A simulated webcam before the printed sheet and the ball of [`crate::webcam_sheet`]: one ray for
//! each sample, a mirror, a room of known radiance, and the shadow of the ball.

use super::motion::{Hand, Motion};
use crate::webcam_sheet::{WebcamSheet, assumed_lens};
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_numerics::{Random, smoothstep};
use penumbra_picture::Picture;

/// Dots per inch of the simulated print.
const DPI: u32 = 150;
/// Reflectances of paper, ink and table.
const PAPER: f32 = 0.8;
const INK: f32 = 0.04;
const TABLE: [f32; 3] = [0.32, 0.22, 0.14];
/// Linear value of sunlit paper in the picture.
const PAPER_VALUE: f32 = 0.6;
/// Directions of the sky along each axis of the grid that lights the table.
const SKY: usize = 24;
/// Distance of the points at which the shadow is computed, metres, and their number along an axis.
const SHADOW_STEP: f64 = 0.004;
const SHADOW_POINTS: usize = 128;
/// Standard deviation of the noise, codes.
const NOISE: f64 = 1.5;
/// Samples along each side of a pixel.
const SAMPLES: u32 = 2;
/// Distance of the camera from the sheet, metres.
const DISTANCE: f64 = 0.55;

/// The lamp, a disc of this angular radius, and the window: their true directions are what the
/// estimated light is compared with.
pub const LAMP: DVec3 = DVec3::new(0.35, 0.45, 0.82);
const LAMP_RADIUS: f64 = 0.12;
const LAMP_RADIANCE: [f32; 3] = [60.0, 52.0, 40.0];
const WINDOW_RADIANCE: [f32; 3] = [6.0, 7.0, 8.0];

/// Light and direction of a part of the room.
struct Part {
    direction: DVec3,
    /// Radiance × solid angle × cosine.
    irradiance: Vec3,
}

/// A webcam that is moved around the sheet.
pub struct SimulatedWebcam {
    lens: PinholeCamera,
    /// Unit rays of the samples of each pixel, row by row.
    rays: Vec<DVec3>,
    sheet: WebcamSheet,
    /// Grey values of the print, and its width and height.
    print: (Vec<u8>, u32, u32),
    /// Centre and radius of the ball; `None` without a ball.
    ball: Option<(DVec3, f64)>,
    hand: Hand,
    /// Irradiance of the table around the ball.
    shadow: Vec<Vec3>,
    /// Irradiance of the table far from the ball.
    open: Vec3,
}

impl SimulatedWebcam {
    /// Creates a webcam with this lens. The ball lies `off` metres from the middle of its place;
    /// without `off` there is none.
    #[must_use]
    pub fn new(lens: &PinholeCamera, sheet: WebcamSheet, off: Option<DVec2>, seed: u64) -> Self {
        let (centre, radius) = sheet.ball();
        let print = sheet.sheet().raster(DPI).unwrap_or_default();
        let mut random = Random::new(seed);
        let ball = off.map(|off| (centre + off.extend(0.0), radius));
        let sky = sky();
        let open: Vec3 = sky.iter().map(|part| part.irradiance).sum();
        Self {
            lens: lens.clone(),
            rays: rays(lens),
            print,
            ball,
            hand: Hand::new(Motion::Free, sheet.middle(), DISTANCE, &mut random),
            shadow: ball.map_or_else(Vec::new, |ball| shadow(ball, &sky)),
            open,
            sheet,
        }
    }

    /// Creates a webcam with a lens that an owner does not know: 60° across, a little distorted, its
    /// axis beside the picture's middle. The ball lies 2 mm beside the middle of its place.
    #[must_use]
    pub fn of_typical_lens(size: (u32, u32), sheet: WebcamSheet, seed: u64) -> Self {
        let assumed = assumed_lens(size, 60_f64.to_radians());
        let width = f64::from(size.0);
        let lens = PinholeCamera {
            centre: assumed.centre + DVec2::new(0.008, -0.006) * width,
            distortion: [0.06, -0.11, 0.0004, -0.0003, 0.0],
            ..assumed
        };
        Self::new(&lens, sheet, Some(DVec2::new(0.0018, -0.001)), seed)
    }

    /// Returns its lens.
    #[must_use]
    pub const fn lens(&self) -> &PinholeCamera {
        &self.lens
    }

    /// Returns the `rig.json` of a rig with its lens, without the lens's distortion.
    #[must_use]
    pub fn rig_json(&self) -> serde_json::Value {
        self.sheet.rig_json(&self.lens)
    }

    /// Returns `world_from_camera` at `seconds`.
    #[must_use]
    pub fn pose(&self, seconds: f64) -> RigidTransform {
        self.hand.at(0.4 * seconds)
    }

    /// Returns the ball's centre, world, and its radius, metres.
    #[must_use]
    pub const fn ball(&self) -> Option<(DVec3, f64)> {
        self.ball
    }

    /// Renders the picture at a pose, with the noise of a webcam; `brightness` scales its light.
    #[must_use]
    pub fn picture(&self, pose: RigidTransform, brightness: f32, random: &mut Random) -> Picture {
        let (width, height) = (self.lens.width, self.lens.height);
        let response = Response::srgb();
        let exposure = brightness * PAPER_VALUE * std::f32::consts::PI / (PAPER * self.open.y);
        let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
        for rays in self.rays.chunks_exact((SAMPLES * SAMPLES) as usize) {
            let linear = exposure * self.pixel(pose, rays);
            for value in linear.to_array() {
                let code = f64::from(response.encoded_from_linear(value.clamp(0.0, 1.0)));
                // What is clipped has no noise: the sensor is full.
                let noise = f64::from(u8::from(value < 1.0)) * NOISE * nearly_normal(random);
                let noisy = 255.0 * code + noise;
                rgba.push(noisy.round().clamp(0.0, 255.0) as u8);
            }
            rgba.push(255);
        }
        Picture {
            width,
            height,
            rgba,
        }
    }

    /// Returns the mean radiance of a pixel's rays.
    fn pixel(&self, pose: RigidTransform, rays: &[DVec3]) -> Vec3 {
        let seen = |ray: &DVec3| self.radiance(pose.translation, pose.rotation * *ray);
        rays.iter().map(seen).sum::<Vec3>() / rays.len() as f32
    }

    /// Returns the radiance that arrives from `ray` at `origin`.
    fn radiance(&self, origin: DVec3, ray: DVec3) -> Vec3 {
        if let Some((centre, radius)) = self.ball
            && let Some(t) = sphere_hit(origin, ray, centre, radius)
        {
            let point = origin + ray * t;
            let normal = (point - centre) / radius;
            let mirrored = ray - 2.0 * ray.dot(normal) * normal;
            return 0.85 * self.beside_ball(point, mirrored);
        }
        self.beside_ball(origin, ray)
    }

    /// Returns the radiance of table and room.
    fn beside_ball(&self, origin: DVec3, ray: DVec3) -> Vec3 {
        if ray.z >= -1e-6 {
            return room(ray);
        }
        let point = origin + ray * (-origin.z / ray.z);
        self.reflectance(point) * self.irradiance(point) * std::f32::consts::FRAC_1_PI
    }

    fn reflectance(&self, point: DVec3) -> Vec3 {
        let (pixels, width, height) = &self.print;
        let from_middle = (point - self.sheet.middle()) / self.sheet.scale();
        let dots = f64::from(DPI) / 0.0254;
        let (w, h) = (f64::from(*width), f64::from(*height));
        let (x, y) = (
            from_middle.x * dots + 0.5 * w,
            0.5 * h - from_middle.y * dots,
        );
        if !(0.0..w).contains(&x) || !(0.0..h).contains(&y) {
            let grain =
                ((point.x * 90.0).sin() * (point.y * 13.0 + (point.x * 31.0).sin()).sin()) as f32;
            return Vec3::from(TABLE) * (1.0 + 0.15 * grain);
        }
        let grey = pixels.get(y as usize * *width as usize + x as usize);
        let share = f32::from(grey.copied().unwrap_or(255)) / 255.0;
        Vec3::splat(INK + (PAPER - INK) * share)
    }

    fn irradiance(&self, point: DVec3) -> Vec3 {
        let Some((centre, _)) = self.ball else {
            return self.open;
        };
        let at = (point - centre).truncate() / SHADOW_STEP + 0.5 * SHADOW_POINTS as f64;
        let base = at.floor();
        let last = (SHADOW_POINTS - 2) as f64;
        if base.min_element() < 0.0 || base.max_element() > last {
            return self.open;
        }
        let (x, y, f) = (base.x as usize, base.y as usize, (at - base).as_vec2());
        let value = |x: usize, y: usize| self.shadow[y * SHADOW_POINTS + x];
        let row = |y: usize| value(x, y).lerp(value(x + 1, y), f.x);
        row(y).lerp(row(y + 1), f.y)
    }
}

/// Returns the rays of all samples of all pixels.
fn rays(lens: &PinholeCamera) -> Vec<DVec3> {
    let step = 1.0 / f64::from(SAMPLES);
    let pixels = (0..lens.height).flat_map(|y| (0..lens.width).map(move |x| (x, y)));
    let samples = pixels.flat_map(|(x, y)| {
        (0..SAMPLES * SAMPLES).map(move |k| {
            let within = DVec2::new(f64::from(k % SAMPLES), f64::from(k / SAMPLES)) + 0.5;
            DVec2::new(f64::from(x), f64::from(y)) + within * step - 0.5
        })
    });
    samples.map(|pixel| lens.unproject(pixel)).collect()
}

/// Returns a random number of mean 0 and variance 1: a sum of uniform ones, which is cheap.
fn nearly_normal(random: &mut Random) -> f64 {
    3_f64.sqrt() * ((0..4).map(|_| random.uniform()).sum::<f64>() - 2.0)
}

/// Returns the radiance of the room in a direction.
fn room(direction: DVec3) -> Vec3 {
    let d = direction.normalize();
    if d.dot(LAMP.normalize()) > LAMP_RADIUS.cos() {
        return Vec3::from(LAMP_RADIANCE);
    }
    let azimuth = d.y.atan2(d.x);
    let is_window = (2.2..2.9).contains(&azimuth) && (0.25..0.7).contains(&d.z);
    if is_window {
        return Vec3::from(WINDOW_RADIANCE);
    }
    let ceiling = smoothstep(0.55, 0.75, d.z) as f32;
    let stripes = 0.5 + 0.5 * (6.0 * azimuth).sin() as f32;
    let wall = Vec3::new(0.5, 0.42, 0.36) * (0.6 + 0.4 * stripes);
    wall.lerp(Vec3::new(0.9, 0.9, 0.88), ceiling)
}

/// Returns the parts of the room above the table, equal in projected solid angle, with the lamp
/// sampled separately.
fn sky() -> Vec<Part> {
    let share = std::f32::consts::PI / (SKY * SKY) as f32;
    let grid = (0..SKY * SKY).map(|i| {
        let (u, v) = ((i % SKY) as f64 + 0.5, (i / SKY) as f64 + 0.5);
        let radius = (u / SKY as f64).sqrt();
        let (sin, cos) = (std::f64::consts::TAU * v / SKY as f64).sin_cos();
        DVec3::new(radius * cos, radius * sin, (1.0 - radius * radius).sqrt())
    });
    let lamp = LAMP.normalize();
    let mut parts: Vec<Part> = grid
        .filter(|d| d.dot(lamp) < LAMP_RADIUS.cos())
        .map(|direction| Part {
            direction,
            irradiance: room(direction) * share,
        })
        .collect();
    let (u, v) = lamp.any_orthonormal_pair();
    let solid_angle = std::f64::consts::TAU * (1.0 - LAMP_RADIUS.cos());
    const RAYS: u32 = 32;
    for i in 0..RAYS {
        // A spiral of equal areas.
        let radius = LAMP_RADIUS * ((f64::from(i) + 0.5) / f64::from(RAYS)).sqrt();
        let (sin, cos) = (2.399_963 * f64::from(i)).sin_cos();
        let direction = (lamp + (u * cos + v * sin) * radius.tan()).normalize();
        let weight = (solid_angle * lamp.z / f64::from(RAYS)) as f32;
        parts.push(Part {
            direction,
            irradiance: Vec3::from(LAMP_RADIANCE) * weight,
        });
    }
    parts
}

/// Returns the irradiance of a grid of points around the ball, where it hides parts of the sky.
fn shadow((centre, radius): (DVec3, f64), sky: &[Part]) -> Vec<Vec3> {
    let points = (0..SHADOW_POINTS * SHADOW_POINTS).map(|i| {
        let (x, y) = ((i % SHADOW_POINTS) as f64, (i / SHADOW_POINTS) as f64);
        let from_middle = (DVec2::new(x, y) - 0.5 * SHADOW_POINTS as f64) * SHADOW_STEP;
        (centre.truncate() + from_middle).extend(0.0)
    });
    points
        .map(|point| {
            let is_open =
                |part: &&Part| sphere_hit(point, part.direction, centre, radius).is_none();
            sky.iter().filter(is_open).map(|part| part.irradiance).sum()
        })
        .collect()
}

/// Returns the distance at which a unit ray enters a sphere in front of its origin.
fn sphere_hit(origin: DVec3, ray: DVec3, centre: DVec3, radius: f64) -> Option<f64> {
    let to_centre = centre - origin;
    let along = to_centre.dot(ray);
    let beside = to_centre.length_squared() - along * along;
    let inside = radius * radius - beside;
    (along > 0.0 && inside > 0.0).then(|| along - inside.sqrt())
}
