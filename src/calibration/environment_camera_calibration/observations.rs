//! What the environment camera saw whose place or direction in the world is known: markers,
//! clicks, lights.

use super::mirror::{MirrorTurn, Shown, divided, mirror_turn};
use super::pairs::Clicked;
use super::resection::{Sight, Target};
use super::step::{EnvironmentStep, Kind};
use super::turn::{Beam, Match, NoMatch, bring_together};
use super::view::View;
use super::{ball::Outline, tags::tags};
use crate::environment_camera_calibration::light_directions::{
    Known, Ray, agreed, direct, in_ball, mirrored, still,
};
use glam::{DQuat, DVec2, DVec3};
use penumbra_fiducials::TagSeen;
use penumbra_interface::RigidTransform;

/// A corner of a fiducial, pixels.
const CORNER_SIGMA: f64 = 0.15;
/// A click, pixels.
const CLICK_SIGMA: f64 = 1.0;
/// Lights by a small ball's picture alone, radians.
const UNREFINED: f64 = 0.03;
/// A place measured by hand, metres.
const HAND_SIGMA: f64 = 0.003;

/// A sight and where it is in the picture.
#[derive(Clone, Debug)]
pub struct Marked {
    /// For the solver.
    pub sight: Sight,
    /// Pixel.
    pub pixel: DVec2,
    /// What it is.
    pub by: By,
}

/// What a sight is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// A fiducial's corner.
    Marker,
    /// A click.
    Click,
    /// A light.
    Light,
}

impl By {
    /// As the file spells it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Marker => "markers",
            Self::Click => "clicks",
            Self::Light => "lights",
        }
    }
}

impl EnvironmentStep {
    /// `world_from_scene_camera` of a view: by markers, else by the tracker.
    pub(super) fn scene_pose(&self, i: usize) -> Option<RigidTransform> {
        let view = self.gathered.views.get(i)?;
        view.by_markers.or_else(|| {
            let tracker = self.known.rig.calibration.tracker.as_ref()?;
            let at = self.gathered.poses.at(view.at)?;
            Some(tracker.world_from_scene_camera(at.transmitter_from_sensor))
        })
    }

    /// Corners of fiducials at known places.
    pub(super) fn markers(&self, view: &View) -> (Vec<Marked>, Vec<TagSeen>) {
        let mut out = Vec::new();
        if self.families.is_empty() {
            return (out, Vec::new());
        }
        let seen = tags(
            &self.gathered.layers.luma(),
            view,
            &self.families,
            &self.response(),
        );
        for tag in &seen {
            let corners = match self.map.get(tag.family, tag.id) {
                Some(known) => Some(known.corners().map(|c| (c, 0.0))),
                None => self.met(tag),
            };
            for (pixel, (point, sigma)) in tag.corners.iter().zip(corners.into_iter().flatten()) {
                let Some(bearing) = view.bearing(*pixel) else {
                    continue;
                };
                let sight = Sight {
                    bearing,
                    target: Target::Point(point),
                    sigma: (CORNER_SIGMA / view.focal()).hypot(sigma),
                };
                out.push(Marked {
                    sight,
                    pixel: *pixel,
                    by: By::Marker,
                });
            }
        }
        (out, seen)
    }

    /// Corners of a fiducial that stands still, from the scene camera's views of it, and how sure they
    /// are as seen from about as far, radians.
    fn met(&self, tag: &TagSeen) -> Option<[(DVec3, f64); 4]> {
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let corner = |k: usize| {
            let rays: Vec<Ray> = (0..self.gathered.views.len())
                .filter_map(|i| {
                    let found = self.gathered.views[i].tags.iter();
                    let seen = found
                        .clone()
                        .find(|t| (t.family, t.id) == (tag.family, tag.id))?;
                    let pose = self.scene_pose(i)?;
                    Some(Ray {
                        from: pose.translation,
                        direction: pose.rotation * camera.unproject(seen.corners[k]),
                        radius: 0.0,
                    })
                })
                .collect();
            let eye = self
                .stand()
                .unwrap_or(rays.first()?.from + DVec3::splat(0.3));
            let known = agreed(&rays, 2, eye, 4.0);
            match known.first()? {
                Known {
                    target: Target::Point(p),
                    beam,
                } => Some((*p, beam.sigma)),
                Known { .. } => None,
            }
        };
        Some([corner(0)?, corner(1)?, corner(2)?, corner(3)?])
    }

