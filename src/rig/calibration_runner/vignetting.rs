//! Vignetting of a moving camera, from surfaces that it sees in different parts of the picture.

use glam::DVec2;
use glam::DVec3;
use penumbra_calibration::radiometric::vignetting;
use penumbra_calibration::radiometric::vignetting::{Reading, VignettingFit};
use penumbra_camera::PinholeCamera;
use penumbra_camera::vignetting::default_frame;
use penumbra_interface::RigidTransform;
use penumbra_scene::RayCaster;
use penumbra_white_balance::chart::{Photograph, read_codes};

/// Columns and rows of pixels at which a new picture adds surface points.
const GRID: (u32, u32) = (16, 12);
/// Half the side of the block that is read, pixels.
const HALF_BLOCK: f64 = 3.0;
/// Standard deviation of the radiance of a matt surface between viewing directions, relative.
const DIRECTION_SIGMA: f64 = 0.02;
/// Maximum standard deviation within a block of an even surface, relative.
const MAX_CONTRAST: f64 = 0.10;
/// Maximum number of surface points.
const MAX_POINTS: usize = 1200;

/// Minimum share of readings that fit.
const MIN_USED: f64 = 0.8;
/// Maximum root mean square of the residuals, relative.
const MAX_RMS: f64 = 0.03;
/// Maximum standard deviation of the vignetting at the edge.
const MAX_EDGE_SIGMA: f64 = 0.015;

/// Points of real surfaces, and readings of their brightness.
#[derive(Debug, Default)]
pub(super) struct VignettingCollector {
    points: Vec<DVec3>,
    readings: Vec<Reading>,
    pictures: usize,
}

impl VignettingCollector {
    /// Reads the brightness of the surface points in a picture that was taken at the pose
    /// `world_from_camera`.
    pub fn observe(
        &mut self,
        photograph: Photograph,
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        rays: &RayCaster,
    ) {
        if (photograph.picture.width, photograph.picture.height) != (camera.width, camera.height) {
            return;
        }
        self.add_points(camera, world_from_camera, rays);
        let camera_from_world = world_from_camera.inverse();
        let (centre, radius) = default_frame((camera.width, camera.height), Some(camera.centre));
        for (group, point) in self.points.iter().enumerate() {
            let Some(pixel) = camera.project(camera_from_world.transform_point(*point)) else {
                continue;
            };
            if !is_visible(rays, world_from_camera.translation, *point) {
                continue;
            }
            let Some((log, variance)) = read_block(photograph, pixel) else {
                continue;
            };
            self.readings.push(Reading {
                group,
                picture: self.pictures,
                q: (pixel - centre).length_squared() / (radius * radius),
                log,
                variance: variance + DIRECTION_SIGMA * DIRECTION_SIGMA,
            });
        }
        self.pictures += 1;
    }

    /// Adds the surface points at the pixels of the grid.
    fn add_points(
        &mut self,
        camera: &PinholeCamera,
        world_from_camera: RigidTransform,
        rays: &RayCaster,
    ) {
        if self.points.len() >= MAX_POINTS {
            return;
        }
        for j in 0..GRID.1 {
            for i in 0..GRID.0 {
                let share = |k: u32, n: u32| (f64::from(k) + 0.5) / f64::from(n);
                let pixel = DVec2::new(
                    share(i, GRID.0) * f64::from(camera.width),
                    share(j, GRID.1) * f64::from(camera.height),
                );
                let direction = world_from_camera.rotation * camera.unproject(pixel);
                let hit = rays.nearest(world_from_camera.translation, direction);
                if let Some(hit) = hit.filter(|hit| !hit.mirror) {
                    self.points.push(hit.point);
                }
            }
        }
    }

    /// Fits the vignetting; `None` if the readings are inconsistent, e.g. because the light
    /// changed, surfaces are glossy or poses are wrong.
    pub fn fit(&self) -> Option<VignettingFit> {
        vignetting::fit(&self.readings)
            .filter(|f| f.used > MIN_USED && f.rms < MAX_RMS && f.edge_sigma < MAX_EDGE_SIGMA)
    }
}

