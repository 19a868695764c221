//! Maps directions of the world to pixels of the environment camera's picture and back.

use super::mirror::{Mirror, MirroredView};
use crate::PinholeCamera;
use crate::{EnvironmentView, FisheyeLens, MirrorSphere};
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;
use std::ops::Range;

/// Minimum cosine of incidence on a mirrored sphere: excludes the outermost 1.5 % of its radius.
const MIN_COSINE: f64 = 0.17;

/// Width of the margin at a mirrored sphere's rim that is not used, pixels; widened by
/// [`RIM_SIGMAS`] standard deviations of the sphere's position. The margin excludes the background.
const RIM_PIXELS: f64 = 0.6;
const RIM_SIGMAS: f64 = 3.0;

/// Model of the surroundings, for light that is observed at one position and needed at another.
///
/// Without it the environment is infinitely distant (Supan 2006, section IV). With it, light is
/// moved from the observing point to `reference` by intersecting its ray with a sphere of `radius`
/// around `reference`, cut off by the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parallax {
    /// Position at which the light is needed: the centre of the virtual objects, world, metres.
    pub reference: DVec3,
    /// Assumed distance of the surroundings, metres.
    pub radius: f64,
    /// Height of the ground (below `reference`), metres; `None` without ground.
    pub ground_height: Option<f64>,
}

