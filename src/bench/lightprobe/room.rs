//! The scene of the case: a table with a mirrored sphere, in a room whose light changes.

use crate::bench::stage::{self, look_at};
use glam::{DMat4, DQuat, DVec2, DVec3, Vec3, Vec4};
use penumbra_camera::PinholeCamera;
use penumbra_camera::PlacedView;
use penumbra_camera::{EnvironmentView, FisheyeLens, MirrorSphere};
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;
use penumbra_scene::{Material, Mesh, Part, Phong, PlacedLamp, Scene, primitives};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Radius of the paper's sphere, metres: two and three quarter inches across.
const BALL_RADIUS: f64 = 0.0349;
const BALL: DVec3 = DVec3::new(-0.11, 0.06, BALL_RADIUS);
/// Lens of the environment camera; pixels a side of its picture.
const FISHEYE: u32 = 480;

/// Source of the environment's light.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum View {
    Ball,
    Fisheye,
}

impl View {
    pub const fn label(self) -> &'static str {
        match self {
            Self::Ball => "mirrored sphere in the picture",
            Self::Fisheye => "environment camera",
        }
    }
}

/// Pose and picture of the camera.
pub(super) type Stills = Vec<(RigidTransform, Picture)>;

/// The scene and the cameras of the case.
pub(super) struct Room {
    view: View,
    pub camera: PinholeCamera,
    pub picture: Picture,
    around: Picture,
    pub lamps: Vec<PlacedLamp>,
}

impl Room {
    pub fn new(view: View, camera: PinholeCamera, lamps: usize) -> Self {
        let dark = PlacedLamp {
            position: Vec3::Z,
            direction: Vec3::NEG_Z,
            intensity: Vec3::ZERO,
            cone: None,
            area: None,
        };
        Self {
            view,
            picture: stage::picture(camera.width, camera.height),
            around: stage::picture(FISHEYE, FISHEYE),
            camera,
            lamps: vec![dark; lamps],
        }
    }

    pub fn environment_view(&self) -> EnvironmentView {
        match self.view {
            View::Ball => EnvironmentView::SphereInScene { sphere: ball() },
            View::Fisheye => EnvironmentView::Fisheye {
                lens: FisheyeLens {
                    width: FISHEYE,
                    height: FISHEYE,
                    focal: f64::from(FISHEYE) / 2.0 / FRAC_PI_2,
                    centre: DVec2::splat(f64::from(FISHEYE - 1) / 2.0),
                    distortion: [0.0; 4],
                    max_theta: FRAC_PI_2,
                },
                world_from_camera: RigidTransform::IDENTITY,
            },
        }
    }

    /// Returns the picture from which the environment is measured.
    pub const fn environment_picture(&self) -> &Picture {
        match self.view {
            View::Ball => &self.picture,
            View::Fisheye => &self.around,
        }
    }

    /// Renders the cameras' pictures of instant `i`.
    pub fn show(&mut self, i: u32) {
        let scene = (self.pose(i), &self.camera);
        let view = PlacedView::new(&self.environment_view(), Some(scene), None);
        let Some(view) = view else { return };
        let picture = match self.view {
            View::Ball => &mut self.picture,
            View::Fisheye => &mut self.around,
        };
        if self.view == View::Ball {
            *picture = stage::picture(self.camera.width, self.camera.height);
        }
        let (columns, rows) = view.bounds();
        for (y, x) in rows.flat_map(|y| columns.clone().map(move |x| (y, x))) {
            let pixel = DVec2::new(f64::from(x), f64::from(y));
            let at = 4 * (y * picture.width + x) as usize;
            if let Some(direction) = view.direction(pixel)
                && let Some(rgba) = picture.rgba.get_mut(at..at + 3)
            {
                rgba.copy_from_slice(&code(radiance(direction.as_vec3(), i)));
            }
        }
    }

    /// Returns poses and pictures of the first `count` instants.
    pub fn stills(&mut self, count: u32) -> Stills {
        let still = |i| {
            self.show(i);
            (self.pose(i), self.environment_picture().clone())
        };
        (0..count).map(still).collect()
    }

    /// Returns the pose of the camera, which slowly orbits the table and looks down at it.
    pub fn pose(&self, i: u32) -> RigidTransform {
        let angle = -1.3 + 0.004 * f64::from(i);
        let eye = DVec3::new(0.46 * angle.cos(), 0.46 * angle.sin(), 0.38);
        look_at(eye, DVec3::new(0.0, 0.0, 0.02))
    }

