//! What the scene camera's picture shows of real surfaces.

use crate::light::view::SceneView;
use glam::{DVec2, Vec3};
use penumbra_camera::{Response, Vignetting};
use penumbra_interface::RigidTransform;
use penumbra_lighting::lamp_distance::{SeenSurfaces, SurfacePoint};
use penumbra_lighting::sources::LUMINANCE;
use penumbra_rig_model::SceneCamera;
use penumbra_scene::RayCaster;

/// Columns of the grid of points: more would make the search longer, not better.
const COLUMNS: u32 = 107;
/// Least number of pixels between the points of the grid, along x and y.
const SPACING: u32 = 6;
/// Half the side of the square over which a point's luminance is averaged, pixels.
const AROUND: u32 = 2;
/// Luminance below which a pixel is too noisy, and code from which it may be clipped.
const DARKEST: f32 = 0.004;
const BRIGHTEST_CODE: u8 = 250;

/// How the scene camera sees light.
pub(super) struct Sight {
    response: Response,
    vignetting: Option<Vignetting>,
}

impl Sight {
    pub fn new(camera: &SceneCamera) -> Self {
        Self {
            response: camera.response.clone(),
            vignetting: camera.vignetting,
        }
    }

    /// Whether a picture has the size for which the camera is calibrated.
    pub const fn fits(scene: &SceneView<'_>) -> bool {
        let (picture, camera) = (scene.picture, scene.camera);
        picture.width == camera.width && picture.height == camera.height
    }

    /// Notes what a picture, taken from `pose`, shows of real surfaces, on a grid.
    pub fn see(
        &self,
        scene: &SceneView<'_>,
        pose: RigidTransform,
        rays: &RayCaster,
        surfaces: &mut SeenSurfaces,
    ) {
        let camera = scene.camera;
        let spacing = SPACING.max(camera.width.div_ceil(COLUMNS));
        let steps =
            |length: u32| (spacing / 2..length.saturating_sub(AROUND)).step_by(spacing as usize);
        let width = steps(camera.width).count();
        let all = steps(camera.height)
            .flat_map(|y| steps(camera.width).map(move |x| (x, y)))
            .map(|(x, y)| self.point(scene, pose, rays, (x, y)));
        let points: Vec<Option<SurfacePoint>> = all.collect();
        // At outlines, a pose that is slightly wrong shows another surface.
        let surface = |i: Option<usize>| {
            i.and_then(|i| points.get(i))
                .and_then(|p| p.map(|p| p.surface))
        };
        let is_inside = |i: usize| {
            let beside = [
                i.checked_sub(1),
                Some(i + 1),
                i.checked_sub(width),
                Some(i + width),
            ];
            beside.into_iter().all(|k| surface(k) == surface(Some(i)))
        };
        let inner = points
            .iter()
            .enumerate()
            .map(|(i, p)| p.filter(|_| is_inside(i)));
        surfaces.points = inner.collect();
        surfaces.width = width;
    }

    fn point(
        &self,
        scene: &SceneView<'_>,
        pose: RigidTransform,
        rays: &RayCaster,
        (x, y): (u32, u32),
    ) -> Option<SurfacePoint> {
        let pixel = DVec2::new(f64::from(x), f64::from(y));
        let ray = pose.rotation * scene.camera.unproject(pixel);
        let hit = rays
            .nearest(pose.translation, ray)
            .filter(|hit| !hit.mirror)?;
        let (mut sum, mut count) = (Vec3::ZERO, 0.0);
        for v in y.saturating_sub(AROUND)..=y + AROUND {
            for u in x.saturating_sub(AROUND)..=x + AROUND {
                let codes = scene.picture.rgb(u, v);
                if codes.iter().any(|code| *code >= BRIGHTEST_CODE) {
                    return None;
                }
                sum += Vec3::from(self.response.linear_from_rgb(codes));
                count += 1.0;
            }
        }
        let vignetting = self.vignetting.map_or(1.0, |v| v.at(pixel) as f32);
        let linear = sum / (count * vignetting);
        let luminance = linear.dot(LUMINANCE);
        let log = |value: f32| value.max(0.1 * DARKEST).ln();
        (luminance > DARKEST).then(|| SurfacePoint {
            position: hit.point,
            normal: hit.normal.as_vec3(),
            log_values: [linear.x, linear.y, linear.z, luminance].map(log),
            surface: hit.surface,
        })
    }
}
