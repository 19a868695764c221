//! Measures the radiance of the real surfaces around the virtual objects in the scene camera's
//! picture.

use crate::light::view::SceneView;
use glam::{DVec2, DVec3, Vec2, Vec3};
use penumbra_camera::Vignetting;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_lighting::{LightKind, Lighting};
use penumbra_numerics::smoothstep;
use penumbra_picture::Picture;
use penumbra_rig_model::RigCalibration;
use penumbra_scene::indirect_light::{AXES, side_of, solid_phantoms};
use penumbra_scene::{GroundBrightness, PhantomRadiance};
use penumbra_scene::{Part, RayCaster, Scene};
use std::f32::consts::PI;
use std::sync::Arc;

/// Measures the radiance of the ground around the virtual objects in the scene camera's picture.
/// It fills the lower hemisphere if the environment camera faces upwards.
pub(crate) struct GroundRadiance {
    /// Height, metres; `None` without a ground.
    height: Option<f32>,
    rays: Arc<RayCaster>,
    camera: PinholeCamera,
    response: Response,
    vignetting: Option<Vignetting>,
    radiance: Option<Vec3>,
    brightness: GroundBrightness,
    /// Number of pictures looked at.
    looks: u32,
    /// Radiance of each cell in the present picture.
    seen: Vec<Option<Vec3>>,
}

/// Cells along a side of the square around the objects, each with a sample point.
const GROUND_POINTS: usize = 24;
/// Weight of a new observation in the exponential moving average.
const GROUND_SHARE: f32 = 0.1;
/// Relative change of the ground's mean radiance up to which it counts as noise, and from which its light has
/// changed, so that the new observation holds in full.
const GROUND_CHANGE: (f32, f32) = (0.02, 0.08);
/// Fewest points in a picture that tell of the ground.
const LEAST_POINTS: usize = 8;
/// Places of the sample points in their cells, one after another: multiples of these modulo 1 fill a square
/// evenly (Roberts 2018, R2), so that the mean over pictures is that of a cell's texture.
const WITHIN_CELL: Vec2 = Vec2::new(0.754_877_7, 0.569_840_3);

/// Weight of the mean radiance `now` against the `old` one.
fn share_of(now: Vec3, old: Vec3) -> f32 {
    let change = (now.element_sum() / old.element_sum().max(1e-6) - 1.0).abs();
    GROUND_SHARE.max(smoothstep(GROUND_CHANGE.0, GROUND_CHANGE.1, change))
}

/// Returns the vignetting factor of a pixel, 1 at the centre.
fn vignetting_at(vignetting: Option<Vignetting>, pixel: DVec2) -> f32 {
    vignetting.map_or(1.0, |v| v.at(pixel) as f32)
}

impl GroundRadiance {
    pub(crate) fn new(rig: &RigCalibration, scene: &Scene, rays: Arc<RayCaster>) -> Self {
        let scene_camera = &rig.scene_camera;
        Self {
            height: scene.ground_height.map(|height| height as f32),
            rays,
            camera: scene_camera.camera.clone(),
            response: scene_camera.response.clone(),
            vignetting: scene_camera.vignetting,
            radiance: None,
            brightness: cells_around(scene),
            looks: 0,
            seen: Vec::new(),
        }
    }

    /// Continues from the measurement of `before`.
    pub(crate) fn follow(&mut self, before: &Self) {
        self.radiance = before.radiance;
        let cells = 0..self.brightness.cells.len();
        let known = cells.map(|i| before.brightness.known_at(self.place(i, Vec2::splat(0.5))));
        self.brightness.cells = known.collect();
    }

    pub(crate) fn look(&mut self, scene: &SceneView<'_>) {
        let Some(pose) = scene.world_from_camera else {
            return;
        };
        self.camera.clone_from(scene.camera);
        let camera_from_world = pose.inverse();
        let Some(height) = self.height else {
            return;
        };
        let within = (WITHIN_CELL * self.looks as f32 + 0.5).fract();
        self.looks = (self.looks + 1) % 4096;
        let mut seen = std::mem::take(&mut self.seen);
        seen.clear();
        seen.extend((0..self.brightness.cells.len()).map(|i| {
            let point = self.place(i, within).extend(height);
            self.colour(point, pose, camera_from_world, scene.picture)
        }));
        self.note(&seen);
        self.seen = seen;
    }

    /// A place in a cell, `within` it from 0 to 1; world, metres.
    fn place(&self, cell: usize, within: Vec2) -> Vec2 {
        let GroundBrightness {
            low, edge, side, ..
        } = self.brightness;
        let cell = Vec2::new((cell % side) as f32, (cell / side) as f32);
        low + (cell + within) * (edge / side as f32)
    }

