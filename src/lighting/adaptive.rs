//! The adaptive dome: compact sources get lights of their own at their true directions,
//! and the rest of the budget goes to cells of similar importance.

use super::cells::Cells;
use super::cube::CubeGrid;
use super::geodesic::FaceSource;
use super::lamp_distance::UnseenLamp;
use super::light::{DomeLight, LightKind};
use super::place::{LampDistance, LampPlane, LightPlace, Viewpoints};
use super::sources::{LUMINANCE, Source};
use super::tracking::{SourceTracker, above_horizon};
use glam::{DVec3, Mat3, Vec3};

/// Part of its radius by which a light must move before its direction changes: the shadow's blur
/// hides smaller movements, and the shadow map stays valid.
const DEAD_BAND: f32 = 0.05;

/// Minimum radius of the lights into which a source is split, radians (0.6°): no shadow map
/// resolves smaller ones.
const MIN_RADIUS: f32 = 0.0105;

/// Minimum share of the budget for cells.
const MIN_CELL_SHARE: f32 = 0.25;

/// A complete compact source.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CompactSource {
    /// Constant while the source is followed, and never reused.
    pub id: u32,
    /// From the observer to the point from which it is seen, metres: a mirrored sphere shows lamps as they are seen
    /// from inside it.
    pub viewpoint: Vec3,
    /// Unit vector from there towards its centre of energy, world.
    pub direction: Vec3,
    /// Irradiance on a surface that faces it there, scene camera units.
    pub irradiance: Vec3,
    /// Half angle of a cone with its solid angle, radians.
    pub angular_radius: f32,
    /// Its distance from there.
    pub distance: LampDistance,
    /// Where it is, world, metres, if it is known to be near.
    pub position: Option<DVec3>,
    /// Share of its light in pixels that every exposure clips, 0..=1: so much is uncertain.
    pub clipped: f32,
    /// Number of dome lights that represent it.
    pub lights: usize,
    /// Whether the observer does not see it: real shadows show it.
    pub is_unseen: bool,
}

impl CompactSource {
    /// A lamp that the observer does not see.
    pub(super) const fn of_unseen(lamp: &UnseenLamp) -> Self {
        Self {
            id: 0,
            viewpoint: Vec3::ZERO,
            direction: lamp.direction,
            irradiance: lamp.irradiance,
            angular_radius: lamp.angular_radius,
            distance: lamp.distance,
            position: None,
            clipped: 0.0,
            lights: 0,
            is_unseen: true,
        }
    }
}

/// The owner of a slot of the dome.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Owner {
    Free,
    Source { id: u32, leaf: usize },
    Cell(usize),
}

/// Assigns lights to slots, coherently in time.
#[derive(Clone, Debug)]
pub struct AdaptiveDome {
    budget: usize,
    ground: bool,
    tracker: SourceTracker,
    cells: Cells,
    cell_count: usize,
    owners: Vec<Owner>,
    lights: Vec<DomeLight>,
}

impl AdaptiveDome {
    /// Creates a dome of at most `budget` lights. With `ground`, all are above the horizon.
    #[must_use]
    pub fn new(budget: usize, ground: bool) -> Self {
        let dark = DomeLight {
            direction: Vec3::Z,
            irradiance: Vec3::ZERO,
            angular_radius: 0.0,
            kind: LightKind::Cell,
            place: LightPlace::FAR,
        };
        Self {
            budget,
            ground,
            tracker: SourceTracker::default(),
            cells: Cells::default(),
            cell_count: 0,
            owners: vec![Owner::Free; budget],
            lights: vec![dark; budget],
        }
    }

    /// Returns the lights of this frame. `sources` hold indices into `directions` and radiance in
    /// the environment camera's units, which `gains` convert to the scene camera's units; `texels`
    /// of `grid` hold the rest of the environment, in the scene camera's units.
    pub fn update(
        &mut self,
        (sources, views): (&[Source], &Viewpoints),
        directions: &[Vec3],
        gains: Mat3,
        texels: &[Vec3],
        grid: &CubeGrid,
    ) -> Vec<DomeLight> {
        let changed = self.tracker.update(sources, directions, gains);
        self.plan(changed, texels, grid);
        let divided = self
            .cells
            .update(texels, grid, self.cell_count, self.ground);
        let mut requested = Vec::with_capacity(self.budget);
        for source in &mut self.tracker.sources {
            let id = source.id;
            let lights = source.split(self.ground, views).into_iter().enumerate();
            requested.extend(lights.map(|(leaf, light)| (Owner::Source { id, leaf }, light)));
        }
        let cells = self
            .cells
            .lights(texels, grid, self.ground)
            .into_iter()
            .enumerate();
        requested.extend(cells.map(|(k, light)| (Owner::Cell(k), light)));
        self.assign(&requested, divided);
        self.lights.clone()
    }

