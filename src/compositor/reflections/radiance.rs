//! Radiance of what mirror rays meet, as far as the camera does not see it.

use super::super::frame_input::FrameInput;
use super::nearby_scene::Surface;
use glam::Vec3;
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;
use penumbra_lighting::compact_source_specular::CompleteMap;
use penumbra_lighting::{LightKind, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::IndirectLight;
use penumbra_scene::indirect_light::side_of;
use std::f32::consts::PI;

/// Width of the lobe, as GGX's α, by which the environment camera's view of the ground is blurred.
const GROUND_WIDTH: f32 = 0.02;

/// The light of a frame.
pub struct NearbyLight<'a> {
    lighting: &'a Lighting,
    sky: CompleteMap<'a>,
    indirect: Option<&'a IndirectLight>,
    picture: &'a Picture,
    response: &'a Response,
    camera: &'a PinholeCamera,
    camera_from_world: RigidTransform,
    vignetting: Option<penumbra_camera::Vignetting>,
}

impl<'a> NearbyLight<'a> {
    /// The light of `input`; `None` where virtual
    /// objects are not shown.
    pub fn new(input: &'a FrameInput<'_>, response: &'a Response) -> Option<Self> {
        let lighting = input.lighting?;
        Some(Self {
            lighting,
            sky: CompleteMap::new(&lighting.radiance),
            indirect: input.indirect_light.filter(|light| light.generation != 0),
            picture: input.picture,
            response,
            camera: input.camera,
            camera_from_world: input.world_from_camera?.inverse(),
            vignetting: input.vignetting,
        })
    }

    /// Light that a virtual surface reflects diffusely or emits.
    pub fn diffuse(&self, p: Vec3, n: Vec3, surface: &Surface) -> Vec3 {
        let known = self.indirect.and_then(|light| {
            let nearby = &light.nearby;
            nearby.surfels.mean(&nearby.diffuse, p, n)
        });
        known.unwrap_or_else(|| surface.emissive + surface.diffuse * self.irradiance(p, n) / PI)
    }

    /// All light of a virtual surface, with specular reflection as if it were diffuse.
    pub fn total(&self, p: Vec3, n: Vec3, surface: &Surface) -> Vec3 {
        let known = self.indirect.and_then(|light| {
            let nearby = &light.nearby;
            nearby.surfels.mean(&nearby.total, p, n)
        });
        known.unwrap_or_else(|| {
            surface.emissive + (surface.diffuse + surface.f0) * self.irradiance(p, n) / PI
        })
    }

    /// Irradiance of a surface from which nothing is hidden.
    fn irradiance(&self, p: Vec3, n: Vec3) -> Vec3 {
        let compact = self.lighting.lights.iter();
        let compact = compact.filter(|light| light.kind == LightKind::Compact);
        let direct: Vec3 = compact
            .map(|light| light.irradiance * light.facing(p, n))
            .sum();
        direct + self.lighting.irradiance.irradiance(n)
    }

    /// Mean radiance of the side of a phantom.
    pub fn phantom(&self, number: u32, n: Vec3) -> Vec3 {
        let sides = self
            .indirect
            .and_then(|light| light.nearby.phantoms.get(number as usize));
        match sides {
            Some(sides) => sides[side_of(n) as usize],
            None => self.lighting.ground_radiance,
        }
    }

    /// Radiance of the ground: the camera's picture where it shows that, else the mean; with the
    /// shadows of virtual objects.
    pub fn ground(&self, p: Vec3) -> Vec3 {
        self.picture_at(p)
            .unwrap_or_else(|| self.ground_of_environment(p))
            * self.ground_share(p)
    }

    /// Radiance of what the picture shows where `p` is in it.
    pub fn picture_at(&self, p: Vec3) -> Option<Vec3> {
        let in_camera = self.camera_from_world.transform_point(p.as_dvec3());
        let seen = self.camera.project(in_camera).filter(|_| in_camera.z > 0.0);
        seen.and_then(|pixel| {
            let (x, y) = (pixel.x.round(), pixel.y.round());
            let is_inside = x >= 0.0
                && y >= 0.0
                && x < f64::from(self.picture.width)
                && y < f64::from(self.picture.height);
            is_inside.then(|| {
                let codes = self.picture.rgb(x as u32, y as u32);
                let brightness = self.vignetting.map_or(1.0, |v| v.at(pixel)).max(0.02);
                Vec3::from(self.response.linear_from_rgb(codes)) / brightness as f32
            })
        })
    }

    /// Radiance of the ground where the camera does not see it, with the shadows of virtual objects.
    pub fn hidden_ground(&self, p: Vec3) -> Vec3 {
        self.ground_of_environment(p) * self.ground_share(p)
    }

    /// Radiance of the ground as the environment camera sees that place, else the mean.
    fn ground_of_environment(&self, p: Vec3) -> Vec3 {
        let towards = self.lighting.radiance.seen_from.map(|eye| p - eye);
        let towards = towards.and_then(|to| to.try_normalize().filter(|to| to.z < 0.0));
        towards.map_or(self.lighting.ground_radiance, |to| {
            self.sky(p, to, GROUND_WIDTH, 0.0)
        })
    }

    /// Share of the ground's light that remains in the shadows of virtual objects.
    pub fn ground_share(&self, p: Vec3) -> Vec3 {
        let share = self.indirect.and_then(|light| {
            let at = (p - light.low).truncate() / (light.high - light.low).truncate();
            if at.min_element() < 0.0 || at.max_element() >= 1.0 {
                return None;
            }
            light.on_ground.value(&light.nearby.ground, at)
        });
        share.unwrap_or(Vec3::ONE)
    }

    /// Radiance of the environment that arrives at `p`, blurred by a lobe of about `width`; that of
    /// lamps by `spread` at least.
    pub fn sky(&self, p: Vec3, direction: Vec3, width: f32, spread: f32) -> Vec3 {
        self.sky.blurred(p, direction, width, spread)
    }
}
