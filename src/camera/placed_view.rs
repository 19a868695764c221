//! Where each direction of the world stands in the environment camera's picture.

use super::mirror::Mirror;
use crate::PinholeCamera;
use crate::{EnvironmentView, FisheyeLens, MirrorSphere};
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;
use std::ops::Range;

/// Smallest cosine of incidence on a mirrored sphere that is used: the outermost 1.5 % of
/// its radius is left out.
const LEAST_COSINE: f64 = 0.17;

/// Pixels next to a mirrored sphere's rim that are never used, and how many standard deviations of
/// its place more: what lies behind it is not light that it mirrors.
const RIM_PIXELS: f64 = 0.6;
const RIM_SIGMAS: f64 = 3.0;

/// What is known of the room, for light that is seen from one place and needed in another.
///
/// Without it the environment is taken to be infinitely far away (Supan 2006, section IV).
/// With it, light is carried from the point that saw it to `reference` by way of a sphere
/// of `radius` around `reference`, cut off by the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parallax {
    /// Where the light is needed: the middle of the virtual objects, world, metres.
    pub reference: DVec3,
    /// Distance of what surrounds it, metres.
    pub radius: f64,
    /// Height of the ground, metres, if there is one (below `reference`).
    pub ground_height: Option<f64>,
}

impl Parallax {
    /// Direction, seen from the reference, of what is seen from `origin` along
    /// `direction`.
    fn carry(&self, origin: DVec3, direction: DVec3) -> DVec3 {
        let from_reference = origin - self.reference;
        let b = from_reference.dot(direction);
        let c = from_reference.length_squared() - self.radius * self.radius;
        if c >= 0.0 {
            return direction;
        }
        let to_ground = self
            .ground_height
            .and_then(|h| hit_ground(origin, direction, h));
        let t = (-b + (b * b - c).sqrt()).min(to_ground.unwrap_or(f64::INFINITY));
        (from_reference + direction * t).normalize()
    }

    /// The surrounding point that the reference sees along `direction`.
    fn surrounding_point(&self, direction: DVec3) -> DVec3 {
        let to_ground = self
            .ground_height
            .and_then(|h| hit_ground(self.reference, direction, h));
        self.reference + direction * self.radius.min(to_ground.unwrap_or(f64::INFINITY))
    }
}

fn hit_ground(origin: DVec3, direction: DVec3, height: f64) -> Option<f64> {
    (direction.z < -1e-9 && origin.z > height).then(|| (height - origin.z) / direction.z)
}

/// A ray of light backwards: from the place that saw it towards where it came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRay {
    /// The camera's centre, or the point of the mirror, world, metres.
    pub origin: DVec3,
    /// Unit vector, world.
    pub direction: DVec3,
}

#[derive(Clone, Debug)]
enum Optics {
    Fisheye(FisheyeLens),
    Mirror {
        camera: PinholeCamera,
        mirror: Mirror,
    },
}

/// The environment camera placed in the world: pixels to directions and back.
#[derive(Clone, Debug)]
pub struct PlacedView {
    optics: Optics,
    world_from_camera: RigidTransform,
    camera_from_world: RigidTransform,
    parallax: Option<Parallax>,
    size: (u32, u32),
}

impl PlacedView {
    /// Places a view. `scene` (pose and intrinsics of the scene camera) is needed for a
    /// sphere in the scene camera's picture only. `None` where it is missing, or where
    /// the eye is inside the sphere.
    #[must_use]
    pub fn new(
        view: &EnvironmentView,
        scene: Option<(RigidTransform, &PinholeCamera)>,
        parallax: Option<Parallax>,
    ) -> Option<Self> {
        match view {
            EnvironmentView::Fisheye {
                lens,
                world_from_camera,
            } => Some(Self {
                size: (lens.width, lens.height),
                optics: Optics::Fisheye(lens.clone()),
                world_from_camera: *world_from_camera,
                camera_from_world: world_from_camera.inverse(),
                parallax,
            }),
            EnvironmentView::Sphere {
                camera,
                world_from_camera,
                sphere,
            } => Self::mirrored(camera, *world_from_camera, sphere, parallax),
            EnvironmentView::SphereInScene { sphere } => {
                let (world_from_camera, camera) = scene?;
                Self::mirrored(camera, world_from_camera, sphere, parallax)
            }
        }
    }

