//! Dome lights, slot by slot.
//!
//! A slot holds the same light in both ends if its kind is the same and its directions are near
//! each other. Such a light moves. Its direction changes in steps that the blur of its shadow
//! hides, because every step costs a new shadow map.
//!
//! Otherwise the slot was given to another light. If another slot is dark in both ends, the two
//! lights fade, one out and the other in, each in its own direction. If none is dark, lights of
//! one kind switch where their energies are equal; of two kinds, the compact one fades, and the
//! other cells take over the energy of the cell.

use super::{Shares, toward};
use crate::light::{DomeLight, LightKind};
use crate::sources::LUMINANCE;
use glam::Vec3;

/// Maximum movement of a light between two pictures, radians, in addition to the radii at both
/// ends: as far as the tracking follows a source.
const MAX_MOVEMENT: f32 = 0.3;
/// Step of a direction, as a share of the light's radius: the dead band of the adaptive dome.
const STEP: f32 = 0.05;
/// Minimum height (z of the direction) of lights above ground.
const ABOVE_GROUND: f32 = 0.034;

/// Blends the lights of two domes of the same size. The irradiance of the ground by the lights of
/// each kind is blended linearly; of lights that are not all above ground, their flux.
pub(super) fn blend_lights(
    from: &[DomeLight],
    to: &[DomeLight],
    shares: Shares,
    out: &mut Vec<DomeLight>,
) {
    let weight = shares.energy;
    let heights = Heights::new(from, to);
    let pairs = || from.iter().zip(to);
    out.clear();
    out.extend(pairs().map(|(a, b)| heights.blend_slot(a, b, shares)));
    let mut spare = 0..out.len();
    let mut loses_energy = false;
    for (slot, (a, b)) in pairs().enumerate().filter(|(_, (a, b))| !is_same(a, b)) {
        let is_spare = |i: &usize| is_dark(&from[*i]) && is_dark(&to[*i]);
        if let Some(other) = spare.by_ref().find(is_spare) {
            (out[slot], out[other]) = (scaled(a, 1.0 - weight), scaled(b, weight));
        } else {
            loses_energy |= a.kind != b.kind;
        }
    }
    if loses_energy {
        heights.pin_cells(from, to, weight, out);
    }
}

fn is_dark(light: &DomeLight) -> bool {
    light.irradiance == Vec3::ZERO
}

fn scaled(light: &DomeLight, factor: f32) -> DomeLight {
    DomeLight {
        irradiance: light.irradiance * factor,
        ..*light
    }
}

/// Whether the same light may be in a slot at both ends.
fn is_same(a: &DomeLight, b: &DomeLight) -> bool {
    let reach = MAX_MOVEMENT + a.angular_radius + b.angular_radius;
    let is_near = || a.direction.angle_between(b.direction) <= reach;
    is_dark(a) || is_dark(b) || (a.kind == b.kind && is_near())
}

/// Whether each slot holds the same light at both ends, moved by less than half its radius.
pub(crate) fn is_in_place(from: &[DomeLight], to: &[DomeLight]) -> bool {
    let mut pairs = from.iter().zip(to);
    pairs.all(|(a, b)| {
        let angle = || a.direction.angle_between(b.direction);
        let is_lit = !is_dark(a) && !is_dark(b) && a.kind == b.kind;
        is_lit && angle() <= 0.5 * a.angular_radius.max(b.angular_radius)
            || is_dark(a) && is_dark(b)
    })
}

/// The measure of a light's energy.
#[derive(Clone, Copy)]
enum Heights {
    /// Irradiance of the ground.
    AboveGround,
    /// Irradiance of a surface that faces the light.
    Anywhere,
}

impl Heights {
    fn new(from: &[DomeLight], to: &[DomeLight]) -> Self {
        let mut lit = from.iter().chain(to).filter(|l| !is_dark(l));
        if lit.all(|l| l.direction.z >= ABOVE_GROUND) {
            Self::AboveGround
        } else {
            Self::Anywhere
        }
    }

    fn of(self, direction: Vec3) -> f32 {
        match self {
            Self::AboveGround => direction.z.max(ABOVE_GROUND),
            Self::Anywhere => 1.0,
        }
    }

    fn energy(self, light: &DomeLight) -> Vec3 {
        light.irradiance * self.of(light.direction)
    }

    /// Blends the lights in a slot, as if there were no other slot.
    fn blend_slot(self, a: &DomeLight, b: &DomeLight, shares: Shares) -> DomeLight {
        let weight = shares.energy;
        let is_lit_pair = !is_dark(a) && !is_dark(b);
        match (a.kind, b.kind) {
            (LightKind::Compact, LightKind::Cell) if is_lit_pair => scaled(a, 1.0 - weight),
            (LightKind::Cell, LightKind::Compact) if is_lit_pair => scaled(b, weight),
            _ => self.moved(a, b, shares),
        }
    }

    /// Moves a light from `a` to `b`.
    fn moved(self, a: &DomeLight, b: &DomeLight, shares: Shares) -> DomeLight {
        let (from, to) = (self.energy(a), self.energy(b));
        let share = shares.place(from.dot(LUMINANCE), to.dot(LUMINANCE));
        let radius = a.angular_radius + (b.angular_radius - a.angular_radius) * share;
        let steps = if is_same(a, b) {
            let angle = a.direction.angle_between(b.direction) + a.place.parallax_to(&b.place);
            (angle / (STEP * radius.max(f32::MIN_POSITIVE))).clamp(1.0, 1e4)
        } else {
            1.0
        };
        let steps = steps.ceil();
        let stepped = (share * steps).round() / steps;
        let direction = toward(a.direction, b.direction, stepped);
        DomeLight {
            direction,
            irradiance: from.lerp(to, shares.energy) / self.of(direction),
            angular_radius: radius,
            kind: if is_dark(a) { b.kind } else { a.kind },
            place: a.place.toward(&b.place, stepped),
        }
    }

    /// Scales the cells so that the sum of their energies is blended linearly, channel by channel.
    fn pin_cells(self, from: &[DomeLight], to: &[DomeLight], weight: f32, out: &mut [DomeLight]) {
        let cells = |lights: &[DomeLight]| -> Vec3 {
            let each = lights.iter().filter(|l| l.kind == LightKind::Cell);
            each.map(|l| self.energy(l)).sum()
        };
        let (target, sum) = (cells(from).lerp(cells(to), weight), cells(out));
        let scale = Vec3::select(sum.cmpgt(Vec3::splat(1e-12)), target / sum, Vec3::ONE);
        for light in out.iter_mut().filter(|l| l.kind == LightKind::Cell) {
            light.irradiance *= scale;
        }
    }
}
