//! Which shadow map belongs to which dome light, where it looks, and which maps are drawn
//! again in this frame.
//!
//! A map shows the casters along a light's direction; its light's colour may change freely.
//! So a map is only drawn again when its direction or a caster has moved, and a light keeps
//! the direction its map was drawn with until then.

use super::gpu_data::LightUniform;
use glam::{Mat4, Vec3};
use penumbra_lighting::{DomeLight, LightKind};

/// Extreme points of a set of casters, enough to fit a map around it from any side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CasterHull {
    points: Vec<Vec3>,
    /// Casters that move: where their points begin above, and these in their own frames.
    moving: Vec<(usize, Vec<Vec3>)>,
}

/// Directions along which [`CasterHull`] keeps the outermost vertex.
const HULL_DIRECTIONS: usize = 512;
/// A hull of outermost vertices along finitely many directions is a little too small.
const HULL_MARGIN: f32 = 0.01;

impl CasterHull {
    /// The outermost of `vertices` (world, metres) along directions spread over the sphere.
    #[must_use]
    pub fn around(vertices: &[[f32; 3]]) -> Self {
        let keep = Self::outermost(vertices).into_iter();
        Self {
            points: keep.map(|i| Vec3::from(vertices[i])).collect(),
            moving: Vec::new(),
        }
    }

    /// Which of `vertices` these are.
    #[must_use]
    pub fn outermost(vertices: &[[f32; 3]]) -> Vec<usize> {
        let mut keep: Vec<usize> = fibonacci_sphere(HULL_DIRECTIONS)
            .filter_map(|d| {
                let along = |i: &usize| Vec3::from(vertices[*i]).dot(d);
                (0..vertices.len()).max_by(|a, b| along(a).total_cmp(&along(b)))
            })
            .collect();
        keep.sort_unstable();
        keep.dedup();
        keep
    }

    /// Around casters that move, too: their outermost points, in their own frames, and where
    /// they are.
    #[must_use]
    pub fn with_moving(mut self, moving: impl Iterator<Item = (Vec<Vec3>, Mat4)>) -> Self {
        for (own, world) in moving {
            let first = self.points.len();
            self.points
                .extend(own.iter().map(|p| world.transform_point3(*p)));
            self.moving.push((first, own));
        }
        self
    }

    /// The moving caster of this `number` is elsewhere.
    fn place(&mut self, number: usize, world: Mat4) {
        if let Some((first, own)) = self.moving.get(number) {
            let points = self.points.iter_mut().skip(*first);
            for (point, own) in points.zip(own) {
                *point = world.transform_point3(*own);
            }
        }
    }

    /// Around both.
    #[must_use]
    pub fn joined(&self, other: &Self) -> Self {
        Self {
            points: [self.points.as_slice(), &other.points].concat(),
            moving: Vec::new(),
        }
    }

    /// Axis and half angle, radians, of a narrow cone around everything seen from `eye`;
    /// no angle (infinite) where the eye is among the casters, `None` without points.
    #[must_use]
    pub fn cone_from(&self, eye: Vec3) -> Option<(Vec3, f32)> {
        let away = |p: &Vec3| (*p - eye).try_normalize().unwrap_or(Vec3::ZERO);
        let first = away(self.points.first()?);
        let bounds = self.points.iter().map(away);
        let (low, high) = bounds.fold((first, first), |(l, h), d| (l.min(d), h.max(d)));
        let axis = (low + high).try_normalize();
        let narrowest = self
            .points
            .iter()
            .map(away)
            .map(|d| d.dot(axis.unwrap_or_default()));
        let cosine = narrowest.fold(1.0, f32::min);
        Some(match axis {
            Some(axis) if cosine > 0.01 => (axis, cosine.acos()),
            _ => (Vec3::Z, f32::INFINITY),
        })
    }

    /// Half angle, radians, of the cone about `axis` that holds everything seen from `eye`.
    pub(super) fn angle_around(&self, eye: Vec3, axis: Vec3) -> f32 {
        let cosine = |p: &Vec3| (*p - eye).try_normalize().map_or(-1.0, |d| d.dot(axis));
        self.points
            .iter()
            .map(cosine)
            .fold(1.0, f32::min)
            .clamp(-1.0, 1.0)
            .acos()
    }

    /// Least and greatest coordinate along `axis`; `None` without points.
    pub(super) fn extent(&self, axis: Vec3) -> Option<(f32, f32)> {
        self.points
            .iter()
            .map(|p| p.dot(axis))
            .fold(None, |range, x| match range {
                None => Some((x, x)),
                Some((lo, hi)) => Some((lo.min(x), hi.max(x))),
            })
    }
}