    /// A sphere in the scene camera's picture, `sigma` pixels (standard deviation) from where it
    /// is said to be: so wide a rim is left out that no background gets in.
    #[must_use]
    pub fn beside_rim(
        sphere: &MirrorSphere,
        (world_from_camera, camera): (RigidTransform, &PinholeCamera),
        sigma: f64,
        parallax: Option<Parallax>,
    ) -> Option<Self> {
        let ball = crate::mirror::Ball {
            centre: world_from_camera
                .inverse()
                .transform_point(sphere.centre_in_world),
            radius: sphere.radius,
            sigma,
        };
        // A ray that passes the centre at the share f of the radius meets the sphere at an angle whose
        // sine is f.
        let left_out = (RIM_PIXELS + RIM_SIGMAS * sigma) / ball.radius_in_pixels(camera);
        let used = 1.0 - left_out;
        if used.is_nan() || used <= 0.2 {
            return None;
        }
        let cosine = (1.0 - used * used).max(0.0).sqrt().max(LEAST_COSINE);
        Self::mirrored_past(camera, world_from_camera, sphere, parallax, cosine)
    }

    fn mirrored(
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        sphere: &MirrorSphere,
        parallax: Option<Parallax>,
    ) -> Option<Self> {
        Self::mirrored_past(camera, world_from_camera, sphere, parallax, LEAST_COSINE)
    }

    fn mirrored_past(
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        sphere: &MirrorSphere,
        parallax: Option<Parallax>,
        least_cosine: f64,
    ) -> Option<Self> {
        let eye = world_from_camera.translation;
        let mirror = Mirror::new(eye, sphere.centre_in_world, sphere.radius, least_cosine)?;
        Some(Self {
            size: (camera.width, camera.height),
            optics: Optics::Mirror {
                camera: camera.clone(),
                mirror,
            },
            world_from_camera,
            camera_from_world: world_from_camera.inverse(),
            parallax,
        })
    }

    /// Width and height of the picture, pixels.
    #[must_use]
    pub const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Columns and rows that contain everything of use.
    #[must_use]
    pub fn bounds(&self) -> (Range<u32>, Range<u32>) {
        let (width, height) = self.size;
        let Optics::Mirror { camera, mirror } = &self.optics else {
            return (0..width, 0..height);
        };
        let rim = mirror
            .rim()
            .map(|p| self.camera_from_world.transform_point(p));
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        if rim.iter().all(|p| p.z <= 0.0) {
            return (0..0, 0..0);
        }
        for point in rim {
            let Some(pixel) = camera.project(point) else {
                return (0..width, 0..height);
            };
            (low, high) = (low.min(pixel), high.max(pixel));
        }
        // Between two points of the rim it reaches beyond both by less than 1 % of its width.
        let margin = 0.01 * (high - low) + 2.0;
        let range = |low: f64, high: f64, end: u32| {
            let low = low.floor().clamp(0.0, f64::from(end)) as u32;
            low..high.ceil().clamp(f64::from(low), f64::from(end)) as u32
        };
        (
            range(low.x - margin.x, high.x + margin.x, width),
            range(low.y - margin.y, high.y + margin.y, height),
        )
    }

    /// Centre and radius of the mirrored sphere, world, metres.
    #[must_use]
    pub const fn ball(&self) -> Option<(DVec3, f64)> {
        match &self.optics {
            Optics::Mirror { mirror, .. } => Some(mirror.ball()),
            Optics::Fisheye(_) => None,
        }
    }

    /// Radians of light that a pixel of a mirrored sphere shows across its rim, where it shows
    /// `direction` (any parallax aside): 2 t / (f R cos i) at the distance t under the angle of
    /// incidence i. A pixel near the rim is a long, thin strip of directions. `None` for a
    /// fisheye, and where the sphere hides the direction.
    #[must_use]
    pub fn stretch(&self, direction: DVec3) -> Option<f64> {
        let Optics::Mirror { camera, mirror } = &self.optics else {
            return None;
        };
        let (cosine, distance) = mirror.incidence(direction);
        let (_, radius) = mirror.ball();
        let across = camera.focal.min_element() * radius * cosine;
        (cosine > 1e-3).then(|| 2.0 * distance / across)
    }

