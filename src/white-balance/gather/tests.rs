use super::*;
use crate::overlap::{Shortage, estimate_overlap};
use glam::{DMat3, DQuat};
use penumbra_camera::Response;
use penumbra_camera::{FisheyeLens, MirrorSphere};
use penumbra_scene::Scene;
use penumbra_scene::raycast::sphere_hit;

const GAINS: DVec3 = DVec3::new(3.0, 2.5, 4.0);

/// The pose of a camera at `eye` that looks at `target`.
fn look_at(eye: DVec3, target: DVec3) -> RigidTransform {
    let z = (target - eye).normalize();
    let x = z.cross(DVec3::Z).normalize();
    let rotation = DQuat::from_mat3(&DMat3::from_cols(x, z.cross(x), z));
    RigidTransform::new(rotation, eye)
}

fn camera(size: u32, focal: f64) -> PinholeCamera {
    PinholeCamera {
        width: size,
        height: size,
        focal: DVec2::splat(focal),
        centre: DVec2::splat(0.5 * f64::from(size) - 0.5),
        distortion: [0.0; 5],
    }
}

/// A smooth coloured pattern on the ground, in scene camera units.
fn ground_radiance(point: DVec3) -> DVec3 {
    let wave = |k: f64| 0.3 + 0.15 * (k * point.x).sin() * (k * point.y).cos();
    DVec3::new(wave(9.0), wave(11.0), wave(7.0))
}

fn render(size: u32, response: &Response, radiance: impl Fn(DVec2) -> DVec3) -> Picture {
    let pixels = (0..size).flat_map(|y| (0..size).map(move |x| (x, y)));
    let rgba = pixels.flat_map(|(x, y)| {
        let linear = radiance(DVec2::new(f64::from(x), f64::from(y)));
        let [r, g, b] = linear
            .to_array()
            .map(|v| response.code_from_linear(v as f32));
        [r, g, b, 255]
    });
    Picture {
        width: size,
        height: size,
        rgba: rgba.collect(),
    }
}

struct Rig {
    scene_camera: PinholeCamera,
    world_from_scene_camera: RigidTransform,
    view: EnvironmentView,
    scene: Picture,
    environment: Picture,
    response: Response,
}

fn level_ground() -> RayCaster {
    RayCaster::from_phantoms(&Scene {
        ground_height: Some(0.0),
        ..Scene::default()
    })
}

fn sphere_rig() -> Rig {
    let sphere = MirrorSphere {
        centre_in_world: DVec3::new(0.0, 0.1, 0.05),
        radius: 0.05,
        position_sigma: 0.0,
        reflectance: [0.9, 0.8, 0.7],
        in_scene: true,
    };
    let response = Response::srgb();
    let scene_camera = camera(240, 260.0);
    let world_from_scene_camera = look_at(DVec3::new(0.0, -0.6, 0.5), DVec3::ZERO);
    let view = EnvironmentView::Sphere {
        camera: camera(240, 700.0),
        world_from_camera: look_at(DVec3::new(0.3, -0.2, 0.3), sphere.centre_in_world),
        sphere: sphere.clone(),
    };
    let ground = level_ground();
    let environment = render(240, &response, |pixel| {
        let Some(ray) = environment_ray(&view, pixel) else {
            return DVec3::ZERO;
        };
        ground
            .nearest(ray.origin, ray.direction)
            .map_or(DVec3::ZERO, |hit| {
                ray.attenuation * ground_radiance(hit.point) / GAINS
            })
    });
    let eye = world_from_scene_camera.translation;
    let scene = render(240, &response, |pixel| {
        let direction = world_from_scene_camera.rotation * scene_camera.unproject(pixel);
        // The scene camera sees the sphere itself, nearly black.
        if sphere_hit(sphere.centre_in_world, sphere.radius, eye, direction).is_some() {
            return DVec3::splat(0.02);
        }
        ground
            .nearest(eye, direction)
            .map_or(DVec3::ZERO, |hit| ground_radiance(hit.point))
    });
    Rig {
        scene_camera,
        world_from_scene_camera,
        view,
        scene,
        environment,
        response,
    }
}

impl Rig {
    fn gather(&self) -> Vec<PhotometricPair> {
        let overlap = Overlap {
            scene: Photograph {
                picture: &self.scene,
                response: &self.response,
            },
            scene_camera: &self.scene_camera,
            world_from_scene_camera: self.world_from_scene_camera,
            environment: Photograph {
                picture: &self.environment,
                response: &self.response,
            },
            environment_view: &self.view,
            vignetting: [None; 2],
        };
        gather_pairs(&overlap, &level_ground(), &GatherOptions::default())
    }
}

#[test]
fn recovers_gains_without_the_spheres_own_colour() {
    let pairs = sphere_rig().gather();
    let found = estimate_overlap(&pairs).unwrap();
    let error = found.estimate.percent_from(GAINS);
    assert!(error.abs().max_element() < 0.7, "{error}");
    assert!(found.pairs > 200, "{}", found.pairs);
}

#[test]
fn unmodelled_object_is_rejected_as_an_outlier() {
    let mut rig = sphere_rig();
    for y in 40..110u32 {
        let row = 4 * 240 * y as usize;
        rig.scene.rgba[row + 4 * 20..row + 4 * 90].fill(230);
    }
    let found = estimate_overlap(&rig.gather()).unwrap();
    let error = found.estimate.percent_from(GAINS);
    assert!(error.abs().max_element() < 1.5, "{error}");
}

#[test]
fn clipped_and_black_channels_have_infinite_variance() {
    let mut rig = sphere_rig();
    for pixel in rig.scene.rgba.chunks_exact_mut(4) {
        pixel[0] = 255;
    }
    for pixel in rig.environment.rgba.chunks_exact_mut(4) {
        pixel[1] = 0;
    }
    let pairs = rig.gather();
    assert!(!pairs.is_empty());
    for pair in pairs {
        assert!(pair.variance.x.is_infinite() && pair.variance.y.is_infinite());
        assert!(pair.variance.z.is_finite() && pair.variance.z > 0.0);
    }
}

#[test]
fn fisheye_that_looks_up_yields_no_patches() {
    let mut rig = sphere_rig();
    rig.view = EnvironmentView::Fisheye {
        lens: FisheyeLens {
            width: 240,
            height: 240,
            focal: 76.0,
            centre: DVec2::splat(119.5),
            distortion: [0.0; 4],
            max_theta: std::f64::consts::FRAC_PI_2,
        },
        world_from_camera: RigidTransform::new(DQuat::IDENTITY, DVec3::new(0.0, 0.0, 0.06)),
    };
    let pairs = rig.gather();
    assert_eq!(pairs, []);
    let none = estimate_overlap(&pairs);
    assert!(matches!(none, Err(Shortage::TooFew { .. })));
}

#[test]
fn pictures_of_the_wrong_size_yield_no_patches() {
    let mut rig = sphere_rig();
    rig.environment.width -= 1;
    assert_eq!(rig.gather(), []);
    let mut rig = sphere_rig();
    rig.scene.height -= 1;
    assert_eq!(rig.gather(), []);
}
