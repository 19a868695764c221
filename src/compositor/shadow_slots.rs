//! The shadow maps of dome lights: their directions, and which of them are drawn again in this
//! frame.
//!
//! A map shows the casters along the direction of its light, whatever the colour of the light. It
//! is drawn again only when that direction or a caster has moved; until then the light keeps the
//! direction with which its map was drawn.

use super::caster_hull::{CasterHull, LightFit, fit_light};
use super::gpu_data::LightUniform;
use glam::{Mat4, Vec3};
use penumbra_lighting::{DomeLight, LightKind, LightPlace};

/// The state of one shadow map.
#[derive(Clone, Copy, Debug)]
struct Slot {
    direction: Vec3,
    place: LightPlace,
    /// Of the maps of virtual casters and of phantoms.
    fits: [LightFit; 2],
    /// Generation of the casters in the map; 0 if it was never drawn.
    casters: u64,
}

impl Slot {
    const NEVER_DRAWN: Self = Self {
        direction: Vec3::Z,
        place: LightPlace::FAR,
        fits: [LightFit::NOWHERE; 2],
        casters: 0,
    };
}

/// The state of all shadow maps.
#[derive(Debug, Default)]
pub struct ShadowSlots {
    slots: Vec<Slot>,
    virtual_hull: CasterHull,
    phantom_hull: CasterHull,
    both: CasterHull,
    casters: u64,
    next_forced: usize,
    /// Angle by which a light may turn before its shadow is renewed, as a share of its angular
    /// radius.
    tolerance: f32,
}

impl LightUniform {
    /// The uniform of a light without shadow maps.
    #[must_use]
    pub fn unmapped(light: &DomeLight) -> Self {
        let compact = f32::from(u8::from(light.kind == LightKind::Compact));
        let (right, up) = light.direction.any_orthonormal_pair();
        let place = &light.place;
        let axis = |axis: Vec3| axis.extend(-axis.dot(place.reference)).to_array();
        Self {
            right: axis(right),
            up: axis(up),
            direction: light.direction.extend(light.angular_radius).to_array(),
            irradiance: light.irradiance.extend(compact).to_array(),
            place: (light.towards(Vec3::ZERO))
                .extend(place.inverse_distance)
                .to_array(),
            more: [
                -light.direction.dot(place.reference),
                0.0,
                0.0,
                light.angular_radius.tan(),
            ],
            ..Self::default()
        }
    }
}

/// Number of shadow maps that a frame draws again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refresh {
    /// At most this number, those with the largest change first; up-to-date maps are kept.
    UpTo(usize),
    /// Exactly this number in turn, up to date or not, as in Supan 2006; the benchmark measures it.
    InTurn(usize),
}

impl ShadowSlots {
    /// No maps, with the angle by which a light may turn before its shadow is renewed, as a share
    /// of its angular radius.
    #[must_use]
    pub fn with_tolerance(tolerance: f32) -> Self {
        Self {
            tolerance,
            ..Self::default()
        }
    }

    /// Sets new casters: every map is out of date.
    pub fn set_casters(&mut self, virtual_hull: CasterHull, phantom_hull: CasterHull) {
        self.both = virtual_hull.joined(&phantom_hull);
        self.virtual_hull = virtual_hull;
        self.phantom_hull = phantom_hull;
        self.casters += 1;
    }

    /// Moves moving caster `number`; [`Self::casters_moved`] must follow.
    pub fn move_caster(&mut self, number: usize, world: Mat4) {
        self.virtual_hull.place(number, world);
    }

    /// Marks every map as out of date after casters were moved.
    pub fn casters_moved(&mut self) {
        let virtual_points = &self.virtual_hull.points;
        if let Some(same) = self.both.points.get_mut(..virtual_points.len()) {
            same.copy_from_slice(virtual_points);
        }
        self.casters += 1;
    }

    /// The hull of all casters, and its generation.
    #[must_use]
    pub const fn casters(&self) -> (&CasterHull, u64) {
        (&self.both, self.casters)
    }