/// Points spread evenly over the unit sphere along a golden spiral.
fn fibonacci_sphere(count: usize) -> impl Iterator<Item = Vec3> {
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * i as f32 + 1.0) / count as f32;
        let (sin, cos) = (golden * i as f32).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * cos, r * sin, z)
    })
}

/// An affine map from the world to a shadow map: rows for u, v, depth; the size of a
/// texel and the length of the depth range, metres. All zero where nothing casts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    pub rows: [[f32; 4]; 3],
    pub texel: f32,
    pub depth: f32,
}

impl Fit {
    const NOWHERE: Self = Self {
        rows: [[0.0; 4]; 3],
        texel: 0.0,
        depth: 0.0,
    };
}

pub(super) fn fit(hull: &CasterHull, to_light: Vec3, map_size: u32) -> Fit {
    let (right, up) = to_light.any_orthonormal_pair();
    let (Some(u), Some(v), Some(d)) = (hull.extent(right), hull.extent(up), hull.extent(to_light))
    else {
        return Fit::NOWHERE;
    };
    let widen = |(lo, hi): (f32, f32)| {
        // Two texels of border, so that filtering at the edge finds emptiness.
        let pad = (hi - lo).max(1e-4) * (HULL_MARGIN + 2.0 / map_size as f32);
        (lo - pad, hi + pad)
    };
    let (u, v, d) = (widen(u), widen(v), widen(d));
    let row =
        |axis: Vec3, (lo, hi): (f32, f32)| (axis / (hi - lo)).extend(-lo / (hi - lo)).to_array();
    let towards = row(to_light, d);
    let away = [-towards[0], -towards[1], -towards[2], 1.0 - towards[3]];
    Fit {
        rows: [row(right, u), row(up, v), away],
        texel: (u.1 - u.0).max(v.1 - v.0) / map_size as f32,
        depth: d.1 - d.0,
    }
}

/// One shadow map's state.
#[derive(Clone, Copy, Debug)]
struct Slot {
    direction: Vec3,
    fits: (Fit, Fit),
    /// Generation of the casters in the map; 0 = never drawn.
    casters: u64,
}

impl Slot {
    const NEVER_DRAWN: Self = Self {
        direction: Vec3::Z,
        fits: (Fit::NOWHERE, Fit::NOWHERE),
        casters: 0,
    };
}

/// All shadow maps.
#[derive(Debug, Default)]
pub struct ShadowSlots {
    slots: Vec<Slot>,
    virtual_hull: CasterHull,
    phantom_hull: CasterHull,
    both: CasterHull,
    casters: u64,
    next_forced: usize,
}

impl LightUniform {
    /// A light without shadow maps.
    #[must_use]
    pub fn unmapped(light: &DomeLight) -> Self {
        let compact = f32::from(u8::from(light.kind == LightKind::Compact));
        Self {
            direction: light.direction.extend(light.angular_radius).to_array(),
            irradiance: light.irradiance.extend(compact).to_array(),
            ..Self::default()
        }
    }
}

/// How many maps a frame draws again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refresh {
    /// At most so many, those first whose light changed most; maps that are still right
    /// are left alone.
    UpTo(usize),
    /// Exactly so many in turn, right or not: what the paper did, and what the benchmark
    /// measures.
    InTurn(usize),
}

impl ShadowSlots {
    /// New casters: every map is out of date.
    pub fn set_casters(&mut self, virtual_hull: CasterHull, phantom_hull: CasterHull) {
        self.both = virtual_hull.joined(&phantom_hull);
        self.virtual_hull = virtual_hull;
        self.phantom_hull = phantom_hull;
        self.casters += 1;
    }

    /// The moving caster of this `number` is elsewhere; [`Self::casters_moved`] follows.
    pub fn move_caster(&mut self, number: usize, world: Mat4) {
        self.virtual_hull.place(number, world);
    }

    /// Some of the casters were moved: every map is out of date.
    pub fn casters_moved(&mut self) {
        let virtual_points = &self.virtual_hull.points;
        if let Some(same) = self.both.points.get_mut(..virtual_points.len()) {
            same.copy_from_slice(virtual_points);
        }
        self.casters += 1;
    }

    /// All casters, and how often they have changed.
    #[must_use]
    pub const fn casters(&self) -> (&CasterHull, u64) {
        (&self.both, self.casters)
    }

    /// Every map is lost.
    pub fn forget(&mut self) {
        self.slots.clear();
    }