    /// Where the environment camera is said to stand.
    pub(super) fn stand(&self) -> Option<DVec3> {
        self.asked
            .at
            .or_else(|| self.rough_pose().map(|p| p.translation))
    }

    /// The user's clicks; those outside of the picture, or of an unknown time, are counted.
    pub(super) fn clicks(&self, view: &View) -> (Vec<Marked>, usize) {
        let (mut out, mut lost) = (Vec::new(), 0);
        for pair in &self.asked.pairs {
            let sigma = CLICK_SIGMA / view.focal();
            let target = match pair.clicked {
                Clicked::Point(p) => {
                    let far = self.stand().map_or(0.5, |s| s.distance(p)).max(0.02);
                    Some((Target::Point(p), sigma.hypot(HAND_SIGMA / far)))
                }
                Clicked::Towards(d) => Some((Target::Direction(d), sigma)),
                Clicked::Scene(pixel, seconds) => self
                    .towards(pixel, seconds)
                    .map(|(d, s)| (Target::Direction(d), sigma.hypot(s))),
            };
            match (target, view.bearing(pair.pixel)) {
                (Some((target, sigma)), Some(bearing)) => out.push(Marked {
                    sight: Sight {
                        bearing,
                        target,
                        sigma,
                    },
                    pixel: pair.pixel,
                    by: By::Click,
                }),
                _ => lost += 1,
            }
        }
        (out, lost)
    }