    /// Adds the radiance of cells in one picture. Which of them it shows does not matter: each counts as bright
    /// as it is known to be.
    fn note(&mut self, seen: &[Option<Vec3>]) {
        let count = seen.iter().flatten().count();
        if count < LEAST_POINTS {
            return;
        }
        let known = self.brightness.cells.iter().zip(seen);
        let both: Vec<(Vec3, Vec3)> = known.filter_map(|(k, s)| k.zip(*s)).collect();
        let now = if both.len() < LEAST_POINTS {
            seen.iter().flatten().sum::<Vec3>() / count as f32
        } else {
            let (known, seen) = both.iter().fold((Vec3::ZERO, Vec3::ZERO), |(k, s), both| {
                (k + both.0, s + both.1)
            });
            seen / known.max(Vec3::splat(1e-6))
        };
        let follow = |old: Vec3| old.lerp(now, share_of(now, old));
        self.radiance = Some(self.radiance.map_or(now, follow));
        let per_mean = 1.0 / now.max(Vec3::splat(1e-6));
        for (known, seen) in self.brightness.cells.iter_mut().zip(seen) {
            let seen = seen.map(|seen| seen * per_mean);
            *known = match (*known, seen) {
                (Some(known), Some(seen)) => Some(known.lerp(seen, GROUND_SHARE)),
                (known, seen) => known.or(seen),
            };
        }
        self.normalise();
    }

    /// Makes the mean brightness of all known cells 1.
    fn normalise(&mut self) {
        let known = || self.brightness.cells.iter().flatten();
        let mean = known().sum::<Vec3>() / known().count().max(1) as f32;
        let mean = mean.max(Vec3::splat(1e-6));
        self.radiance = self.radiance.map(|radiance| radiance * mean);
        for cell in self.brightness.cells.iter_mut().flatten() {
            *cell /= mean;
        }
    }

    fn colour(
        &self,
        point: Vec3,
        pose: RigidTransform,
        camera_from_world: RigidTransform,
        picture: &Picture,
    ) -> Option<Vec3> {
        let pixel: DVec2 = self
            .camera
            .project(camera_from_world.transform_point(point.as_dvec3()))?;
        let (x, y) = (pixel.x.round(), pixel.y.round());
        let inside =
            x >= 0.0 && y >= 0.0 && x < f64::from(picture.width) && y < f64::from(picture.height);
        let to_point = point.as_dvec3() - pose.translation;
        let clear = inside
            && self
                .rays
                .nearest(pose.translation, to_point)
                .is_none_or(|hit| hit.distance > 0.999);
        clear.then(|| {
            let codes = picture.rgb(x as u32, y as u32);
            Vec3::from(self.response.linear_from_rgb(codes)) / vignetting_at(self.vignetting, pixel)
        })
    }

    /// Mean radiance of the ground.
    pub(crate) const fn radiance(&self) -> Option<Vec3> {
        self.radiance
    }

    /// Brightness of its places.
    pub(crate) const fn brightness(&self) -> &GroundBrightness {
        &self.brightness
    }
}

/// Returns cells of the ground, of which nothing is known, three times as wide as the virtual objects.
fn cells_around(scene: &Scene) -> GroundBrightness {
    let (mut low, mut high) = (Vec3::splat(f32::MAX), Vec3::splat(f32::MIN));
    for part in &scene.virtual_parts {
        for vertex in &part.mesh.vertices {
            let p = part
                .world_from_part
                .transform_point3(vertex.position.as_dvec3())
                .as_vec3();
            (low, high) = (low.min(p), high.max(p));
        }
    }
    if low.x > high.x {
        (low, high) = (Vec3::splat(-0.3), Vec3::splat(0.3));
    }
    let (centre, half) = (
        (low + high) / 2.0,
        ((high - low) * 1.5).truncate().max_element(),
    );
    let side = scene.ground_height.map_or(0, |_| GROUND_POINTS);
    GroundBrightness {
        low: centre.truncate() - half,
        edge: 2.0 * half,
        side,
        cells: vec![None; side * side],
    }
}

/// Measures the radiance of the phantoms' sides.
pub(crate) struct PhantomSurfaces {
    rays: RayCaster,
    camera: PinholeCamera,
    response: Response,
    vignetting: Option<Vignetting>,
    /// Mean radiance and weight of each side of each part.
    seen: Vec<[(Vec3, f32); 6]>,
    parts: Vec<Part>,
    radiance: Vec<[Vec3; 6]>,
}

/// Spacing of the sampled pixels in x and y.
const SPACING: u32 = 16;
/// Minimum weight of a mean to be used.
const MIN_WEIGHT: f32 = 4.0;
/// Default albedo of a phantom that was never observed and has none in the scene file.
const DEFAULT_ALBEDO: f32 = 0.3;

