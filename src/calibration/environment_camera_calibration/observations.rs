//! What the environment camera observes at known positions or in known directions: markers, clicks
//! and lights.

use super::clicks::ClickTarget;
use super::inputs::{EnvironmentCameraKind, Inputs};
use super::light_directions::{
    LightRay, WorldLight, add_direct_lights, add_reflected_lights, mirrored, static_lights,
    triangulate,
};
use super::light_matching::{LightDirection, Match, NoMatch, match_lights};
use super::mirror::{MirrorRotation, SphereView, assign_samples, rotation_from_mirror};
use super::resection::{Observation, Target};
use super::sphere_outline::Outline;
use super::tags::detect_tags;
use super::view::View;
use glam::{DQuat, DVec2, DVec3};
use penumbra_fiducials::TagObservation;
use penumbra_interface::RigidTransform;

/// 1σ of a fiducial's corner, pixels.
const CORNER_SIGMA: f64 = 0.15;
/// 1σ of a click, pixels.
const CLICK_SIGMA: f64 = 1.0;
/// 1σ of lights in a sphere without refinement by [`rotation_from_mirror`], radians.
const UNREFINED_SIGMA: f64 = 0.03;
/// 1σ of a position measured by hand, metres.
const HAND_SIGMA: f64 = 0.003;

/// An observation and its position in the picture.
#[derive(Clone, Debug)]
pub struct ImageObservation {
    /// The observation.
    pub observation: Observation,
    /// Pixel of the environment camera.
    pub pixel: DVec2,
    /// What is observed.
    pub by: ObservationKind,
}

/// Kind of an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObservationKind {
    /// A fiducial's corner.
    Marker,
    /// A click.
    Click,
    /// A light.
    Light,
}

impl ObservationKind {
    /// Returns the name used in the calibration file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Marker => "markers",
            Self::Click => "clicks",
            Self::Light => "lights",
        }
    }
}

impl Inputs {
    /// Returns `world_from_scene_camera` of a view: from markers, else from the tracker.
    pub(super) fn scene_pose(&self, i: usize) -> Option<RigidTransform> {
        let view = self.gathered.views.get(i)?;
        view.by_markers.or_else(|| {
            let tracker = self.known.rig.calibration.tracker.as_ref()?;
            let at = self.gathered.poses.at(view.at)?;
            Some(tracker.world_from_scene_camera(at.transmitter_from_sensor))
        })
    }

    /// Returns the corners of fiducials at known positions, and all fiducials.
    pub(super) fn marker_observations(
        &self,
        view: &View,
    ) -> (Vec<ImageObservation>, Vec<TagObservation>) {
        let mut out = Vec::new();
        if self.families.is_empty() {
            return (out, Vec::new());
        }
        let seen = detect_tags(
            &self.gathered.mean.luma(),
            view,
            &self.families,
            &self.response(),
        );
        for tag in &seen {
            let corners = match self.map.get(tag.family, tag.id) {
                Some(known) => Some(known.corners().map(|c| (c, 0.0))),
                None => self.triangulated_corners(tag),
            };
            for (pixel, (point, sigma)) in tag.corners.iter().zip(corners.into_iter().flatten()) {
                let Some(bearing) = view.bearing(*pixel) else {
                    continue;
                };
                let observation = Observation {
                    bearing,
                    target: Target::Point(point),
                    sigma: (CORNER_SIGMA / view.focal()).hypot(sigma),
                };
                out.push(ImageObservation {
                    observation,
                    pixel: *pixel,
                    by: ObservationKind::Marker,
                });
            }
        }
        (out, seen)
    }

    /// Returns the corners of a static fiducial, triangulated from the scene camera's views, with their
    /// 1σ as seen from the environment camera, radians.
    fn triangulated_corners(&self, tag: &TagObservation) -> Option<[(DVec3, f64); 4]> {
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let corner = |k: usize| {
            let rays: Vec<LightRay> = (0..self.gathered.views.len())
                .filter_map(|i| {
                    let found = self.gathered.views[i].tags.iter();
                    let seen = found
                        .clone()
                        .find(|t| (t.family, t.id) == (tag.family, tag.id))?;
                    let pose = self.scene_pose(i)?;
                    Some(LightRay {
                        from: pose.translation,
                        direction: pose.rotation * camera.unproject(seen.corners[k]),
                        radius: 0.0,
                    })
                })
                .collect();
            let eye = self
                .position()
                .unwrap_or(rays.first()?.from + DVec3::splat(0.3));
            let known = triangulate(&rays, 2, eye, 4.0);
            match known.first()? {
                WorldLight {
                    target: Target::Point(p),
                    seen,
                } => Some((*p, seen.sigma)),
                WorldLight { .. } => None,
            }
        };
        Some([corner(0)?, corner(1)?, corner(2)?, corner(3)?])
    }

