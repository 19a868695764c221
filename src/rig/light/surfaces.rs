//! Measures the radiance of the real surfaces around the virtual objects in the scene camera's
//! picture.

use crate::light::view::SceneView;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::Vignetting;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_lighting::{LightKind, Lighting};
use penumbra_picture::Picture;
use penumbra_rig_model::RigCalibration;
use penumbra_scene::PhantomRadiance;
use penumbra_scene::indirect_light::{AXES, side_of, solid_phantoms};
use penumbra_scene::{Part, RayCaster, Scene};
use std::f32::consts::PI;
use std::sync::Arc;

/// Measures the radiance of the ground around the virtual objects in the scene camera's picture.
/// It fills the lower hemisphere if the environment camera faces upwards.
pub(crate) struct GroundRadiance {
    points: Vec<Vec3>,
    rays: Arc<RayCaster>,
    camera: PinholeCamera,
    response: Response,
    vignetting: Option<Vignetting>,
    radiance: Option<Vec3>,
}

/// Sample points along a side of the square around the objects.
const GROUND_POINTS: usize = 24;
/// Weight of a new observation in the exponential moving average.
const GROUND_SHARE: f32 = 0.1;

/// Returns the vignetting factor of a pixel, 1 at the centre.
fn vignetting_at(vignetting: Option<Vignetting>, pixel: DVec2) -> f32 {
    vignetting.map_or(1.0, |v| v.at(pixel) as f32)
}

impl GroundRadiance {
    pub(crate) fn new(rig: &RigCalibration, scene: &Scene, rays: Arc<RayCaster>) -> Self {
        let points = scene
            .ground_height
            .map(|height| points_around(scene, height as f32))
            .unwrap_or_default();
        let scene_camera = &rig.scene_camera;
        Self {
            points,
            rays,
            camera: scene_camera.camera.clone(),
            response: scene_camera.response.clone(),
            vignetting: scene_camera.vignetting,
            radiance: None,
        }
    }

    /// Continues from the measurement of `before`.
    pub(crate) fn follow(&mut self, before: &Self) {
        self.radiance = before.radiance;
    }

    pub(crate) fn look(&mut self, scene: &SceneView<'_>) {
        let Some(pose) = scene.world_from_camera else {
            return;
        };
        self.camera.clone_from(scene.camera);
        let camera_from_world = pose.inverse();
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for point in &self.points {
            if let Some(colour) = self.colour(*point, pose, camera_from_world, scene.picture) {
                sum += colour;
                count += 1.0;
            }
        }
        if count < 8.0 {
            return;
        }
        let now = sum / count;
        self.radiance = Some(self.radiance.map_or(now, |old| old.lerp(now, GROUND_SHARE)));
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

    pub(crate) const fn radiance(&self) -> Option<Vec3> {
        self.radiance
    }
}

/// Returns a grid of points on the ground, three times as wide as the virtual objects.
fn points_around(scene: &Scene, height: f32) -> Vec<Vec3> {
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
    let at = |k: usize| (2.0 * (k as f32 + 0.5) / GROUND_POINTS as f32 - 1.0) * half;
    (0..GROUND_POINTS * GROUND_POINTS)
        .map(|i| {
            let (x, y) = (at(i % GROUND_POINTS), at(i / GROUND_POINTS));
            Vec3::new(centre.x + x, centre.y + y, height)
        })
        .collect()
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