impl PhantomSurfaces {
    pub(crate) fn new(rig: &RigCalibration, scene: &Scene) -> Self {
        let parts: Vec<Part> = solid_phantoms(scene).cloned().collect();
        let scene_camera = &rig.scene_camera;
        Self {
            rays: RayCaster::from_parts(&parts),
            camera: scene_camera.camera.clone(),
            response: scene_camera.response.clone(),
            vignetting: scene_camera.vignetting,
            seen: vec![[(Vec3::ZERO, 0.0); 6]; parts.len()],
            radiance: vec![[Vec3::ZERO; 6]; parts.len()],
            parts,
        }
    }

    pub(crate) fn look(&mut self, scene: &SceneView<'_>) {
        let Some(pose) = scene.world_from_camera else {
            return;
        };
        self.camera.clone_from(scene.camera);
        let fits =
            (scene.picture.width, scene.picture.height) == (self.camera.width, self.camera.height);
        if self.parts.is_empty() || !fits {
            return;
        }
        for y in (SPACING / 2..self.camera.height).step_by(SPACING as usize) {
            for x in (SPACING / 2..self.camera.width).step_by(SPACING as usize) {
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                let ray = pose.rotation * self.camera.unproject(pixel);
                if let Some(hit) = self.rays.nearest(pose.translation, ray) {
                    let codes = scene.picture.rgb(x, y);
                    let colour = Vec3::from(self.response.linear_from_rgb(codes))
                        / vignetting_at(self.vignetting, pixel);
                    let side = side_of(hit.shading_normal.as_vec3());
                    self.note(hit.surface as usize, side, colour);
                }
            }
        }
    }

    /// Returns the mean radiance of all observed sides; mirrors are excluded.
    pub(crate) fn mean(&self) -> Option<Vec3> {
        let parts = self
            .parts
            .iter()
            .zip(&self.seen)
            .filter(|(part, _)| !part.mirror);
        let sides = parts
            .flat_map(|(_, sides)| sides)
            .filter(|(_, weight)| *weight >= MIN_WEIGHT);
        let (sum, count) = sides.fold((Vec3::ZERO, 0.0), |(s, n), (mean, _)| (s + *mean, n + 1.0));
        (count > 0.0).then(|| sum / count)
    }

    /// Returns the radiance, as by the last [`Self::radiance`], of the phantom that is met in a direction.
    pub(crate) fn met(&self, origin: DVec3, direction: DVec3) -> Option<Vec3> {
        let hit = self.rays.nearest(origin, direction)?;
        let sides = self.radiance.get(hit.surface as usize)?;
        let side = side_of(hit.shading_normal.as_vec3());
        sides.get(side as usize).copied()
    }

    /// Adds an observation to the running mean of a side; the window is 200 observations.
    fn note(&mut self, part: usize, side: u32, colour: Vec3) {
        let (mean, weight) = &mut self.seen[part][side as usize];
        *weight = (*weight + 1.0).min(200.0);
        *mean += (colour - *mean) / *weight;
    }

    /// Returns the radiance of all sides: as measured, or, for sides that were not observed, the
    /// albedo of the part times the irradiance of `lighting` over π.
    pub(crate) fn radiance(&mut self, lighting: &Lighting) -> &PhantomRadiance {
        let irradiance = AXES.map(|n| irradiance(lighting, n));
        for ((part, seen), radiance) in self.parts.iter().zip(&self.seen).zip(&mut self.radiance) {
            let albedo = albedo(part, seen, &irradiance);
            for (side, out) in radiance.iter_mut().enumerate() {
                let (mean, weight) = seen[side];
                // The radiance of a mirror depends on the viewing direction.
                let known = weight >= MIN_WEIGHT && !part.mirror;
                *out = if known {
                    mean
                } else {
                    albedo * irradiance[side] / PI
                };
            }
        }
        &self.radiance
    }
}

/// Returns the albedo of a part: as stated, or estimated from the observed sides.
fn albedo(part: &Part, seen: &[(Vec3, f32); 6], irradiance: &[Vec3; 6]) -> Vec3 {
    if part.mirror {
        return Vec3::ONE;
    }
    let (mut sum, mut count) = (Vec3::ZERO, 0.0);
    for ((mean, weight), arriving) in seen.iter().zip(irradiance) {
        if *weight >= MIN_WEIGHT && arriving.min_element() > 0.0 {
            sum += (*mean * PI / *arriving).clamp(Vec3::ZERO, Vec3::ONE);
            count += 1.0;
        }
    }
    match part.albedo {
        Some(albedo) => albedo,
        None if count > 0.0 => sum / count,
        None => Vec3::splat(DEFAULT_ALBEDO),
    }
}

