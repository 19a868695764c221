//! Places of the lamps: as stated, or estimated from real shadows in the scene camera's picture.

use crate::light::view::SceneView;
use glam::{DVec2, DVec3, Vec3};
use penumbra_camera::{PinholeCamera, Response, Vignetting};
use penumbra_config::{EnvironmentConfig, LightPlaces};
use penumbra_interface::RigidTransform;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::lamp_distance::{DistanceSearch, SeenSurfaces, SurfacePoint};
use penumbra_lighting::sources::LUMINANCE;
use penumbra_lighting::{EnvironmentEstimator, Lighting};
use penumbra_rig_model::RigCalibration;
use penumbra_scene::RayCaster;
use std::sync::Arc;

/// Pixels between the points of the grid, along x and y.
const SPACING: u32 = 6;
/// Half the side of the square over which a point's luminance is averaged, pixels.
const AROUND: u32 = 2;
/// Luminance below which a pixel is too noisy, and code from which it may be clipped.
const DARKEST: f32 = 0.004;
const BRIGHTEST_CODE: u8 = 250;
/// Environment pictures between two looks at the shadows.
const INTERVAL: u32 = 6;
/// Number of lamps whose distances are searched, the strongest.
const LAMPS: usize = 4;
/// Share of a new estimate in the distance of a lamp that is followed.
const SHARE: f32 = 0.3;
/// Angle between a stated light and a source, radians, in addition to the source's radius, up to
/// which they are the same.
const STATED_WITHIN: f32 = 0.15;

/// Finds the places of lamps, and follows them.
pub(crate) struct LampPlaces {
    camera: PinholeCamera,
    response: Response,
    vignetting: Option<Vignetting>,
    rays: Arc<RayCaster>,
    /// World positions, metres.
    stated: Vec<DVec3>,
    is_estimated: bool,
    /// Distances of the lamps that are followed, as reciprocals, by their ids.
    known: Vec<(u32, f32)>,
    /// Pictures until the next look.
    rests: u32,
    surfaces: SeenSurfaces,
}

impl LampPlaces {
    pub(crate) fn new(
        rig: &RigCalibration,
        rays: Arc<RayCaster>,
        settings: &EnvironmentConfig,
    ) -> Self {
        let scene_camera = &rig.scene_camera;
        Self {
            camera: scene_camera.camera.clone(),
            response: scene_camera.response.clone(),
            vignetting: scene_camera.vignetting,
            rays,
            stated: settings
                .room_lights
                .iter()
                .map(|p| DVec3::from(*p))
                .collect(),
            is_estimated: settings.light_places == LightPlaces::Estimate,
            known: Vec::new(),
            rests: 0,
            surfaces: SeenSurfaces::default(),
        }
    }

    /// Replaces the real surfaces.
    pub(crate) fn set_rays(&mut self, rays: Arc<RayCaster>) {
        self.rays = rays;
        self.rests = 0;
    }

    /// Looks at the shadows in a picture, if it is time to, and tells `estimator` the distances of
    /// its lamps; true if a lamp has gained a place that had none, so that the light is another.
    pub(crate) fn look(
        &mut self,
        scene: &SceneView<'_>,
        lighting: &Lighting,
        estimator: &mut EnvironmentEstimator,
    ) -> bool {
        let Some(observer) = estimator.observer() else {
            return false;
        };
        let sources = estimator.sources();
        self.known
            .retain(|(id, _)| sources.iter().any(|s| s.id == *id));
        let is_new = |s: &CompactSource| self.known.iter().all(|(id, _)| *id != s.id);
        let mut gained = false;
        let new: Vec<CompactSource> = sources.iter().copied().filter(is_new).collect();
        for source in new {
            if let Some(inverse) = self.stated_distance(&source, observer) {
                self.known.push((source.id, inverse));
                gained = true;
            }
        }
        gained |= self.estimate(scene, lighting, (&sources, observer));
        estimator.set_distances(&self.known);
        gained
    }

    /// The reciprocal of the distance of a stated light in the direction of a source.
    fn stated_distance(&self, source: &CompactSource, observer: DVec3) -> Option<f32> {
        let towards = |at: &DVec3| (*at - observer).as_vec3();
        let angle = |at: &DVec3| towards(at).angle_between(source.direction);
        let nearest = self
            .stated
            .iter()
            .min_by(|a, b| angle(a).total_cmp(&angle(b)))?;
        let is_same = angle(nearest) < source.angular_radius + STATED_WITHIN;
        is_same.then(|| towards(nearest).length().max(0.05).recip())
    }

