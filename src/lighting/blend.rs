//! Blends the light of two instants.
//!
//! Everything that adds up is blended linearly: radiance, irradiance and the flux of every source.
//! So the irradiance of the ground is exactly the linear blend of both ends:
//!
//! ```text
//!   E = (1 − w) E_from + w E_to
//! ```
//!
//! Sources also move: a dome light, or a compact source of the radiance map, goes from its
//! direction in one light to that in the other, weighted by its energy, so that a light that
//! appears or disappears stays where it is. What is in the same slot but is another source does
//! not sweep through the sky: see `blend::lights`.

pub(crate) mod lights;
mod map;

use super::light::{Harmonics, Lighting};
use super::sources::LUMINANCE;
use glam::Vec3;
use std::sync::Arc;

/// Marks the generations of blends, which never equal those of estimates.
const BLENDED: u64 = 1 << 63;
/// Maximum number of recycled blends: in use by the compositor, waiting for it, being prepared.
const MAX_RECYCLED: usize = 4;
/// Factor of the total flux between two successive environment pictures from which the real light has
/// jumped, e.g. because a lamp was switched. Movement alone hardly changes the total flux.
const JUMP_FACTOR: f32 = 1.25;
/// Change of the irradiance on a surface that faces any of six sides, as a share of the largest of
/// these irradiances, from which light has jumped to another place.
const JUMP_SHARE: f32 = 0.35;

/// Blends pairs of lights into recycled buffers.
#[derive(Debug, Default)]
pub struct Blender {
    count: u64,
    recycled: Vec<Arc<Lighting>>,
}

impl Blender {
    /// Returns the blend of `from` (`weight` 0) and `to` (`weight` 1). At the ends, and where the
    /// two cannot be blended ([`can_blend`]), this is one of them itself; otherwise it has a new
    /// generation, which no estimate has.
    pub fn blend(
        &mut self,
        from: &Arc<Lighting>,
        to: &Arc<Lighting>,
        weight: f32,
    ) -> Arc<Lighting> {
        if weight >= 1.0 || Arc::ptr_eq(from, to) || !can_blend(from, to) {
            return Arc::clone(to);
        }
        if weight <= 0.0 {
            return Arc::clone(from);
        }
        let mut blend = self.free_buffer(from);
        self.count += 1;
        // Only this function holds the buffer, so nothing is copied.
        let out = Arc::make_mut(&mut blend);
        blend_into(from, to, Shares::moving(weight), out);
        out.generation = BLENDED | self.count;
        if self.recycled.len() < MAX_RECYCLED {
            self.recycled.push(Arc::clone(&blend));
        }
        blend
    }

    /// Removes a recycled buffer without another owner from the list; creates one from `like` if
    /// there is none.
    fn free_buffer(&mut self, like: &Arc<Lighting>) -> Arc<Lighting> {
        let is_free = |buffer: &mut Arc<Lighting>| Arc::get_mut(buffer).is_some();
        match self.recycled.iter_mut().position(is_free) {
            Some(at) => self.recycled.swap_remove(at),
            None => Arc::new(Lighting::clone(like)),
        }
    }
}

/// Returns whether two lights have the same structure: dome, maps and faces.
#[must_use]
pub fn can_blend(from: &Lighting, to: &Lighting) -> bool {
    let lens = |l: &Lighting| {
        (
            l.radiance.size,
            l.radiance.levels.len(),
            l.radiance.phong.len(),
        )
    };
    let faces = match (&from.faces, &to.faces) {
        (Some(a), Some(b)) => {
            Arc::ptr_eq(&a.membership, &b.membership) && a.radiance.len() == b.radiance.len()
        }
        (a, b) => a.is_none() && b.is_none(),
    };
    from.lights.len() == to.lights.len()
        && lens(from) == lens(to)
        && from.radiance.filtering == to.radiance.filtering
        && faces
}