    /// Returns the environment camera's position given by the user or by `rig.json`, world, metres.
    pub(super) fn position(&self) -> Option<DVec3> {
        self.options
            .position
            .or_else(|| self.rough_pose().map(|p| p.translation))
    }

    /// Returns the user's clicks, and the number of those outside of the picture or at times without a
    /// pose of the scene camera.
    pub(super) fn click_observations(&self, view: &View) -> (Vec<ImageObservation>, usize) {
        let (mut out, mut lost) = (Vec::new(), 0);
        for pair in &self.options.clicks {
            let sigma = CLICK_SIGMA / view.focal();
            let target = match pair.target {
                ClickTarget::Point(p) => {
                    let distance = self.position().map_or(0.5, |s| s.distance(p)).max(0.02);
                    Some((Target::Point(p), sigma.hypot(HAND_SIGMA / distance)))
                }
                ClickTarget::Towards(d) => Some((Target::Direction(d), sigma)),
                ClickTarget::Scene(pixel, seconds) => self
                    .scene_direction(pixel, seconds)
                    .map(|(d, s)| (Target::Direction(d), sigma.hypot(s))),
            };
            match (target, view.bearing(pair.pixel)) {
                (Some((target, sigma)), Some(bearing)) => out.push(ImageObservation {
                    observation: Observation {
                        bearing,
                        target,
                        sigma,
                    },
                    pixel: pair.pixel,
                    by: ObservationKind::Click,
                }),
                _ => lost += 1,
            }
        }
        (out, lost)
    }

    /// Returns the direction of a pixel of the scene camera at a time, world, and its 1σ, radians; the
    /// point is assumed to be distant.
    fn scene_direction(&self, pixel: DVec2, seconds: f64) -> Option<(DVec3, f64)> {
        let difference = |i: &usize| (self.gathered.views[*i].seconds - seconds).abs();
        let i = (0..self.gathered.views.len())
            .min_by(|a, b| difference(a).total_cmp(&difference(b)))?;
        if difference(&i) > 0.1 {
            return None;
        }
        let camera = &self.known.rig.calibration.scene_camera.camera;
        Some((
            self.scene_pose(i)?.rotation * camera.unproject(pixel),
            CLICK_SIGMA / camera.focal.x,
        ))
    }

    /// Returns the lights in the environment camera's pictures; with a sphere, those it reflects.
    pub(super) fn environment_lights(
        &self,
        view: &View,
        outline: Option<(&Outline, f64)>,
    ) -> Vec<(LightDirection, DVec2)> {
        let direction = |p: DVec2| match outline {
            Some((outline, radius)) => mirrored(view.bearing(p)?, outline.centre(radius).0, radius),
            None => view.bearing(p),
        };
        static_lights(&self.gathered.bright, &direction)
    }

    /// Returns the lights seen by the scene camera, world.
    pub(super) fn world_lights(&self) -> Vec<WorldLight> {
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let sphere = self.known.rig.mirror_sphere.as_ref();
        let in_scene = sphere.filter(|s| s.in_scene);
        let (mut rays, mut pictures) = (Vec::new(), 0);
        for i in 0..self.gathered.views.len() {
            let Some(pose) = self.scene_pose(i) else {
                continue;
            };
            pictures += 1;
            let bright = &self.gathered.views[i].bright;
            match (self.kind, in_scene) {
                (EnvironmentCameraKind::Sphere, Some(sphere)) => {
                    let centre = pose.inverse().transform_point(sphere.centre_in_world);
                    add_reflected_lights(bright, camera, pose, (sphere, centre), &mut rays);
                }
                _ => add_direct_lights(bright, camera, pose, in_scene, &mut rays),
            }
        }
        let eye = match self.kind {
            EnvironmentCameraKind::Sphere => sphere.map(|s| s.centre_in_world),
            EnvironmentCameraKind::Fisheye => self.position(),
        };
        let Some(eye) = eye else { return Vec::new() };
        let mut known = triangulate(&rays, pictures, eye, 0.1);
        // Lights of uncertain direction are of no use.
        known.retain(|k| k.seen.sigma < 0.05);
        known
    }

