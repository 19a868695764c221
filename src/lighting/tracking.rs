//! Follows compact sources from frame to frame, and splits each into dome lights.

use super::cube::tangent_frame;
use super::light::{DomeLight, LightKind};
use super::place::{LampDistance, LampPlane, Remote, Seen, Viewpoints};
use super::sources::{LUMINANCE, Source};
use glam::{Mat3, Vec3};
use std::f32::consts::PI;

/// Maximum displacement of a source between two pictures, radians, in addition to its own extent.
const GATE: f32 = 0.3;

/// Part of a source in one direction.
#[derive(Clone, Copy, Debug)]
struct Part {
    direction: Vec3,
    flux: Vec3,
    weight: f32,
}

/// A source that is followed.
#[derive(Clone, Debug)]
pub(super) struct TrackedSource {
    /// Unique; never reused for another source.
    pub id: u32,
    pub direction: Vec3,
    pub flux: Vec3,
    pub solid_angle: f32,
    /// Its distance from the observer.
    pub distance: LampDistance,
    /// The plane in which it is, if it is flat.
    pub plane: Option<LampPlane>,
    /// Share of its light in clipped pixels.
    pub clipped: f32,
    /// Whether it is not seen, but known from its shadows.
    pub is_unseen: bool,
    /// Number of dome lights into which it is split; 0 = not planned yet.
    pub lights: usize,
    /// First tangent vector, transported with the source, so that the pattern of lights moves with
    /// it and never rotates.
    axis: Vec3,
    /// The axis of each cut, in the order of the recursion.
    cuts: Vec<bool>,
    parts: Vec<Part>,
}

impl TrackedSource {
    fn new(id: u32, source: &Source, directions: &[Vec3], gains: Mat3) -> Self {
        let mut new = Self {
            id,
            direction: source.direction,
            flux: Vec3::ZERO,
            solid_angle: 0.0,
            distance: LampDistance::FAR,
            plane: None,
            clipped: 0.0,
            is_unseen: source.unseen.is_some(),
            lights: 0,
            axis: tangent_frame(source.direction).0,
            cuts: Vec::new(),
            parts: Vec::new(),
        };
        new.follow(source, directions, gains);
        new
    }

    fn follow(&mut self, source: &Source, directions: &[Vec3], gains: Mat3) {
        self.direction = source.direction;
        self.flux = gains * source.flux;
        self.solid_angle = source.solid_angle;
        self.clipped = source.clipped;
        self.distance = source.unseen.unwrap_or(self.distance);
        let across = self.axis - self.direction * self.axis.dot(self.direction);
        self.axis = across
            .try_normalize()
            .unwrap_or(tangent_frame(self.direction).0);
        self.parts.clear();
        let seen = source.parts.iter().map(|(i, flux)| {
            let direction = directions[*i as usize] + source.shift;
            (direction.normalize(), *flux)
        });
        let all = seen.chain(source.hidden.iter().copied());
        self.parts.extend(all.map(|(direction, flux)| {
            let flux = (gains * flux).max(Vec3::ZERO);
            Part {
                direction,
                flux,
                weight: flux.dot(LUMINANCE),
            }
        }));
    }

    /// Half angle of a cone with the source's solid angle, radians.
    pub fn radius(&self) -> f32 {
        (self.solid_angle / PI).sqrt()
    }

    /// Returns the luminance of its irradiance on the ground (without ground: on a surface facing
    /// it).
    pub fn share(&self, ground: bool) -> f32 {
        let height = if ground && !self.is_unseen {
            self.direction.z.max(0.0)
        } else {
            1.0
        };
        self.flux.dot(LUMINANCE) * height
    }

    /// Sets the number of lights into which the source is split.
    pub fn plan(&mut self, n: usize) {
        if n != self.lights {
            self.lights = n;
            self.cuts.clear();
        }
    }