    /// Moves the spots along a circle above the objects; their total intensity is constant.
    pub fn move_lamps(&mut self, i: u32) {
        let count = self.lamps.len().max(1) as f32;
        for (k, lamp) in self.lamps.iter_mut().enumerate() {
            let angle = std::f32::consts::TAU * k as f32 / count + 0.05 * i as f32;
            let position = Vec3::new(0.2 * angle.cos(), 0.2 * angle.sin(), 0.32);
            *lamp = PlacedLamp {
                position,
                direction: (Vec3::new(0.03, 0.0, 0.0) - position).normalize(),
                intensity: Vec3::new(0.25, 0.35, 0.6) / count,
                cone: Some((0.35, 0.6)),
                area: None,
            };
        }
    }

    /// Returns the scene: a golden torus and a sphere with a Phong lobe on a table, 7,168
    /// triangles, beside the mirrored sphere.
    pub fn scene(&self) -> Scene {
        let gold = Material {
            base_colour: Vec4::new(0.9, 0.7, 0.3, 1.0),
            metallic: 1.0,
            roughness: 0.3,
            ..Material::default()
        };
        let shiny = Material {
            base_colour: Vec4::new(0.5, 0.1, 0.1, 1.0),
            phong: Some(Phong {
                specular: Vec3::splat(0.3),
                exponent: 60.0,
            }),
            ..Material::default()
        };
        let torus = primitives::torus(0.07, 0.028, 64, 48);
        let small = primitives::sphere(0.03, 32, 16);
        let real = primitives::sphere(BALL_RADIUS as f32, 48, 24);
        let (at, plain) = (DVec3::new(0.03, 0.0, 0.03), Material::default());
        let beside = DVec3::new(0.02, -0.12, 0.03);
        let mirror = Part {
            mirror: true,
            ..part("mirror sphere", real, BALL, plain.clone())
        };
        let table = primitives::plane(8.0, 8.0);
        Scene {
            virtual_parts: vec![
                part("torus", torus, at, gold),
                part("ball", small, beside, shiny),
            ],
            phantom_parts: vec![part("ground", table, DVec3::ZERO, plain), mirror],
            ground_height: Some(0.0),
            ..Scene::default()
        }
    }

    /// Returns the table's irradiance from the room, by direct summation.
    #[cfg(test)]
    pub fn irradiance(&self, i: u32) -> Vec3 {
        let grid = penumbra_lighting::cube::CubeGrid::new(128);
        let each = grid.directions.iter().zip(&grid.solid_angles);
        each.map(|(d, w)| radiance(*d, i) * (w * d.z.max(0.0)))
            .sum()
    }
}

fn part(name: &str, mesh: Mesh, at: DVec3, material: Material) -> Part {
    Part {
        name: name.to_owned(),
        mesh: Arc::new(mesh),
        material: Arc::new(material),
        world_from_part: DMat4::from_rotation_translation(DQuat::IDENTITY, at),
        mirror: false,
        albedo: None,
    }
}

const fn ball() -> MirrorSphere {
    MirrorSphere {
        centre_in_world: BALL,
        radius: BALL_RADIUS,
        position_sigma: 0.0,
        reflectance: [1.0; 3],
        in_scene: true,
    }
}

/// Returns the radiance of a room with a wide window and a passing cloud. No value clips, so that
/// the measured lighting can be verified.
fn radiance(d: Vec3, i: u32) -> Vec3 {
    let time = 0.2 * i as f32;
    let wall = 0.25 + 0.1 * (3.0 * d.x).sin() * (4.0 * d.z).cos() + 0.05 * d.z;
    let window = (-(d - Vec3::new(0.6, 0.3, 0.74)).length_squared() / 0.12).exp();
    let cloud = 0.75 + 0.25 * time.sin();
    Vec3::new(0.9, 1.0, 1.1) * (wall + 0.6 * cloud * window)
}

/// Encodes a radiance with the camera's tone curve.
fn code(radiance: Vec3) -> [u8; 3] {
    radiance.to_array().map(|l| {
        let l = l.clamp(0.0, 1.0);
        let v = if l <= 0.003_130_8 {
            12.92 * l
        } else {
            1.055 * l.powf(1.0 / 2.4) - 0.055
        };
        (255.0 * v).round() as u8
    })
}