    fn known_distance(&self, id: u32) -> Option<f32> {
        let mut known = self.known.iter();
        known
            .find(|(known, _)| *known == id)
            .map(|(_, inverse)| *inverse)
    }

    fn is_stated(&self, source: &CompactSource, observer: DVec3) -> bool {
        self.stated_distance(source, observer).is_some()
    }

    /// Estimates distances from the shadows in the picture; true if a lamp has gained a place.
    fn estimate(
        &mut self,
        scene: &SceneView<'_>,
        lighting: &Lighting,
        (sources, observer): (&[CompactSource], DVec3),
    ) -> bool {
        let Some(pose) = scene.world_from_camera.filter(|_| self.is_estimated) else {
            return false;
        };
        let fits =
            (scene.picture.width, scene.picture.height) == (self.camera.width, self.camera.height);
        let is_known = |s: &&CompactSource| self.known.iter().any(|(id, _)| *id == s.id);
        let any_new = sources.iter().take(LAMPS).any(|s| !is_known(&s));
        if !fits || (!any_new && self.rests > 0) {
            self.rests = self.rests.saturating_sub(1);
            return false;
        }
        self.rests = INTERVAL;
        self.see(scene, pose);
        let mut lamps = sources.to_vec();
        for lamp in &mut lamps {
            lamp.inverse_distance = self.known_distance(lamp.id).unwrap_or(0.0);
        }
        let rays = Arc::clone(&self.rays);
        let blocked =
            |origin: DVec3, to: DVec3, farthest: f64| rays.is_blocked(origin, to, farthest);
        let mut search = DistanceSearch::new(
            &self.surfaces,
            &lamps,
            &lighting.irradiance,
            observer,
            &blocked,
        );
        let mut gained = false;
        for (k, lamp) in lamps.iter().enumerate().take(LAMPS) {
            if self.is_stated(lamp, observer) {
                continue;
            }
            let before = self.known_distance(lamp.id);
            let found = search.find(k, before.is_none_or(|inverse| inverse == 0.0));
            let inverse = found.map_or(0.0, |found| found.inverse);
            if std::env::var("DBG").is_ok() {
                eprintln!(
                    "lamp {} dir {:?} flux {:?} r {} before {before:?} found {found:?}",
                    lamp.id, lamp.direction, lamp.irradiance, lamp.angular_radius
                );
            }
            gained |= before.unwrap_or(0.0) == 0.0 && inverse > 0.0;
            match self.known.iter_mut().find(|(id, _)| *id == lamp.id) {
                Some((_, old)) => *old += (inverse - *old) * SHARE,
                None => self.known.push((lamp.id, inverse)),
            }
        }
        gained
    }

    /// Notes what the picture shows of real surfaces.
    fn see(&mut self, scene: &SceneView<'_>, pose: RigidTransform) {
        let steps =
            |length: u32| (SPACING / 2..length.saturating_sub(AROUND)).step_by(SPACING as usize);
        let width = steps(self.camera.width).count();
        let all = steps(self.camera.height)
            .flat_map(|y| steps(self.camera.width).map(move |x| (x, y)))
            .map(|(x, y)| self.point(scene, pose, x, y));
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
        self.surfaces.points = inner.collect();
        self.surfaces.width = width;
    }

    fn point(
        &self,
        scene: &SceneView<'_>,
        pose: RigidTransform,
        x: u32,
        y: u32,
    ) -> Option<SurfacePoint> {
        let pixel = DVec2::new(f64::from(x), f64::from(y));
        let ray = pose.rotation * self.camera.unproject(pixel);
        let hit = self
            .rays
            .nearest(pose.translation, ray)
            .filter(|hit| !hit.mirror)?;
        let (mut sum, mut count) = (0.0, 0.0);
        for v in y.saturating_sub(AROUND)..=y + AROUND {
            for u in x.saturating_sub(AROUND)..=x + AROUND {
                let codes = scene.picture.rgb(u, v);
                if codes.iter().any(|code| *code >= BRIGHTEST_CODE) {
                    return None;
                }
                sum += Vec3::from(self.response.linear_from_rgb(codes)).dot(LUMINANCE);
                count += 1.0;
            }
        }
        let vignetting = self.vignetting.map_or(1.0, |v| v.at(pixel) as f32);
        let luminance: f32 = sum / count / vignetting;
        (luminance > DARKEST).then(|| SurfacePoint {
            position: hit.point,
            normal: hit.normal.as_vec3(),
            log_luminance: luminance.ln(),
            surface: hit.surface,
        })
    }
}