    /// Returns the rotation `world_from_camera` from the lights that both cameras see in the sphere,
    /// from an initial rotation.
    fn rotation_by_mirror(
        &self,
        own: &dyn Fn(DVec2) -> Option<DVec3>,
        lights: &[DVec3],
        start: DQuat,
    ) -> Option<MirrorRotation> {
        let sphere = self.known.rig.mirror_sphere.as_ref();
        let sphere = sphere.filter(|s| s.in_scene)?;
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let samples = self
            .gathered
            .bright
            .get(self.gathered.bright.len() / 2)?
            .samples(own);
        let lights = assign_samples(&samples, lights);
        let shown: Vec<SphereView> = (0..self.gathered.views.len())
            .filter_map(|i| {
                let pose = self.scene_pose(i)?;
                let centre = pose.inverse().transform_point(sphere.centre_in_world);
                let direction = |p: DVec2| mirrored(camera.unproject(p), centre, sphere.radius);
                Some(SphereView {
                    camera_from_world: pose.rotation.inverse(),
                    centre,
                    lights: self.gathered.views[i].bright.lights(&direction),
                })
            })
            .collect();
        rotation_from_mirror(camera, sphere.radius, &lights, &shown, start)
    }

    /// Matches the lights of both cameras.
    ///
    /// # Errors
    /// As [`match_lights`].
    pub(super) fn light_observations(
        &self,
        (view, outline): (&View, Option<(&Outline, f64)>),
        own: &[(LightDirection, DVec2)],
        world: &[WorldLight],
    ) -> Result<(Vec<ImageObservation>, Match), NoMatch> {
        let first: Vec<LightDirection> = own.iter().map(|o| o.0).collect();
        let second: Vec<LightDirection> = world.iter().map(|w| w.seen).collect();
        let worst = first
            .iter()
            .chain(&second)
            .map(|b| b.sigma)
            .fold(0.0, f64::max);
        // A small sphere in the scene camera's picture yields directions to a few degrees.
        let (min, max) = match self.kind {
            EnvironmentCameraKind::Sphere => (0.12, 0.2),
            EnvironmentCameraKind::Fisheye => (0.03, 0.1),
        };
        let tolerance = (4.0 * worst).clamp(min, max);
        let rough = self.options.max_rotation_error.unwrap_or(0.6);
        let near = self.rough_pose().map(|p| (p.rotation, rough));
        let mut found = match_lights(&first, &second, tolerance, near)?;
        let paired: Vec<DVec3> = found.pairs.iter().map(|p| first[p.0].direction).collect();
        let refined = outline.and_then(|(outline, radius)| {
            let centre = outline.centre(radius).0;
            let direction = |p: DVec2| mirrored(view.bearing(p)?, centre, radius);
            self.rotation_by_mirror(&direction, &paired, found.rotation)
        });
        if let Some(refined) = &refined {
            found.rotation = refined.rotation;
        }
        let image_observations = found.pairs.iter().map(|&(i, j)| ImageObservation {
            observation: Observation {
                bearing: first[i].direction,
                target: match self.kind {
                    // Both cameras see the lights from the sphere.
                    EnvironmentCameraKind::Sphere if refined.is_some() => {
                        Target::Direction(found.rotation * first[i].direction)
                    }
                    EnvironmentCameraKind::Sphere => Target::Direction(second[j].direction),
                    EnvironmentCameraKind::Fisheye => world[j].target,
                },
                sigma: match &refined {
                    Some(refined) => refined.sigma,
                    None if self.kind == EnvironmentCameraKind::Sphere => UNREFINED_SIGMA,
                    None => first[i].sigma.hypot(second[j].sigma),
                },
            },
            pixel: own[i].1,
            by: ObservationKind::Light,
        });
        Ok((image_observations.collect(), found))
    }
}