    /// Chooses the maps to draw again for `lights` and points them; the chosen slots'
    /// numbers go into `chosen` (cleared first). Maps never drawn are always chosen.
    pub fn schedule(
        &mut self,
        lights: &[DomeLight],
        map_size: u32,
        refresh: Refresh,
        chosen: &mut Vec<usize>,
    ) {
        // Fewer lights, or none while there is no pose, leave the other maps as they are.
        if self.slots.len() < lights.len() {
            self.slots.resize(lights.len(), Slot::NEVER_DRAWN);
        }
        chosen.clear();
        match refresh {
            Refresh::UpTo(limit) => self.most_changed(lights, limit, chosen),
            Refresh::InTurn(count) => self.in_turn(lights.len(), count, chosen),
        }
        for i in chosen.iter().copied() {
            let direction = lights[i].direction;
            let virtual_fit = fit(&self.virtual_hull, direction, map_size);
            let phantom_fit = fit(&self.phantom_hull, direction, map_size);
            self.slots[i] = Slot {
                direction,
                fits: (virtual_fit, phantom_fit),
                casters: self.casters,
            };
        }
    }

    fn most_changed(&self, lights: &[DomeLight], limit: usize, chosen: &mut Vec<usize>) {
        let urgency = |i: usize| {
            let (slot, light) = (&self.slots[i], &lights[i]);
            if slot.casters == 0 {
                return f32::INFINITY;
            }
            let turned = slot.direction.distance(light.direction);
            // Older maps are the more urgent: where casters move in every picture none is
            // passed over for ever.
            let moved = (self.casters - slot.casters) as f32;
            (turned + moved) * light.irradiance.element_sum()
        };
        chosen.extend((0..lights.len()).filter(|i| urgency(*i) > 1e-6));
        chosen.sort_by(|a, b| urgency(*b).total_cmp(&urgency(*a)).then(a.cmp(b)));
        let first_time = chosen
            .iter()
            .take_while(|i| urgency(**i) == f32::INFINITY)
            .count();
        chosen.truncate(limit.max(first_time));
    }

    fn in_turn(&mut self, n: usize, count: usize, chosen: &mut Vec<usize>) {
        chosen.extend((0..n).filter(|i| self.slots[*i].casters == 0));
        for _ in 0..count.min(n) {
            let i = self.next_forced % n;
            self.next_forced += 1;
            if !chosen.contains(&i) {
                chosen.push(i);
            }
        }
    }