/// Returns the irradiance of an unoccluded surface with normal `n`.
fn irradiance(lighting: &Lighting, n: Vec3) -> Vec3 {
    let compact = lighting
        .lights
        .iter()
        .filter(|l| l.kind == LightKind::Compact);
    let direct: Vec3 = compact
        .map(|l| l.irradiance * l.direction.dot(n).max(0.0))
        .sum();
    direct + lighting.irradiance.irradiance(n)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::view::SphereAt;
    use glam::{DMat3, DQuat};
    use penumbra_interface::MonotonicTime;

    /// Looks straight down from 1 m at 0.8 m of the ground, +X to the right.
    fn looking_down() -> (PinholeCamera, RigidTransform) {
        let camera = PinholeCamera {
            width: 200,
            height: 200,
            focal: DVec2::splat(250.0),
            centre: DVec2::splat(99.5),
            distortion: [0.0; 5],
        };
        let axes = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
        let pose = RigidTransform {
            rotation: DQuat::from_mat3(&axes),
            translation: DVec3::Z,
        };
        (camera, pose)
    }

    fn ground_below() -> (GroundRadiance, RigidTransform) {
        let (camera, pose) = looking_down();
        let ground = GroundRadiance {
            height: Some(0.0),
            rays: Arc::new(RayCaster::from_parts(&[])),
            camera,
            response: Response::srgb(),
            vignetting: None,
            radiance: None,
            brightness: cells_around(&Scene {
                ground_height: Some(0.0),
                ..Scene::default()
            }),
            looks: 0,
            seen: Vec::new(),
        };
        (ground, pose)
    }

    fn look(ground: &mut GroundRadiance, picture: &Picture, pose: RigidTransform) {
        let camera = ground.camera.clone();
        ground.look(&SceneView {
            picture,
            world_from_camera: Some(pose),
            camera: &camera,
            sphere: SphereAt::Calibrated,
            captured_at: MonotonicTime::from_nanos(0),
            exposure: None,
        });
    }

    /// Bright on the left, dark on the right.
    fn halves(left: u8, right: u8) -> Picture {
        let code = |x: u32| if x < 100 { left } else { right };
        let pixels = (0..200 * 200).flat_map(|i| [code(i % 200), code(i % 200), 60, 255]);
        Picture {
            width: 200,
            height: 200,
            rgba: pixels.collect(),
        }
    }

    #[test]
    fn ground_follows_its_light_at_once_and_does_not_depend_on_what_is_seen() {
        let (mut ground, pose) = ground_below();
        for _ in 0..20 {
            look(&mut ground, &halves(200, 100), pose);
        }
        let linear = |code: u8| Response::srgb().linear_from_rgb([code; 3])[0];
        let before = ground.radiance().unwrap().x;
        let expected = 0.5 * (linear(200) + linear(100));
        assert!(
            (before / expected - 1.0).abs() < 0.05,
            "{before} {expected}"
        );
        // The camera moves until it sees the bright half alone.
        let mut aside = pose;
        aside.translation.x -= 0.4;
        let bright = halves(200, 200);
        for _ in 0..20 {
            look(&mut ground, &bright, aside);
        }
        let aside = ground.radiance().unwrap().x;
        assert!((aside / before - 1.0).abs() < 0.25, "{aside} {before}");
        // A lamp goes out.
        look(&mut ground, &halves(90, 45), pose);
        let after = ground.radiance().unwrap().x;
        let darker = linear(90) / linear(200);
        assert!(
            (after / (before * darker) - 1.0).abs() < 0.25,
            "{after} {before}"
        );
    }

    #[test]
    fn brightness_of_the_ground_is_that_of_its_places() {
        let (mut ground, pose) = ground_below();
        // Stripes of 5 pixels on the left, their mean on average; dark on the right.
        let code = |x: u32| match (x < 100, x % 10 < 5) {
            (true, true) => 200,
            (true, false) => 120,
            (false, _) => 60,
        };
        let pixels = (0..200 * 200).flat_map(|i| [code(i % 200), 60, 60, 255]);
        let picture = Picture {
            width: 200,
            height: 200,
            rgba: pixels.collect(),
        };
        for _ in 0..60 {
            look(&mut ground, &picture, pose);
        }
        let linear = |code: u8| ground.response.linear_from_rgb([code; 3])[0];
        let left = 0.5 * (linear(200) + linear(120));
        let mean = 0.5 * (left + linear(60));
        let at = |x: f32, y: f32| ground.brightness().at(Vec2::new(x, y));
        for y in [-0.2, 0.0, 0.3] {
            let (found, expected) = (at(-0.2, y).x, left / mean);
            assert!((found / expected - 1.0).abs() < 0.2, "{found} {expected}");
            let (found, expected) = (at(0.2, y).x, linear(60) / mean);
            assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
            assert!((at(-0.2, y).y - 1.0).abs() < 0.01);
        }
        // Beside the picture nothing is known.
        assert_eq!(at(-0.5, 0.0), Vec3::ONE);
        assert_eq!(ground.brightness().known_at(Vec2::new(-0.5, 0.0)), None);
    }
}