fn is_visible(rays: &RayCaster, camera: DVec3, point: DVec3) -> bool {
    let (direction, distance) = (point - camera).normalize_and_length();
    rays.nearest(camera, direction)
        .is_some_and(|hit| (hit.distance - distance).abs() < 0.002 + 0.005 * distance)
}

/// Returns the logarithm of the mean linear green of the block around a pixel, and its variance;
/// `None` if the block is not entirely inside the picture, clipped or uneven.
fn read_block(photograph: Photograph, pixel: DVec2) -> Option<(f64, f64)> {
    let picture = photograph.picture;
    let (low, high) = (pixel - HALF_BLOCK, pixel + HALF_BLOCK);
    let inside = low.x >= 0.0
        && low.y >= 0.0
        && high.x < f64::from(picture.width) - 1.0
        && high.y < f64::from(picture.height) - 1.0;
    if !inside {
        return None;
    }
    let rows = low.y.round() as u32..=high.y.round() as u32;
    let columns = low.x.round() as u32..=high.x.round() as u32;
    let codes: Vec<u8> = rows
        .flat_map(|y| columns.clone().map(move |x| (x, y)))
        .map(|(x, y)| picture.rgb(x, y)[1])
        .collect();
    let reading = read_codes(&codes, photograph.response)?;
    let square = reading.mean * reading.mean;
    (reading.variance < MAX_CONTRAST * MAX_CONTRAST * square)
        .then(|| (reading.mean.ln(), reading.variance_of_mean / square))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};
    use penumbra_camera::Response;
    use penumbra_camera::Vignetting;
    use penumbra_picture::Picture;
    use penumbra_scene::Scene;

    /// Renders a table with a smooth pattern from above, through a lens with vignetting `k`.
    fn picture(camera: &PinholeCamera, pose: RigidTransform, k: [f64; 3]) -> Picture {
        let (centre, radius) = default_frame((camera.width, camera.height), Some(camera.centre));
        let lens = Vignetting {
            centre,
            radius,
            coefficients: k,
            sigma: [0.0; 3],
        };
        let mut rgba = Vec::new();
        for y in 0..camera.height {
            for x in 0..camera.width {
                let pixel = DVec2::new(f64::from(x), f64::from(y));
                let ray = pose.rotation * camera.unproject(pixel);
                let p = pose.translation - ray * (pose.translation.z / ray.z);
                let albedo = 0.4 + 0.15 * (3.0 * p.x).sin() * (2.0 * p.y).cos();
                let code = Response::srgb().code_from_linear((albedo * lens.at(pixel)) as f32);
                rgba.extend([code, code, code, 255]);
            }
        }
        Picture {
            width: camera.width,
            height: camera.height,
            rgba,
        }
    }

    #[test]
    fn recovers_vignetting_from_a_moving_camera() {
        let camera = PinholeCamera {
            width: 320,
            height: 240,
            focal: DVec2::splat(300.0),
            centre: DVec2::new(160.0, 121.0),
            distortion: [0.0; 5],
        };
        let scene = Scene {
            ground_height: Some(0.0),
            ..Scene::default()
        };
        let rays = RayCaster::from_phantoms(&scene);
        let down = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z));
        for k in [[-0.35, 0.0, 0.0], [0.0; 3]] {
            let mut collector = VignettingCollector::default();
            for i in 0..10 {
                let t = f64::from(i);
                let at = DVec3::new(0.25 * (1.3 * t).sin(), 0.2 * (0.9 * t).cos(), 1.0);
                let pose = RigidTransform::new(down, at);
                let picture = picture(&camera, pose, k);
                let photograph = Photograph {
                    picture: &picture,
                    response: &Response::srgb(),
                };
                collector.observe(photograph, &camera, pose, &rays);
            }
            let found = collector.fit().unwrap();
            let truth = 1.0 + k[0] * found.max_rho_squared;
            assert!((found.edge_brightness() - truth).abs() < 0.01, "{found:?}");
        }
        assert_eq!(VignettingCollector::default().fit(), None);
    }
}