/// Returns whether the real light has jumped from `from` to `to` (a lamp was switched, a curtain
/// opened) instead of having moved or changed gradually: its total flux has changed by more than a
/// factor, or a large share of it now comes from elsewhere. `to` is that of the `pictures`-th
/// environment picture after that of `from`, and light without jumps may change as much from each to the
/// next.
#[must_use]
pub fn has_jumped(from: &Lighting, to: &Lighting, pictures: u32) -> bool {
    let pictures = pictures.max(1) as f32;
    let flux = |l: &Lighting| -> f32 { l.lights.iter().map(|l| l.irradiance.dot(LUMINANCE)).sum() };
    let (a, b) = (flux(from).max(0.0), flux(to).max(0.0));
    if a.max(b) > JUMP_FACTOR.powf(pictures) * a.min(b) {
        return true;
    }
    let (from, to) = (side_irradiance(from), side_irradiance(to));
    let most = from.iter().chain(&to).copied().fold(0.0, f32::max);
    let mut pairs = from.iter().zip(to);
    pairs.any(|(a, b)| (a - b).abs() > pictures * JUMP_SHARE * most)
}

/// Returns the luminance of the dome lights' irradiance on surfaces that face ±X, ±Y and ±Z.
pub(crate) fn side_irradiance(lighting: &Lighting) -> [f32; 6] {
    let mut sides = [0.0; 6];
    for light in &lighting.lights {
        let d = light.direction * light.irradiance.dot(LUMINANCE);
        for (k, side) in sides.iter_mut().enumerate() {
            let along = d[k / 2];
            *side += if k % 2 == 0 { along } else { -along }.max(0.0);
        }
    }
    sides
}

/// How much of the second light is in a blend.
#[derive(Clone, Copy)]
pub(crate) struct Shares {
    /// Share of its energy.
    pub energy: f32,
    /// Share of its directions and extents; `None` to weight them by energy.
    pub place: Option<f32>,
}

impl Shares {
    /// Everything moves from the first light to the second.
    const fn moving(weight: f32) -> Self {
        Self {
            energy: weight,
            place: None,
        }
    }

    /// Returns the share of the second of two sources' directions and extents.
    fn place(self, from: f32, to: f32) -> f32 {
        let (a, b) = (
            (1.0 - self.energy) * from.max(0.0),
            self.energy * to.max(0.0),
        );
        match self.place {
            Some(share) if a > 0.0 && b > 0.0 => share,
            _ if a + b > 0.0 => b / (a + b),
            _ => self.energy,
        }
    }
}

/// Blends everything but the generation into `out`.
pub(crate) fn blend_into(from: &Lighting, to: &Lighting, shares: Shares, out: &mut Lighting) {
    let weight = shares.energy;
    let between = to.captured_at.nanos_since(from.captured_at) as f64 * f64::from(weight);
    out.captured_at = from.captured_at.offset_nanos(between as i64);
    out.irradiance = blend_harmonics(&from.irradiance, &to.irradiance, weight);
    out.ground_radiance = from.ground_radiance.lerp(to.ground_radiance, weight);
    lights::blend_lights(&from.lights, &to.lights, shares, &mut out.lights);
    map::blend_map(
        &from.radiance,
        &to.radiance,
        shares,
        Arc::make_mut(&mut out.radiance),
    );
    map::blend_faces(
        from.faces.as_ref(),
        to.faces.as_ref(),
        shares,
        &mut out.faces,
    );
}

fn blend_harmonics(from: &Harmonics, to: &Harmonics, weight: f32) -> Harmonics {
    let mut out = *from;
    for (c, to) in out.coefficients.iter_mut().zip(&to.coefficients) {
        *c = c.lerp(*to, weight);
    }
    out
}

/// Unit vector from `a` (`share` 0) to `b` (1), along their great circle. A direction that does not
/// change keeps its bits, so that its shadow map is not drawn again.
fn toward(a: Vec3, b: Vec3, share: f32) -> Vec3 {
    if a == b || share <= 0.0 {
        return a;
    }
    if share >= 1.0 {
        return b;
    }
    a.lerp(b, share)
        .try_normalize()
        .unwrap_or(if share < 0.5 { a } else { b })
}

#[cfg(test)]
mod tests;