impl Parallax {
    /// Returns the direction, from the reference, of the surrounding point that lies along
    /// `direction` from `origin`.
    fn direction_from_reference(&self, origin: DVec3, direction: DVec3) -> DVec3 {
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

    /// Returns the surrounding point along `direction` from the reference.
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

/// A ray of light, traced backwards: from the observing point towards the source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRay {
    /// The camera's centre, or the point of reflection, world, metres.
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

/// The environment camera at its pose in the world: pixels to directions and back.
#[derive(Clone, Debug)]
pub struct PlacedView {
    optics: Optics,
    world_from_camera: RigidTransform,
    camera_from_world: RigidTransform,
    parallax: Option<Parallax>,
    size: (u32, u32),
}

impl PlacedView {
    /// Creates a view. `scene` (pose `world_from_camera` and intrinsics of the scene camera) is
    /// needed only for a sphere in the scene camera's picture. `None` if it is missing, or if the
    /// camera is inside the sphere.
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

    /// Creates a view of a sphere in the scene camera's picture whose position has the standard
    /// deviation `sigma` (pixels). The margin at its rim is wide enough to exclude the background.
    /// `None` if too little of the sphere is left.
    #[must_use]
    pub fn within_rim(
        sphere: &MirrorSphere,
        (world_from_camera, camera): (RigidTransform, &PinholeCamera),
        sigma: f64,
        parallax: Option<Parallax>,
    ) -> Option<Self> {
        let ball = crate::mirror::SphereInCamera {
            centre: world_from_camera
                .inverse()
                .transform_point(sphere.centre_in_world),
            radius: sphere.radius,
            sigma,
        };
        // A ray that passes the centre at the share f of the radius has an angle of incidence whose
        // sine is f.
        let margin = (RIM_PIXELS + RIM_SIGMAS * sigma) / ball.radius_in_pixels(camera);
        let used = 1.0 - margin;
        if used.is_nan() || used <= 0.2 {
            return None;
        }
        let cosine = (1.0 - used * used).max(0.0).sqrt().max(MIN_COSINE);
        Self::mirrored_within(camera, world_from_camera, sphere, parallax, cosine)
    }

    fn mirrored(
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        sphere: &MirrorSphere,
        parallax: Option<Parallax>,
    ) -> Option<Self> {
        Self::mirrored_within(camera, world_from_camera, sphere, parallax, MIN_COSINE)
    }

    fn mirrored_within(
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        sphere: &MirrorSphere,
        parallax: Option<Parallax>,
        min_cosine: f64,
    ) -> Option<Self> {
        let eye = world_from_camera.translation;
        let mirror = Mirror::new(eye, sphere.centre_in_world, sphere.radius, min_cosine)?;
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

    /// Columns and rows that contain all usable pixels.
    #[must_use]
    pub fn bounds(&self) -> (Range<u32>, Range<u32>) {
        let (width, height) = self.size;
        let Optics::Mirror { camera, mirror } = &self.optics else {
            return (0..width, 0..height);
        };
        let silhouette = mirror
            .silhouette()
            .map(|p| self.camera_from_world.transform_point(p));
        let mut low = DVec2::INFINITY;
        let mut high = DVec2::NEG_INFINITY;
        if silhouette.iter().all(|p| p.z <= 0.0) {
            return (0..0, 0..0);
        }
        for point in silhouette {
            let Some(pixel) = camera.project(point) else {
                return (0..width, 0..height);
            };
            (low, high) = (low.min(pixel), high.max(pixel));
        }
        // Between two of its points the silhouette extends beyond both by less than 1 % of its width.
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

    /// Centre and radius of the mirrored sphere, world, metres; `None` for a fisheye.
    #[must_use]
    pub const fn sphere(&self) -> Option<(DVec3, f64)> {
        match &self.optics {
            Optics::Mirror { mirror, .. } => Some(mirror.ball()),
            Optics::Fisheye(_) => None,
        }
    }

    /// Returns the mirrored sphere and the eye that sees it; `None` for a fisheye.
    #[must_use]
    pub const fn mirrored_view(&self) -> Option<MirroredView> {
        match &self.optics {
            Optics::Mirror { mirror, .. } => Some(mirror.view()),
            Optics::Fisheye(_) => None,
        }
    }

    /// Returns the angle of directions (radians), in the radial direction, that a pixel of a mirrored
    /// sphere covers around `direction` (without parallax): 2 t / (f R cos i) at the distance t and
    /// the angle of incidence i. Near the rim a pixel covers a long, thin strip of directions.
    /// `None` for a fisheye, and where the sphere itself hides the direction.
    #[must_use]
    pub fn pixel_angle(&self, direction: DVec3) -> Option<f64> {
        let Optics::Mirror { camera, mirror } = &self.optics else {
            return None;
        };
        let (cosine, distance) = mirror.incidence(direction);
        let (_, radius) = mirror.ball();
        let across = camera.focal.min_element() * radius * cosine;
        (cosine > 1e-3).then(|| 2.0 * distance / across)
    }

    /// Number of samples per texel side of a cube map of `size` texels: a pixel in the centre of a
    /// sphere of r pixels spans 2/r radians, a texel 2/size.
    #[must_use]
    pub fn samples_for(&self, size: u32) -> u32 {
        let (columns, rows) = self.bounds();
        let radius = f64::from(columns.len().min(rows.len()) as u32) / 2.0;
        ((radius / f64::from(size)).round() as u32).clamp(1, 8)
    }

    /// Returns the ray from the camera through a pixel of a mirrored view; `None` for a fisheye.
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

    /// Returns the ray of the light in a pixel, without parallax; `None` for an unusable pixel.
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

    /// Returns the unit direction (world) of the light in a pixel; `None` for an unusable pixel.
    #[must_use]
    pub fn direction(&self, pixel: DVec2) -> Option<DVec3> {
        let ray = self.ray(pixel)?;
        Some(match &self.parallax {
            Some(parallax) => parallax.direction_from_reference(ray.origin, ray.direction),
            None => ray.direction,
        })
    }

    /// Returns the pixel that shows the light from a direction; it may lie outside the picture.
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

/// Returns the point of the mirror that reflects `target`, by fixed-point iteration: the direction of
/// the light depends on the point and vice versa. It converges fast because the mirror is small.
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
    use super::*;
    use glam::DMat3;
    use proptest::prelude::*;

    #[test]
    fn pixels_near_the_rim_cover_larger_angles() {
        let view = PlacedView::new(&sphere_view(), None, None).unwrap();
        let (centre, _) = view.sphere().unwrap();
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
            let stretch = view.pixel_angle(direction).unwrap();
            let exact = direction.angle_between(next) / 0.01;
            // The formula neglects the rotation of the ray and the slant of the picture plane.
            assert!(
                (stretch / exact - 1.0).abs() < 0.12,
                "{away}: {stretch} {exact}"
            );
            assert!(stretch > last);
            last = stretch;
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
                position_sigma: 0.0,
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
        fn direction_inverts_pixel(x in -1.0f64..1.0, y in -1.0f64..1.0, z in -1.0f64..1.0, near: bool) {
            let direction = DVec3::new(x, y, z);
            prop_assume!(direction.length() > 0.1);
            let direction = direction.normalize();
            let placed = PlacedView::new(&sphere_view(), None, near.then(room)).unwrap();
            // The sphere reflects the ground beside it at several points, or nowhere.
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
    fn sphere_shows_most_directions() {
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
    fn bounds_enclose_the_sphere_tightly() {
        for far in [0.39, 0.12, 0.05] {
            let mut view = sphere_view();
            if let EnvironmentView::Sphere {
                camera,
                world_from_camera,
                sphere,
            } = &mut view
            {
                // Off the axis, where the silhouette is elongated.
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
            // A disc fills π/4 of its bounding box, which has two more pixels on each side.
            let room = (columns.len() - 6) * (rows.len() - 6);
            assert!(all as f64 > 0.68 * room as f64, "{far} m: {all} of {room}");
        }
    }

    #[test]
    fn sphere_in_the_scene_requires_the_scene_camera() {
        let EnvironmentView::Sphere { sphere, .. } = sphere_view() else {
            unreachable!()
        };
        let view = EnvironmentView::SphereInScene { sphere };
        assert!(PlacedView::new(&view, None, None).is_none());
    }
}
