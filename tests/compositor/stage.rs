//! Small synthetic scenes under synthetic light, composed by the GPU and by the twin.

use glam::{DMat3, DMat4, DQuat, DVec2, DVec3, Vec3};
use penumbra_camera::{PinholeCamera, Response, RollingShutter, Vignetting};
use penumbra_compositor::reference::{Reference, ReferencePicture};
use penumbra_compositor::{
    Compositor, CompositorSettings, Exposure, FrameInput, Gpu, Look, Refresh, Reprojection,
};
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_lighting::{CubeMap, DomeLight, Harmonics, LightKind, LightPlace, Lighting};
use penumbra_picture::Picture;
use penumbra_scene::{
    Highlights, IndirectLight, LampResponse, Material, Mesh, Part, PlacedLamp, Scene, ShadowMode,
    casters, primitives,
};
use std::f32::consts::PI;
use std::sync::{Arc, OnceLock};

/// The software driver, so that pictures are the same on all machines; `PENUMBRA_TEST_ADAPTER`
/// selects another. With no more than the required limits, so that a pass that needs more fails.
pub fn gpu() -> Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    let adapter = std::env::var("PENUMBRA_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    GPU.get_or_init(|| match Gpu::open_least(Some(&adapter)) {
        Ok(gpu) => gpu,
        Err(error) => panic!("{error}\n`make test` installs the software driver"),
    })
    .clone()
}

/// The same adapter with all its limits, for more dome lights than every adapter can hold.
pub fn gpu_with_all_limits() -> Gpu {
    let adapter = std::env::var("PENUMBRA_TEST_ADAPTER").unwrap_or_else(|_| "llvmpipe".to_owned());
    Gpu::open(Some(&adapter)).unwrap()
}

/// All inputs of a frame.
#[derive(Clone)]
pub struct Stage {
    pub scene: Scene,
    pub lighting: Option<Lighting>,
    pub lamps: Vec<PlacedLamp>,
    pub camera: PinholeCamera,
    pub near: Option<IndirectLight>,
    pub seconds: f64,
    pub vignetting: Option<Vignetting>,
    pub rolling_shutter: Option<RollingShutter>,
    pub reprojection: Option<Reprojection>,
    pub pose: Option<RigidTransform>,
    pub picture: Picture,
    pub response: Response,
    pub mode: ShadowMode,
    pub strength: f32,
    pub refresh: Refresh,
    pub show_virtual: bool,
    pub settings: CompositorSettings,
    pub exposure: Exposure,
    pub highlights: Highlights,
    pub lamp_response: LampResponse,
    pub brightest: Vec3,
    pub look: Look,
}

impl Stage {
    /// An empty table seen from half a metre, without light.
    pub fn new(width: u32, height: u32) -> Self {
        Self {
            scene: Scene {
                phantom_parts: vec![part(primitives::plane(4.0, 4.0), DVec3::ZERO)],
                virtual_parts: Vec::new(),
                ground_height: Some(0.0),
                ..Scene::default()
            },
            lighting: None,
            near: None,
            seconds: 0.0,
            vignetting: None,
            rolling_shutter: None,
            reprojection: None,
            lamps: Vec::new(),
            camera: camera(width, height),
            pose: Some(looking_from(DVec3::new(0.06, -0.4, 0.34), DVec3::ZERO)),
            picture: flat(width, height, [180, 150, 120]),
            response: Response::srgb(),
            mode: ShadowMode::Ratio,
            strength: 1.0,
            refresh: Refresh::UpTo(1000),
            show_virtual: true,
            settings: CompositorSettings {
                light_budget: 8,
                shadow_map_size: 512,
                soft_samples: 1,
                cached: false,
                ..CompositorSettings::for_adapter(false)
            },
            exposure: Exposure::Camera,
            highlights: Highlights::Estimated,
            lamp_response: LampResponse::Intrinsic,
            brightest: Vec3::ZERO,
            look: Look::default(),
        }
    }

    pub fn with_virtual(mut self, part: Part) -> Self {
        self.scene.virtual_parts.push(part);
        self
    }

    pub fn with_phantom(mut self, part: Part) -> Self {
        self.scene.phantom_parts.push(part);
        self
    }

    pub fn lit(mut self, lighting: Lighting) -> Self {
        let lights = lighting.lights.len() as u32;
        self.settings.light_budget = self.settings.light_budget.max(lights);
        self.lighting = Some(lighting);
        self
    }

    /// Removes the table; only floating virtual objects remain.
    pub fn without_ground(mut self) -> Self {
        self.scene.phantom_parts.clear();
        self.scene.ground_height = None;
        self
    }

    pub fn input(&self) -> FrameInput<'_> {
        FrameInput {
            seconds: self.seconds,
            picture: &self.picture,
            camera: &self.camera,
            vignetting: self.vignetting,
            rolling_shutter: self.rolling_shutter,
            world_from_camera: self.pose,
            reprojection: self.reprojection,
            lighting: self.lighting.as_ref(),
            coming_light: None,
            is_start: false,
            indirect_light: self.near.as_ref(),
            lamps: &self.lamps,
            lamp_response: self.lamp_response,
            brightest: self.brightest,
            shadow_mode: self.mode,
            shadow_strength: self.strength,
            refresh: self.refresh,
            show_virtual: self.show_virtual,
            planes: None,
            exposure: self.exposure,
            highlights: self.highlights,
            look: self.look,
        }
    }

    pub fn compositor(&self) -> Compositor {
        let lights = self.settings.light_budget;
        let gpu = if lights > gpu().max_lights() {
            gpu_with_all_limits()
        } else {
            gpu()
        };
        self.compositor_on(gpu)
    }

    pub fn compositor_on(&self, gpu: Gpu) -> Compositor {
        let mut compositor = Compositor::new(gpu, self.settings.clone(), self.response.clone());
        compositor.set_scene(&self.scene, &casters(&self.scene));
        compositor
    }

    /// One frame of a new compositor.
    pub fn compose(&self) -> Picture {
        self.compose_with(&mut self.compositor())
    }

    pub fn compose_with(&self, compositor: &mut Compositor) -> Picture {
        let mut out = Picture::default();
        compositor.compose(&self.input()).unwrap();
        compositor.read(&mut out).unwrap();
        out
    }

    pub fn twin(&self) -> ReferencePicture {
        self.soft_twin(1)
    }

    pub fn soft_twin(&self, rays_per_light: u32) -> ReferencePicture {
        Reference::new(&self.scene)
            .with_rays(rays_per_light)
            .compose(&self.input(), &self.response)
    }
}

