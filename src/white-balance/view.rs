//! Rays of the environment camera's pixels, reflected by the mirrored sphere where there is one.

use glam::{DVec2, DVec3};
use penumbra_camera::{EnvironmentView, FisheyeLens, MirrorSphere};
use penumbra_interface::RigidTransform;
use penumbra_scene::raycast::sphere_hit;

/// The ray of a pixel of the environment camera, after the mirror if there is one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EnvironmentRay {
    /// In the world, metres.
    pub origin: DVec3,
    /// Unit vector, world.
    pub direction: DVec3,
    /// Reflectance of the mirror; 1 for a direct view.
    pub attenuation: DVec3,
    /// Whether the mirror reflects the ray.
    pub mirrored: bool,
}

/// Minimum cosine of incidence on the sphere; below it the reflection is too compressed to use.
const MIN_MIRROR_COSINE: f64 = 0.25;
/// Minimum distance of a passing ray from the sphere's centre, radii: nearer rays may touch the rim.
const CLEARANCE: f64 = 1.06;

/// Returns the ray along which the light of a pixel arrives. `None` outside the lens, near the rim
/// of the sphere, and for a sphere in the scene camera's own picture (one camera, no gains).
pub(super) fn environment_ray(view: &EnvironmentView, pixel: DVec2) -> Option<EnvironmentRay> {
    match view {
        EnvironmentView::Fisheye {
            lens,
            world_from_camera,
        } => {
            let direction = fisheye_direction(lens, pixel)?;
            Some(direct(world_from_camera, direction))
        }
        EnvironmentView::Sphere {
            camera,
            world_from_camera,
            sphere,
        } => mirrored(sphere, direct(world_from_camera, camera.unproject(pixel))),
        EnvironmentView::SphereInScene { .. } => None,
    }
}

/// Width and height, pixels, of the environment camera's picture; `None` where it has none of its
/// own.
pub(super) fn picture_size(view: &EnvironmentView) -> Option<(u32, u32)> {
    match view {
        EnvironmentView::Fisheye { lens, .. } => Some((lens.width, lens.height)),
        EnvironmentView::Sphere { camera, .. } => Some((camera.width, camera.height)),
        EnvironmentView::SphereInScene { .. } => None,
    }
}

/// The mirrored sphere, where the view has one.
pub(super) fn mirror(view: &EnvironmentView) -> Option<&MirrorSphere> {
    match view {
        EnvironmentView::Fisheye { .. } => None,
        EnvironmentView::Sphere { sphere, .. } | EnvironmentView::SphereInScene { sphere } => {
            Some(sphere)
        }
    }
}

fn direct(world_from_camera: &RigidTransform, direction_in_camera: DVec3) -> EnvironmentRay {
    EnvironmentRay {
        origin: world_from_camera.translation,
        direction: world_from_camera.rotation * direction_in_camera,
        attenuation: DVec3::ONE,
        mirrored: false,
    }
}

/// Reflects a ray off the sphere, or returns it unchanged where it passes at a distance.
fn mirrored(sphere: &MirrorSphere, ray: EnvironmentRay) -> Option<EnvironmentRay> {
    let to_centre = sphere.centre_in_world - ray.origin;
    let miss = to_centre.cross(ray.direction).length();
    if miss > CLEARANCE * sphere.radius {
        return Some(ray);
    }
    let centre = sphere.centre_in_world;
    let distance = sphere_hit(centre, sphere.radius, ray.origin, ray.direction)?;
    let origin = ray.origin + distance * ray.direction;
    let normal = (origin - centre) / sphere.radius;
    let cosine = -normal.dot(ray.direction);
    (cosine > MIN_MIRROR_COSINE).then(|| EnvironmentRay {
        origin,
        direction: ray.direction + 2.0 * cosine * normal,
        attenuation: DVec3::from_array(sphere.reflectance.map(f64::from)),
        mirrored: true,
    })
}