    /// Sets the distances of sources from the observer by their ids; those of the other sources stay
    /// as they were.
    pub fn set_distances(&mut self, distances: &[(u32, LampDistance)]) {
        for source in &mut self.tracker.sources {
            let known = distances.iter().find(|(id, _)| *id == source.id);
            source.distance = known.map_or(source.distance, |(_, distance)| *distance);
        }
    }

    /// Sets the planes of sources that are flat, by their ids; the others are not.
    pub fn set_planes(&mut self, planes: &[(u32, LampPlane)]) {
        for source in &mut self.tracker.sources {
            let plane = planes.iter().find(|(id, _)| *id == source.id);
            source.plane = plane.map(|(_, plane)| *plane);
        }
    }

    /// Returns the compact sources of the last frame, in no particular order.
    #[must_use]
    pub fn sources(&self) -> Vec<CompactSource> {
        let tracked = self.tracker.sources.iter();
        tracked
            .map(|s| CompactSource {
                id: s.id,
                viewpoint: Vec3::ZERO,
                direction: s.direction,
                irradiance: s.flux,
                angular_radius: s.radius(),
                distance: s.distance,
                position: None,
                clipped: s.clipped,
                lights: s.lights,
                is_unseen: s.is_unseen,
            })
            .collect()
    }

    /// Returns unit vectors from the observer to `count` parts, with equal energy, of a source.
    #[must_use]
    pub(super) fn parts(&self, id: u32, count: usize) -> Vec<Vec3> {
        let source = self.tracker.sources.iter().find(|s| s.id == id);
        source.map_or_else(Vec::new, |s| s.parts(count))
    }