    /// What the shaders need of light `i`: the colour of now, the direction of its map.
    #[must_use]
    pub fn uniform(&self, i: usize, light: &DomeLight) -> LightUniform {
        let slot = &self.slots[i];
        let (virtual_fit, phantom_fit) = &slot.fits;
        let compact = if light.kind == LightKind::Compact {
            1.0
        } else {
            0.0
        };
        LightUniform {
            virtual_map: virtual_fit.rows,
            phantom_map: phantom_fit.rows,
            direction: slot.direction.extend(light.angular_radius).to_array(),
            irradiance: light.irradiance.extend(compact).to_array(),
            scale: [
                virtual_fit.texel,
                phantom_fit.texel,
                virtual_fit.depth,
                phantom_fit.depth,
            ],
        }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    fn cube() -> Vec<[f32; 3]> {
        (0..8)
            .map(|i| [(i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2) as f32])
            .collect()
    }

    fn light(direction: Vec3) -> DomeLight {
        DomeLight {
            direction,
            irradiance: Vec3::ONE,
            angular_radius: 0.1,
            kind: LightKind::Cell,
        }
    }

    #[test]
    fn a_map_holds_every_caster_and_depth_grows_away_from_the_light() {
        let hull = CasterHull::around(&cube());
        for d in fibonacci_sphere(50) {
            let fit = fit(&hull, d, 256);
            let apply = |row: [f32; 4], p: Vec3| Vec3::new(row[0], row[1], row[2]).dot(p) + row[3];
            for p in cube().into_iter().map(Vec3::from) {
                for row in fit.rows {
                    assert!((0.0..=1.0).contains(&apply(row, p)));
                }
                assert!(apply(fit.rows[2], p) < apply(fit.rows[2], p - d * 0.1));
            }
        }
    }

    #[test]
    fn only_moved_lights_are_drawn_again_most_changed_first() {
        let mut slots = ShadowSlots::default();
        slots.set_casters(CasterHull::around(&cube()), CasterHull::default());
        let mut lights = vec![light(Vec3::Z), light(Vec3::X), light(Vec3::Y)];
        let mut chosen = Vec::new();
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        assert_eq!(chosen.len(), 3, "maps never drawn are all drawn");
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        assert!(chosen.is_empty(), "nothing moved");
        lights[1].direction = Vec3::new(1.0, 0.1, 0.0).normalize();
        lights[2].direction = Vec3::new(1.0, 1.0, 0.0).normalize();
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        assert_eq!(chosen, [2]);
        assert_eq!(slots.uniform(1, &lights[1]).direction[..3], [1.0, 0.0, 0.0]);
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        assert_eq!(chosen, [1]);
    }

    #[test]
    fn maps_outlast_frames_without_light() {
        let mut slots = ShadowSlots::default();
        slots.set_casters(CasterHull::around(&cube()), CasterHull::default());
        let lights = vec![light(Vec3::Z), light(Vec3::X)];
        let mut chosen = Vec::new();
        slots.schedule(&lights, 64, Refresh::UpTo(9), &mut chosen);
        for refresh in [Refresh::UpTo(9), Refresh::InTurn(9)] {
            slots.schedule(&[], 64, refresh, &mut chosen);
            assert!(chosen.is_empty());
        }
        slots.schedule(&lights[..1], 64, Refresh::UpTo(9), &mut chosen);
        slots.schedule(&lights, 64, Refresh::UpTo(9), &mut chosen);
        assert!(chosen.is_empty(), "{chosen:?}");
        slots.set_casters(CasterHull::around(&cube()), CasterHull::default());
        slots.schedule(&[], 64, Refresh::UpTo(9), &mut chosen);
        slots.schedule(&lights, 64, Refresh::UpTo(9), &mut chosen);
        assert_eq!(chosen.len(), 2, "new casters");
    }

    #[test]
    fn the_brightest_moved_light_goes_first_and_none_waits_for_ever() {
        let mut slots = ShadowSlots::default();
        slots.set_casters(CasterHull::around(&cube()), CasterHull::default());
        let mut lights: Vec<_> = fibonacci_sphere(16).map(light).collect();
        lights[5].irradiance *= 3.0;
        let mut chosen = Vec::new();
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        slots.set_casters(CasterHull::around(&cube()), CasterHull::default());
        let mut order = Vec::new();
        for _ in 0..16 {
            slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
            order.extend(chosen.iter().copied());
        }
        assert_eq!(order[0], 5);
        order.sort_unstable();
        assert_eq!(order, (0..16).collect::<Vec<_>>());
    }

    #[test]
    fn casters_that_move_take_their_hull_along_and_starve_no_map() {
        let mut slots = ShadowSlots::default();
        let own: Vec<Vec3> = cube().into_iter().map(Vec3::from).collect();
        let moving = std::iter::once((own.clone(), Mat4::IDENTITY));
        let still = CasterHull::around(&[[5.0, 0.0, 0.0]]).with_moving(moving);
        slots.set_casters(still, CasterHull::around(&[[0.0, 0.0, -3.0]]));
        let mut lights: Vec<_> = fibonacci_sphere(8).map(light).collect();
        lights[5].irradiance *= 3.0;
        let (mut chosen, mut drawn) = (Vec::new(), [0; 8]);
        slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
        let places = |slots: &ShadowSlots| slots.both.points.as_ptr();
        let before = places(&slots);
        for i in 1..=80 {
            slots.move_caster(0, Mat4::from_translation(Vec3::X * i as f32));
            slots.casters_moved();
            slots.schedule(&lights, 64, Refresh::UpTo(1), &mut chosen);
            chosen.iter().for_each(|i| drawn[*i] += 1);
        }
        assert_eq!(slots.both.extent(Vec3::X), Some((0.0, 81.0)));
        assert_eq!(slots.both.extent(Vec3::Z), Some((-3.0, 1.0)));
        assert_eq!(places(&slots), before, "nothing is allocated");
        assert!(drawn.iter().all(|n| *n >= 5) && drawn[5] > 12, "{drawn:?}");
    }

    #[test]
    fn in_turn_goes_round() {
        let mut slots = ShadowSlots::default();
        let lights = vec![light(Vec3::Z); 4];
        let mut chosen = Vec::new();
        slots.set_casters(CasterHull::default(), CasterHull::default());
        slots.schedule(&lights, 64, Refresh::InTurn(1), &mut chosen);
        let mut seen = Vec::new();
        for _ in 0..4 {
            slots.schedule(&lights, 64, Refresh::InTurn(1), &mut chosen);
            seen.extend(chosen.iter().copied());
        }
        seen.sort_unstable();
        assert_eq!(seen, [0, 1, 2, 3]);
    }
}