    /// Returns unit vectors to `n` parts of it with equal energy.
    pub fn parts(&self, n: usize) -> Vec<Vec3> {
        if n <= 1 {
            return vec![self.direction];
        }
        let axes = (self.axis, self.direction.cross(self.axis));
        let mut centres = Vec::with_capacity(n);
        let mut add = |leaf: &[Part]| {
            let sum: Vec3 = leaf.iter().map(|p| p.direction * p.weight).sum();
            centres.push(sum.try_normalize().unwrap_or(self.direction));
        };
        cut(
            &mut self.parts.clone(),
            n,
            axes,
            &mut Vec::new(),
            &mut 0,
            &mut add,
        );
        centres
    }

    /// Returns its lights, always in the same order.
    pub fn split(&mut self, ground: bool, views: &Viewpoints) -> Vec<DomeLight> {
        let mut lights = Vec::with_capacity(self.lights);
        let mut cuts = std::mem::take(&mut self.cuts);
        let axes = (self.axis, self.direction.cross(self.axis));
        let mut next = 0;
        let is_unseen = self.is_unseen;
        let at_distance = Remote::Inverse(self.distance.inverse);
        let remote = self.plane.map_or(at_distance, Remote::Plane);
        let views = &if is_unseen { views.direct() } else { *views };
        let leaf_solid_angle = self.solid_angle / self.lights.max(1) as f32;
        cut(
            &mut self.parts.clone(),
            self.lights,
            axes,
            &mut cuts,
            &mut next,
            &mut |leaf| {
                // A lamp that is not seen may be lower than the observer, and still above the ground.
                let seen = seen_from(leaf, leaf_solid_angle, ground && !is_unseen);
                lights.push(light_of(seen, remote, ground, views));
            },
        );
        self.cuts = cuts;
        lights
    }
}

/// Cuts parts into `n` groups of equal energy, across the longest side first, and calls `leaf` for
/// each. `cuts` stores the axis of each cut, so that noise does not change the pattern of a round
/// source.
fn cut(
    parts: &mut [Part],
    n: usize,
    axes: (Vec3, Vec3),
    cuts: &mut Vec<bool>,
    next: &mut usize,
    leaf: &mut impl FnMut(&[Part]),
) {
    if n <= 1 || parts.is_empty() {
        (0..n).for_each(|_| leaf(parts));
        return;
    }
    let first = match cuts.get(*next) {
        Some(&known) => known,
        None => {
            let first = spread(parts, axes.0) >= spread(parts, axes.1);
            cuts.push(first);
            first
        }
    };
    *next += 1;
    let axis = if first { axes.0 } else { axes.1 };
    parts.sort_by(|a, b| a.direction.dot(axis).total_cmp(&b.direction.dot(axis)));
    let total: f32 = parts.iter().map(|p| p.weight).sum();
    let target = total * (n / 2) as f32 / n as f32;
    let (mut low, mut high) = divide(parts, target);
    cut(&mut low, n / 2, axes, cuts, next, leaf);
    cut(&mut high, n - n / 2, axes, cuts, next, leaf);
}

/// Divides sorted parts where their energy reaches `target`; the part at the border goes to both
/// sides in proportion, so that the result is continuous as the source moves over pixels.
fn divide(parts: &[Part], target: f32) -> (Vec<Part>, Vec<Part>) {
    let mut below = 0.0;
    for (i, part) in parts.iter().enumerate() {
        if below + part.weight >= target && part.weight > 0.0 {
            let share = ((target - below) / part.weight).clamp(0.0, 1.0);
            let mut low = parts[..i].to_vec();
            let mut high = parts[i..].to_vec();
            low.push(scaled(part, share));
            high[0] = scaled(part, 1.0 - share);
            return (low, high);
        }
        below += part.weight;
    }
    (parts.to_vec(), Vec::new())
}

fn scaled(part: &Part, share: f32) -> Part {
    Part {
        direction: part.direction,
        flux: part.flux * share,
        weight: part.weight * share,
    }
}