/// Unit direction in the camera's frame; `None` outside the field of view.
fn fisheye_direction(lens: &FisheyeLens, pixel: DVec2) -> Option<DVec3> {
    let offset = pixel - lens.centre;
    let theta = theta_from_radius(lens, offset.length());
    let around = offset.normalize_or_zero();
    // Two pixels at the rim of the image circle are dark and coloured.
    (theta <= lens.max_theta - 2.0 / lens.focal).then(|| (theta.sin() * around).extend(theta.cos()))
}

/// Inverse of r = f · (θ + k1 θ³ + …) by Newton's method.
fn theta_from_radius(lens: &FisheyeLens, radius: f64) -> f64 {
    let target = radius / lens.focal;
    let [k1, k2, k3, k4] = lens.distortion;
    let mut theta = target;
    for _ in 0..12 {
        let t2 = theta * theta;
        let value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))));
        let slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)));
        if slope <= 1e-6 {
            return f64::INFINITY;
        }
        theta -= (value - target) / slope;
    }
    theta
}

#[cfg(test)]
mod tests {

    use super::*;
    use penumbra_camera::PinholeCamera;
    use proptest::prelude::*;

    fn lens(distortion: [f64; 4]) -> FisheyeLens {
        FisheyeLens {
            width: 480,
            height: 480,
            focal: 150.0,
            centre: DVec2::splat(239.5),
            distortion,
            max_theta: std::f64::consts::FRAC_PI_2,
        }
    }

    #[test]
    fn fisheye_maps_its_centre_to_the_axis_and_its_rim_to_the_side() {
        let lens = lens([0.0; 4]);
        let ahead = fisheye_direction(&lens, lens.centre).unwrap();
        assert!(ahead.distance(DVec3::Z) < 1e-12);
        let side = lens.centre + DVec2::new(150.0 * 1.5, 0.0);
        let side = fisheye_direction(&lens, side).unwrap();
        assert!(side.distance(DVec3::new(1.5f64.sin(), 0.0, 1.5f64.cos())) < 1e-12);
        assert_eq!(fisheye_direction(&lens, DVec2::new(2.0, 239.5)), None);
    }

    #[test]
    fn sphere_reflects_the_central_ray_back() {
        let sphere = MirrorSphere {
            centre_in_world: DVec3::new(0.0, 0.0, 1.0),
            radius: 0.1,
            position_sigma: 0.0,
            reflectance: [0.9, 0.8, 0.7],
            in_scene: false,
        };
        let view = EnvironmentView::Sphere {
            camera: PinholeCamera {
                width: 101,
                height: 101,
                focal: DVec2::splat(100.0),
                centre: DVec2::splat(50.0),
                distortion: [0.0; 5],
            },
            world_from_camera: RigidTransform::IDENTITY,
            sphere,
        };
        let back = environment_ray(&view, DVec2::splat(50.0)).unwrap();
        assert!(back.origin.distance(DVec3::new(0.0, 0.0, 0.9)) < 1e-12);
        assert!(back.direction.distance(DVec3::NEG_Z) < 1e-12);
        assert!(back.attenuation.distance(DVec3::new(0.9, 0.8, 0.7)) < 1e-6);
        // A ray far from the sphere passes it.
        let beside = environment_ray(&view, DVec2::splat(20.0)).unwrap();
        assert!(!beside.mirrored);
        let rim = environment_ray(&view, DVec2::new(60.0, 50.0));
        assert_eq!(rim, None);
    }

    proptest! {
        #[test]
        fn inverts_the_distortion_of_the_lens(theta in 0.01f64..1.5, k1 in -0.05f64..0.05) {
            let lens = lens([k1, 0.002, -0.001, 0.0]);
            let t2 = theta * theta;
            let r = theta * (1.0 + t2 * (k1 + t2 * (0.002 - t2 * 0.001)));
            prop_assert!((theta_from_radius(&lens, 150.0 * r) - theta).abs() < 1e-6);
        }
    }
}