    /// Samples a side that a cube of `size` texels needs of a mirror: a pixel in the middle
    /// of a ball of r pixels spans 2/r radians, a texel 2/size.
    #[must_use]
    pub fn samples_for(&self, size: u32) -> u32 {
        let (columns, rows) = self.bounds();
        let radius = f64::from(columns.len().min(rows.len()) as u32) / 2.0;
        ((radius / f64::from(size)).round() as u32).clamp(1, 8)
    }

    /// The ray from the camera itself through a pixel of a mirrored view.
    #[must_use]
    pub fn camera_ray(&self, pixel: DVec2) -> Option<ViewRay> {
        let Optics::Mirror { camera, .. } = &self.optics else {
            return None;
        };
        Some(ViewRay {
            origin: self.world_from_camera.translation,
            direction: self.world_from_camera.rotation * camera.unproject(pixel),
        })
    }

    /// The ray that a pixel sees, before any parallax; `None` where it sees nothing of use.
    #[must_use]
    pub fn ray(&self, pixel: DVec2) -> Option<ViewRay> {
        let to_world = |d: DVec3| self.world_from_camera.rotation * d;
        match &self.optics {
            Optics::Fisheye(lens) => Some(ViewRay {
                origin: self.world_from_camera.translation,
                direction: to_world(lens.unproject(pixel)?),
            }),
            Optics::Mirror { camera, mirror } => {
                let seen = mirror.reflect(to_world(camera.unproject(pixel)))?;
                Some(ViewRay {
                    origin: seen.point,
                    direction: seen.direction,
                })
            }
        }
    }

    /// Unit direction, world, of the light that a pixel shows.
    #[must_use]
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.ray(pixel)?;
        Some(match &self.parallax {
            Some(parallax) => parallax.carry(ray.origin, ray.direction),
            None => ray.direction,
        })
    }

    /// Pixel that shows the light from a direction; it may lie outside the picture.
    #[must_use]
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        let target = self.parallax.map(|p| p.surrounding_point(direction));
        match &self.optics {
            Optics::Fisheye(lens) => {
                let origin = self.world_from_camera.translation;
                let direction = target.map_or(direction, |q| (q - origin).normalize());
                lens.project(self.camera_from_world.rotation * direction)
            }
            Optics::Mirror { camera, mirror } => {
                let point = match target {
                    None => mirror.point_showing(direction)?,
                    Some(q) => point_showing_near(mirror, direction, q)?,
                };
                camera.project(self.camera_from_world.transform_point(point))
            }
        }
    }
}