fn spread(parts: &[Part], axis: Vec3) -> f32 {
    let total: f32 = parts.iter().map(|p| p.weight).sum();
    let moment = |f: &dyn Fn(f32) -> f32| -> f32 {
        parts
            .iter()
            .map(|p| p.weight * f(p.direction.dot(axis)))
            .sum::<f32>()
            / total.max(f32::MIN_POSITIVE)
    };
    let mean = moment(&|x| x);
    moment(&|x| (x - mean) * (x - mean))
}

/// Returns parts of a source as one light, as the observer sees it.
fn seen_from(parts: &[Part], solid_angle: f32, ground: bool) -> Seen {
    let centre: Vec3 = parts.iter().map(|p| p.direction * p.weight).sum();
    let direction = above_horizon(centre.try_normalize().unwrap_or(Vec3::Z), ground);
    let sum = |f: &dyn Fn(&Part) -> f32| parts.iter().map(|p| p.flux * f(p)).sum::<Vec3>();
    let irradiance = if ground {
        sum(&|p| p.direction.z.max(0.0)) / direction.z
    } else {
        sum(&|_| 1.0)
    };
    Seen {
        direction,
        irradiance,
        angular_radius: (solid_angle / PI).sqrt(),
    }
}

/// Returns a light as the scene sees it.
fn light_of(seen: Seen, remote: Remote, ground: bool, views: &Viewpoints) -> DomeLight {
    let (moved, place) = views.moved(seen, remote);
    DomeLight {
        direction: above_horizon(moved.direction, ground),
        irradiance: moved.irradiance,
        angular_radius: moved.angular_radius,
        kind: LightKind::Compact,
        place,
    }
}

/// Raises a direction to two degrees above the horizon if there is ground: lower lights cast
/// useless, endless shadows.
pub(super) fn above_horizon(direction: Vec3, ground: bool) -> Vec3 {
    const LEAST: f32 = 0.034_9;
    if !ground || direction.z >= LEAST {
        return direction;
    }
    let level = direction
        .truncate()
        .try_normalize()
        .unwrap_or(glam::Vec2::X);
    (level * (1.0 - LEAST * LEAST).sqrt()).extend(LEAST)
}

/// All followed sources.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceTracker {
    pub sources: Vec<TrackedSource>,
    next_id: u32,
}

impl SourceTracker {
    /// Updates the sources with those of this frame. Returns true if one appeared or disappeared.
    pub fn update(&mut self, found: &[Source], directions: &[Vec3], gains: Mat3) -> bool {
        let pairs = self.pair(found);
        let mut kept = Vec::with_capacity(found.len());
        let mut changed = self.sources.len() != found.len();
        let mut old: Vec<Option<TrackedSource>> = self.sources.drain(..).map(Some).collect();
        for (source, partner) in found.iter().zip(pairs) {
            match partner.and_then(|k| old[k].take()) {
                Some(mut tracked) => {
                    tracked.follow(source, directions, gains);
                    kept.push(tracked);
                }
                None => {
                    kept.push(TrackedSource::new(self.next_id, source, directions, gains));
                    self.next_id += 1;
                    changed = true;
                }
            }
        }
        self.sources = kept;
        changed
    }

    /// Returns, for every found source, the index of the followed one that it continues: nearest
    /// pairs first.
    fn pair(&self, found: &[Source]) -> Vec<Option<usize>> {
        let mut distances = Vec::new();
        for (i, new) in found.iter().enumerate() {
            for (k, old) in self.sources.iter().enumerate() {
                let angle = new.direction.angle_between(old.direction);
                let is_alike = new.unseen.is_some() == old.is_unseen;
                if is_alike && angle < GATE + old.radius() {
                    distances.push((angle, i, k));
                }
            }
        }
        distances.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut partner = vec![None; found.len()];
        let mut taken = vec![false; self.sources.len()];
        for (_, i, k) in distances {
            if partner[i].is_none() && !taken[k] {
                partner[i] = Some(k);
                taken[k] = true;
            }
        }
        partner
    }
}