    /// Forgets the contents of all maps.
    pub fn forget(&mut self) {
        self.slots.clear();
    }

    /// Chooses the maps to draw again for `lights` and sets their directions; the indices go into
    /// `chosen` (cleared first). Maps that were never drawn are always chosen.
    pub fn schedule(
        &mut self,
        lights: &[DomeLight],
        map_size: u32,
        refresh: Refresh,
        chosen: &mut Vec<usize>,
    ) {
        // With fewer lights, or none while there is no pose, the other maps are kept.
        if self.slots.len() < lights.len() {
            self.slots.resize(lights.len(), Slot::NEVER_DRAWN);
        }
        chosen.clear();
        match refresh {
            Refresh::UpTo(limit) => self.most_changed(lights, limit, chosen),
            Refresh::InTurn(count) => self.in_turn(lights.len(), count, chosen),
        }
        for i in chosen.iter().copied() {
            let light = &lights[i];
            let hulls = [&self.virtual_hull, &self.phantom_hull];
            self.slots[i] = Slot {
                direction: light.direction,
                place: light.place,
                fits: hulls.map(|hull| fit_light(hull, light, map_size)),
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
            let turned =
                slot.direction.distance(light.direction) + slot.place.parallax_to(&light.place);
            let is_turned = turned > self.tolerance * light.angular_radius;
            let turned = if is_turned { turned } else { 0.0 };
            // Urgency grows with age: where casters move in every frame, every map gets its
            // turn.
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

    /// The uniform of light `i`: its current colour, and the direction of its map.
    #[must_use]
    pub fn uniform(&self, i: usize, light: &DomeLight) -> LightUniform {
        let slot = &self.slots[i];
        let [first, second] = &slot.fits;
        let of = |fit: &LightFit| [fit.scale.x, fit.scale.y, fit.offset.x, fit.offset.y];
        let drawn = DomeLight {
            direction: slot.direction,
            place: slot.place,
            ..*light
        };
        let mut uniform = LightUniform::unmapped(&drawn);
        (uniform.virtual_fit, uniform.phantom_fit) = (of(first), of(second));
        uniform.depths = [
            first.depth_scale,
            first.depth_offset,
            second.depth_scale,
            second.depth_offset,
        ];
        (uniform.more[1], uniform.more[2]) = (first.texel, second.texel);
        uniform
    }
}

#[cfg(test)]
mod tests {
    use super::super::caster_hull::fibonacci_sphere;
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
            place: LightPlace::FAR,
        }
    }

    #[test]
    fn a_map_holds_every_caster_and_depth_grows_away_from_the_light() {
        let hull = CasterHull::around(&cube());
        for d in fibonacci_sphere(50) {
            for inverse_distance in [0.0, 0.2] {
                let light = DomeLight {
                    place: LightPlace {
                        reference: Vec3::splat(0.5),
                        inverse_distance,
                    },
                    ..light(d)
                };
                let fit = fit_light(&hull, &light, 256);
                let at = |p: Vec3| {
                    let (right, up) = d.any_orthonormal_pair();
                    let p = light
                        .in_light_space([right, up], p)
                        .expect("before the light");
                    let at = p.truncate() * fit.scale + fit.offset;
                    at.extend(p.z * fit.depth_scale + fit.depth_offset)
                };
                for p in cube().into_iter().map(Vec3::from) {
                    assert!(at(p).cmpge(Vec3::ZERO).all() && at(p).cmple(Vec3::ONE).all());
                    let behind = p - light.towards(p) * 0.1;
                    assert!(at(p).z < at(behind).z);
                    assert!(at(p).truncate().distance(at(behind).truncate()) < 1e-4);
                }
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
    fn maps_survive_frames_without_light() {
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
    fn brightest_moved_light_comes_first_and_every_light_gets_its_turn() {
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
    fn moving_casters_update_their_hull_and_every_map_is_drawn() {
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
    fn in_turn_visits_all_maps() {
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