pub fn camera(width: u32, height: u32) -> PinholeCamera {
    PinholeCamera {
        width,
        height,
        focal: DVec2::splat(f64::from(width)),
        centre: DVec2::new(f64::from(width) * 0.5 - 0.8, f64::from(height) * 0.5 - 0.1),
        distortion: [0.0; 5],
    }
}

pub fn looking_from(eye: DVec3, at: DVec3) -> RigidTransform {
    let forward = (at - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize_or(DVec3::X);
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    RigidTransform::new(DQuat::from_mat3(&axes), eye)
}

/// A white diffuse part without Fresnel reflection, as the twin supports.
pub fn part(mesh: Mesh, at: DVec3) -> Part {
    painted(mesh, at, matt(Vec3::ONE))
}

pub fn painted(mesh: Mesh, at: DVec3, material: Material) -> Part {
    Part {
        name: "part".to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(material),
        world_from_part: DMat4::from_translation(at),
        mirror: false,
        albedo: None,
    }
}

pub fn matt(colour: Vec3) -> Material {
    Material {
        base_colour: colour.extend(1.0),
        specular: 0.0,
        ..Material::default()
    }
}

pub fn sun(direction: Vec3, irradiance: Vec3) -> DomeLight {
    DomeLight {
        direction: direction.normalize(),
        irradiance,
        angular_radius: 0.0,
        kind: LightKind::Compact,
        place: LightPlace::FAR,
    }
}

pub fn cell(direction: Vec3, irradiance: Vec3) -> DomeLight {
    DomeLight {
        kind: LightKind::Cell,
        ..sun(direction, irradiance)
    }
}

/// Lighting by `lights` alone; `radiance` is that of reflections and of the lower hemisphere.
pub fn lighting(lights: Vec<DomeLight>, radiance: f32) -> Lighting {
    let levels = (0..4).map(|m| vec![[radiance; 3]; 6 << (2 * (3 - m))]);
    Lighting {
        captured_at: MonotonicTime::default(),
        generation: 1,
        radiance: Arc::new(CubeMap {
            size: 8,
            levels: levels.collect(),
            ..CubeMap::default()
        }),
        irradiance: harmonics(&lights),
        lights,
        ground_radiance: Vec3::splat(radiance),
        faces: None,
    }
}

/// A uniform sky in all directions, without lights that cast shadows.
pub fn even_sky(radiance: f32) -> Lighting {
    let mut lighting = lighting(Vec::new(), radiance);
    lighting.irradiance.coefficients[0] = Vec3::splat(PI * radiance);
    lighting
}

/// Harmonics of the cells: A_l k_lm² · C · p_lm(direction), see `environment::harmonics`.
fn harmonics(lights: &[DomeLight]) -> Harmonics {
    let mut out = Harmonics::default();
    for light in lights.iter().filter(|l| l.kind == LightKind::Cell) {
        let d = light.direction;
        let terms = [
            0.25,
            0.5 * d.y,
            0.5 * d.z,
            0.5 * d.x,
            0.9375 * d.x * d.y,
            0.9375 * d.y * d.z,
            0.078_125 * (3.0 * d.z * d.z - 1.0),
            0.9375 * d.x * d.z,
            0.234_375 * (d.x * d.x - d.y * d.y),
        ];
        for (sum, term) in out.coefficients.iter_mut().zip(terms) {
            *sum += light.irradiance * term;
        }
    }
    out
}

/// Lights over the entire upper hemisphere, in different colours, with a total irradiance of about
/// `total` on the ground.
pub fn spiral(count: u32, total: f32) -> Vec<DomeLight> {
    let golden = PI * (3.0 - 5.0_f32.sqrt());
    (0..count)
        .map(|i| {
            let z = 1.0 - (i as f32 + 0.5) / count as f32;
            let (sin, cos) = (golden * i as f32).sin_cos();
            let r = (1.0 - z * z).sqrt();
            let colour = Vec3::new(1.0 + 0.3 * cos, 1.0, 1.0 - 0.3 * cos);
            let share = 2.0 * total / count as f32;
            cell(Vec3::new(r * cos, r * sin, z), colour * share)
        })
        .collect()
}

pub fn flat(width: u32, height: u32, [r, g, b]: [u8; 3]) -> Picture {
    Picture {
        width,
        height,
        rgba: [r, g, b, 255].repeat((width * height) as usize),
    }
}

/// Random codes of all values, also in alpha, which cameras do not use.
pub fn noise(width: u32, height: u32) -> Picture {
    let mut state = 0x2545_f491_4f6c_dd1d_u64;
    let rgba = (0..4 * width * height)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 56) as u8
        })
        .collect();
    Picture {
        width,
        height,
        rgba,
    }
}