/// The point of the mirror that shows `target`: the direction of the light depends on the
/// point and the point on the direction, which converges fast as the mirror is small.
fn point_showing_near(mirror: &Mirror, direction: DVec3, target: DVec3) -> Option<DVec3> {
    let mut point = mirror.point_showing(direction)?;
    for _ in 0..24 {
        let next = mirror.point_showing((target - point).normalize())?;
        let step = next.distance(point);
        point = next;
        if step < 1e-7 {
            break;
        }
    }
    Some(point)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;

    #[test]
    fn a_pixel_near_the_rim_shows_a_long_strip() {
        let view = PlacedView::new(&sphere_view(), None, None).unwrap();
        let (centre, _) = view.ball().unwrap();
        let middle = view
            .pixel((view.world_from_camera.translation - centre).normalize())
            .unwrap();
        let mut last = 0.0;
        for away in [0.0, 40.0, 80.0, 120.0, 160.0] {
            let at = middle + DVec2::X * away;
            let Some(direction) = view.direction(at) else {
                break;
            };
            let next = view.direction(at + DVec2::X * 0.01).unwrap();
            let told = view.stretch(direction).unwrap();
            let exact = direction.angle_between(next) / 0.01;
            // The ray's own turn and the slant of the picture's plane are left out.
            assert!((told / exact - 1.0).abs() < 0.12, "{away}: {told} {exact}");
            assert!(told > last);
            last = told;
        }
        assert!(last > 0.0);
    }

    fn sphere_view() -> EnvironmentView {
        let forward = DVec3::new(-0.43, 0.66, -0.61).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let rotation = DMat3::from_cols(right, forward.cross(right), forward);
        let eye = DVec3::new(0.33, -0.16, 0.28);
        EnvironmentView::Sphere {
            camera: PinholeCamera {
                width: 480,
                height: 480,
                focal: DVec2::splat(2150.0),
                centre: DVec2::new(238.7, 240.4),
                distortion: [0.01, -0.02, 0.001, 0.0, 0.0],
            },
            world_from_camera: RigidTransform::new(glam::DQuat::from_mat3(&rotation), eye),
            sphere: MirrorSphere {
                centre_in_world: eye + forward * 0.39,
                radius: 0.03,
                reflectance: [0.9; 3],
                in_scene: false,
            },
        }
    }

    fn ball_centre() -> DVec3 {
        match sphere_view() {
            EnvironmentView::Sphere { sphere, .. } => sphere.centre_in_world,
            _ => unreachable!(),
        }
    }

    fn room() -> Parallax {
        Parallax {
            reference: DVec3::new(0.0, 0.0, 0.05),
            radius: 2.0,
            ground_height: Some(0.0),
        }
    }

    proptest! {
        #[test]
        fn direction_to_pixel_to_direction(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, near: bool) {
            let direction = DVec3::new(x, y, z);
            prop_assume!(direction.length() > 0.1);
            let direction = direction.normalize();
            let placed = PlacedView::new(&sphere_view(), None, near.then(room)).unwrap();
            // Ground next to the ball is seen by the ball at more than one place, or not.
            let beside = room().surrounding_point(direction).distance(ball_centre()) < 0.12;
            prop_assume!(!(near && beside));
            if let Some(pixel) = placed.pixel(direction) {
                let back = placed.direction(pixel);
                // The limit of incidence may fall between the two.
                if let Some(back) = back {
                    prop_assert!((back - direction).length() < 2e-3, "{direction} {back}");
                }
            }
        }
    }

    #[test]
    fn most_of_the_sphere_of_directions_is_seen() {
        let placed = PlacedView::new(&sphere_view(), None, None).unwrap();
        // A Fibonacci lattice: directions that each stand for the same solid angle.
        let (count, turn) = (4000, std::f64::consts::PI * (3.0 - 5.0_f64.sqrt()));
        let seen = (0..count).filter(|&i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
            let (sin, cos) = (f64::from(i) * turn).sin_cos();
            let r = (1.0 - z * z).sqrt();
            placed.pixel(DVec3::new(r * cos, r * sin, z)).is_some()
        });
        let share = seen.count() as f64 / f64::from(count);
        assert!(share > 0.95, "{share} of all directions");
    }

    #[test]
    fn the_bounds_hold_all_that_the_ball_shows_and_little_more() {
        for far in [0.39, 0.12, 0.05] {
            let mut view = sphere_view();
            if let EnvironmentView::Sphere {
                camera,
                world_from_camera,
                sphere,
            } = &mut view
            {
                // Off the axis, where the outline is stretched.
                let aside = world_from_camera.rotation * DVec3::new(0.25, -0.1, 1.0).normalize();
                sphere.centre_in_world = world_from_camera.translation + aside * far;
                camera.focal = DVec2::splat(300.0 * far / 0.39);
            }
            let placed = PlacedView::new(&view, None, None).unwrap();
            let (columns, rows) = placed.bounds();
            let shows = |x: u32, y: u32| {
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                placed.direction(pixel).is_some()
            };
            let all = (0..480 * 480).filter(|i| shows(i % 480, i / 480)).count();
            let inside = rows
                .clone()
                .flat_map(|y| columns.clone().map(move |x| (x, y)));
            let kept = inside.filter(|(x, y)| shows(*x, *y)).count();
            assert_eq!(all, kept, "{far} m: {columns:?} {rows:?}");
            // A disc fills π/4 of its box, less two pixels on each side.
            let room = (columns.len() - 6) * (rows.len() - 6);
            assert!(all as f64 > 0.68 * room as f64, "{far} m: {all} of {room}");
        }
    }

    #[test]
    fn a_sphere_in_the_scene_needs_the_scene_camera() {
        let EnvironmentView::Sphere { sphere, .. } = sphere_view() else {
            unreachable!()
        };
        let view = EnvironmentView::SphereInScene { sphere };
        assert!(PlacedView::new(&view, None, None).is_none());
    }
}