    /// Direction of a pixel of the scene camera at a time, world; it is taken to be far away.
    fn towards(&self, pixel: DVec2, seconds: f64) -> Option<(DVec3, f64)> {
        let off = |i: &usize| (self.gathered.views[*i].seconds - seconds).abs();
        let i = (0..self.gathered.views.len()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
        if off(&i) > 0.1 {
            return None;
        }
        let camera = &self.known.rig.calibration.scene_camera.camera;
        Some((
            self.scene_pose(i)?.rotation * camera.unproject(pixel),
            CLICK_SIGMA / camera.focal.x,
        ))
    }

    /// The lights of the environment camera's pictures; before a sphere as that shows them.
    pub(super) fn own_lights(
        &self,
        view: &View,
        outline: Option<(&Outline, f64)>,
    ) -> Vec<(Beam, DVec2)> {
        let direction = |p: DVec2| match outline {
            Some((outline, radius)) => mirrored(view.bearing(p)?, outline.centre(radius).0, radius),
            None => view.bearing(p),
        };
        still(&self.gathered.bright, &direction)
    }

    /// The same lights by the scene camera, world.
    pub(super) fn world_lights(&self) -> Vec<Known> {
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let ball = self.known.rig.mirror_sphere.as_ref().filter(|s| s.in_scene);
        let (mut rays, mut pictures) = (Vec::new(), 0);
        for i in 0..self.gathered.views.len() {
            let Some(pose) = self.scene_pose(i) else {
                continue;
            };
            pictures += 1;
            let bright = &self.gathered.views[i].bright;
            match (self.kind, ball) {
                (Kind::Sphere, Some(ball)) => in_ball(
                    bright,
                    camera,
                    pose,
                    (ball, pose.inverse().transform_point(ball.centre_in_world)),
                    &mut rays,
                ),
                _ => direct(bright, camera, pose, ball, &mut rays),
            }
        }
        let sphere = self
            .known
            .rig
            .mirror_sphere
            .as_ref()
            .map(|s| s.centre_in_world);
        let eye = match self.kind {
            Kind::Sphere => sphere,
            Kind::Fisheye => self.stand(),
        };
        let Some(eye) = eye else { return Vec::new() };
        let mut known = agreed(&rays, pictures, eye, 0.1);
        // One that may lie anywhere tells nothing.
        known.retain(|k| k.beam.sigma < 0.05);
        known
    }

    /// The turn `world_from_camera` by what both mirrors show, from a first guess.
    pub(super) fn mirror_turn(
        &self,
        own: &dyn Fn(DVec2) -> Option<DVec3>,
        lights: &[DVec3],
        start: DQuat,
    ) -> Option<MirrorTurn> {
        let ball = self
            .known
            .rig
            .mirror_sphere
            .as_ref()
            .filter(|s| s.in_scene)?;
        let camera = &self.known.rig.calibration.scene_camera.camera;
        let samples = self
            .gathered
            .bright
            .get(self.gathered.bright.len() / 2)?
            .samples(own);
        let lights = divided(&samples, lights);
        let shown: Vec<Shown> = (0..self.gathered.views.len())
            .filter_map(|i| {
                let pose = self.scene_pose(i)?;
                let centre = pose.inverse().transform_point(ball.centre_in_world);
                let look = |p: DVec2| mirrored(camera.unproject(p), centre, ball.radius);
                Some(Shown {
                    camera_from_world: pose.rotation.inverse(),
                    centre,
                    lights: self.gathered.views[i].bright.lights(&look),
                })
            })
            .collect();
        mirror_turn(camera, ball.radius, &lights, &shown, start)
    }

    /// Lights that are the same ones.
    pub(super) fn lights(
        &self,
        (view, outline): (&View, Option<(&Outline, f64)>),
        own: &[(Beam, DVec2)],
        world: &[Known],
    ) -> Result<(Vec<Marked>, Match), NoMatch> {
        let first: Vec<Beam> = own.iter().map(|o| o.0).collect();
        let second: Vec<Beam> = world.iter().map(|w| w.beam).collect();
        let worst = first
            .iter()
            .chain(&second)
            .map(|b| b.sigma)
            .fold(0.0, f64::max);
        // A small ball in the scene camera's picture shows where lights are to some degrees.
        let (least, most) = match self.kind {
            Kind::Sphere => (0.12, 0.2),
            Kind::Fisheye => (0.03, 0.1),
        };
        let tolerance = (4.0 * worst).clamp(least, most);
        let rough = self.asked.rough.unwrap_or(0.6);
        let near = self.rough_pose().map(|p| (p.rotation, rough));
        let mut found = bring_together(&first, &second, tolerance, near)?;
        let paired: Vec<DVec3> = found.pairs.iter().map(|p| first[p.0].direction).collect();
        let finer = outline.and_then(|(outline, radius)| {
            let centre = outline.centre(radius).0;
            let look = |p: DVec2| mirrored(view.bearing(p)?, centre, radius);
            self.mirror_turn(&look, &paired, found.turn)
        });
        if let Some(finer) = &finer {
            found.turn = finer.turn;
        }
        let marked = found.pairs.iter().map(|&(i, j)| Marked {
            sight: Sight {
                bearing: first[i].direction,
                target: match self.kind {
                    // Seen from the ball, by both.
                    Kind::Sphere if finer.is_some() => {
                        Target::Direction(found.turn * first[i].direction)
                    }
                    Kind::Sphere => Target::Direction(second[j].direction),
                    Kind::Fisheye => world[j].target,
                },
                sigma: match &finer {
                    Some(finer) => finer.sigma,
                    None if self.kind == Kind::Sphere => UNREFINED,
                    None => first[i].sigma.hypot(second[j].sigma),
                },
            },
            pixel: own[i].1,
            by: By::Light,
        });
        Ok((marked.collect(), found))
    }
}