    /// Returns the sources in the order in which they were found, each with the directions of its
    /// lights; `taken` is empty.
    pub(super) fn face_sources(&self) -> impl Iterator<Item = FaceSource> + '_ {
        self.tracker.sources.iter().map(|source| FaceSource {
            id: source.id,
            direction: above_horizon(source.direction, self.ground),
            angular_radius: source.radius(),
            spread: self.spread(source.id),
            irradiance_in_faces: Vec::new(),
        })
    }

    /// Returns the directions of a source's lights and their shares of its light.
    fn spread(&self, id: u32) -> Vec<(Vec3, f32)> {
        let own = |(owner, light): (&Owner, &DomeLight)| match owner {
            Owner::Source { id: of, leaf } if *of == id => Some((*leaf, *light)),
            _ => None,
        };
        let mut lights: Vec<_> = self
            .owners
            .iter()
            .zip(&self.lights)
            .filter_map(own)
            .collect();
        // Leaves with consecutive numbers are neighbours.
        lights.sort_by_key(|(leaf, _)| *leaf);
        let weight = |light: &DomeLight| light.irradiance.dot(LUMINANCE).max(0.0);
        let total: f32 = lights.iter().map(|(_, light)| weight(light)).sum();
        let share = |light: &DomeLight| weight(light) / total.max(f32::MIN_POSITIVE);
        let each = lights
            .iter()
            .map(|(_, light)| (light.direction, share(light)));
        each.collect()
    }

    /// Decides how many lights each source gets. With energy S and extent r split into n parts,
    /// each part's error grows with (S/n)(r/√n); equal errors everywhere require n ∝ (S r)^⅔.
    fn plan(&mut self, changed: bool, texels: &[Vec3], grid: &CubeGrid) {
        let demand: Vec<f32> = self
            .tracker
            .sources
            .iter()
            .map(|s| (s.share(self.ground) * s.radius()).max(0.0).powf(2.0 / 3.0))
            .collect();
        let rest = (self.rest(texels, grid) * std::f32::consts::SQRT_2).powf(2.0 / 3.0);
        let total = (demand.iter().sum::<f32>() + rest).max(f32::MIN_POSITIVE);
        let scale = self.budget as f32 / total;
        let max = ((1.0 - MIN_CELL_SHARE) * self.budget as f32).max(1.0);
        let for_sources: f32 = demand.iter().map(|d| (d * scale).max(1.0)).sum();
        let squeeze = (max / for_sources.max(1.0)).min(1.0);
        let counts: Vec<usize> = demand
            .iter()
            .zip(&self.tracker.sources)
            .map(|(d, source)| {
                let max = (source.radius() / MIN_RADIUS).powi(2);
                ((d * scale * squeeze).min(max).round() as usize).max(1)
            })
            .collect();
        let differs = |(s, &n): (&super::tracking::TrackedSource, &usize)| {
            (s.lights as f32 - n as f32).abs() > (0.35 * s.lights as f32).max(1.6)
        };
        if changed || self.tracker.sources.iter().zip(&counts).any(differs) {
            for (source, &n) in self.tracker.sources.iter_mut().zip(&counts) {
                let keep = source.lights > 0 && !differs((source, &n));
                source.plan(if keep { source.lights } else { n });
            }
        }
        let used: usize = self.tracker.sources.iter().map(|s| s.lights).sum();
        self.cell_count = self.budget.saturating_sub(used);
    }

    /// Returns the luminance of the ground's irradiance (without ground: of all light), without the
    /// sources.
    fn rest(&self, texels: &[Vec3], grid: &CubeGrid) -> f32 {
        let rows = texels.iter().zip(&grid.directions).zip(&grid.solid_angles);
        rows.map(|((l, d), w)| {
            let cosine = if self.ground { d.z.max(0.0) } else { 1.0 };
            l.dot(LUMINANCE).max(0.0) * w * cosine
        })
        .sum()
    }

    /// Assigns lights to slots: an owner keeps its slot, a new one gets the free slot whose last
    /// light was nearest to it.
    fn assign(&mut self, requested: &[(Owner, DomeLight)], divided: bool) {
        let mut slot_of: Vec<Option<usize>> = requested
            .iter()
            .map(|(owner, _)| {
                let reassigned = divided && matches!(owner, Owner::Cell(_));
                if reassigned {
                    None
                } else {
                    self.owners.iter().position(|o| o == owner)
                }
            })
            .collect();
        let mut taken = vec![false; self.budget];
        slot_of.iter().flatten().for_each(|&s| taken[s] = true);
        for (i, slot) in self.nearest_free(requested, &slot_of, &taken) {
            slot_of[i] = Some(slot);
            taken[slot] = true;
        }
        for (slot, owner) in self
            .owners
            .iter_mut()
            .enumerate()
            .filter(|(s, _)| !taken[*s])
        {
            *owner = Owner::Free;
            self.lights[slot].irradiance = Vec3::ZERO;
        }
        for ((owner, light), slot) in requested.iter().zip(slot_of) {
            if let Some(slot) = slot {
                self.put(slot, *owner, *light);
            }
        }
    }

    /// Returns pairs of (index into `requested`, free slot), nearest directions first.
    fn nearest_free(
        &self,
        requested: &[(Owner, DomeLight)],
        slot_of: &[Option<usize>],
        taken: &[bool],
    ) -> Vec<(usize, usize)> {
        let mut pairs = Vec::new();
        for (i, (_, light)) in requested
            .iter()
            .enumerate()
            .filter(|(i, _)| slot_of[*i].is_none())
        {
            for slot in (0..self.budget).filter(|&s| !taken[s]) {
                let distance = light
                    .direction
                    .distance_squared(self.lights[slot].direction);
                pairs.push((distance, i, slot));
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut placed = vec![false; requested.len()];
        let mut full = taken.to_vec();
        let mut chosen = Vec::new();
        for (_, i, slot) in pairs {
            if !placed[i] && !full[slot] {
                placed[i] = true;
                full[slot] = true;
                chosen.push((i, slot));
            }
        }
        chosen
    }

    fn put(&mut self, slot: usize, owner: Owner, mut light: DomeLight) {
        let old = self.lights[slot];
        let moved =
            old.direction.angle_between(light.direction) + old.place.parallax_to(&light.place);
        let same = self.owners[slot] == owner && old.irradiance != Vec3::ZERO;
        if same && moved < DEAD_BAND * light.angular_radius {
            if self.ground {
                light.irradiance *= light.direction.z / old.direction.z;
            }
            light.direction = old.direction;
            light.place = old.place;
        }
        self.owners[slot] = owner;
        self.lights[slot] = light;
    }
}
