//! Which compact sources have images of their own, and when these are drawn anew. Pure: pictures
//! are counted, no clock is asked, so that a replay is always the same.

use super::options::SOURCES;
use glam::{Quat, Vec2, Vec3};
use penumbra_lighting::geodesic::FaceSource;

/// Images are drawn anew when their source has moved by more than this, radians (0.25°): five
/// metres above the ground that is two centimetres.
const STEP: f32 = 0.004_36;
/// Or by more than this part of its radius: the blur hides less.
const STEP_OF_RADIUS: f32 = 0.125;
/// Or when its radius has changed by this part of itself.
const STEP_OF_WIDTH: f32 = 0.25;
/// A source is lit by images that are off by less than this, radians (2°).
const NEAR: f32 = 0.035;
/// And left to its faces when they are off by more than this (11°): the middle of a face of the
/// papers' dome is as near.
const FAR: f32 = 0.2;
/// Pictures over which a source takes its light from its faces, or gives it back.
const FADE: u8 = 8;
/// A source that has no images takes the place of one that is so many times weaker.
const STRONGER: f32 = 1.5;
/// Directions that a source's images are made of, at most.
const MOST_DIRECTIONS: usize = 16;
/// Half angle that one direction stands for where there are fewer, radians (0.5°).
const ONE_DIRECTION: f32 = 0.008_7;

/// What images were drawn for.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Made {
    direction: Vec3,
    radius: f32,
}

/// A source and its two sets of images: one in use, one to draw the next into.
#[derive(Clone, Debug, Default)]
struct Slot {
    /// The source that is followed, in the frame of the bake.
    source: Option<FaceSource>,
    /// What it takes from faces; kept while it fades.
    taken: Vec<(u32, Vec3)>,
    made: [Option<Made>; 2],
    in_use: usize,
    /// The images are near enough.
    lit: bool,
    /// Of [`FADE`].
    faded_in: u8,
}

/// Images to be drawn: into which set of which slot, and what for.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Wanted {
    pub slot: usize,
    pub set: usize,
    /// Unit vectors in the frame of the bake, and shares that add up to 1.
    pub directions: Vec<(Vec3, f32)>,
    made: Option<Made>,
}

impl Wanted {
    /// What a surface that all directions reach gets by its normal is the scalar product with
    /// this: shorter than 1 for a wide source.
    pub fn mean(&self) -> Vec3 {
        self.directions.iter().map(|(d, share)| *d * *share).sum()
    }
}

/// All slots.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceSlots {
    slots: [Slot; SOURCES],
    started: bool,
    /// Turns the world's directions into the bake's frame.
    pub bake_from_world: Quat,
}

impl SourceSlots {
    /// Takes over the sources of this picture, strongest first. True if it is the first with
    /// any light: then nothing fades, and images had better be drawn at once.
    pub fn follow(&mut self, sources: &[FaceSource]) -> bool {
        for slot in &mut self.slots {
            let known = slot.source.as_ref().map(|s| s.id);
            let found = sources.iter().find(|s| Some(s.id) == known);
            match found {
                Some(found) => slot.take(found, self.bake_from_world),
                None => slot.source = None,
            }
        }
        for source in sources.iter().take(SOURCES) {
            self.place(source);
        }
        !std::mem::replace(&mut self.started, true)
    }

    /// Gives a source a slot where it has none and one can be had.
    fn place(&mut self, source: &FaceSource) {
        let is = |slot: &&Slot| slot.source.as_ref().is_some_and(|s| s.id == source.id);
        if self.slots.iter().any(|slot| is(&slot)) {
            return;
        }
        let turn = self.bake_from_world;
        let direction = turn * source.direction;
        // One that was lost and found again goes on where it was.
        let off = |slot: &Slot| slot.off(direction);
        let free = self.slots.iter_mut().filter(|slot| slot.source.is_none());
        let nearest = free.min_by(|a, b| off(a).total_cmp(&off(b)));
        if let Some(slot) = nearest {
            if slot.faded_in == 0 || slot.off(direction) < NEAR {
                slot.take(source, turn);
            }
            return;
        }
        let strength = source.irradiance().element_sum();
        let slots = self.slots.iter_mut();
        let weakest = slots.min_by(|a, b| a.strength().total_cmp(&b.strength()));
        // It fades out first.
        if let Some(slot) = weakest.filter(|slot| strength > STRONGER * slot.strength()) {
            slot.source = None;
        }
    }

    /// The images that are most wanted.
    pub fn wanted(&self) -> Option<Wanted> {
        let rows = self.slots.iter().enumerate();
        let wanting = rows.filter_map(|(i, slot)| Some((i, slot.urgency()?)));
        let (slot, _) = wanting.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        self.slots[slot].wanted(slot)
    }

    /// Images were drawn: they are in use from now on.
    pub fn made(&mut self, wanted: &Wanted) {
        if let Some(slot) = self.slots.get_mut(wanted.slot) {
            slot.made[wanted.set] = wanted.made;
            slot.in_use = wanted.set;
        }
    }

    /// One picture more: sources take light from their faces, or give it back. `at_once`: all
    /// of it.
    pub fn fade(&mut self, at_once: bool) {
        for slot in &mut self.slots {
            slot.fade(at_once);
        }
    }

    /// Per slot: which set is in use, the share of the source's light that it has taken, and
    /// the faces' parts of the whole.
    pub fn shown(&self) -> impl Iterator<Item = (usize, f32, &[(u32, Vec3)])> {
        self.slots.iter().map(|slot| {
            let share = f32::from(slot.faded_in) / f32::from(FADE);
            (slot.in_use, share, slot.taken.as_slice())
        })
    }
}

impl Slot {
    fn take(&mut self, source: &FaceSource, bake_from_world: Quat) {
        // In memory that is there: it happens with every picture.
        self.taken.clone_from(&source.irradiance_in_faces);
        let own = self.source.get_or_insert_default();
        own.id = source.id;
        own.angular_radius = source.angular_radius;
        own.direction = bake_from_world * source.direction;
        own.spread.clear();
        let turned = source
            .spread
            .iter()
            .map(|(d, share)| (bake_from_world * *d, *share));
        own.spread.extend(turned);
    }

    /// Of all that it takes from faces; 0 without a source.
    fn strength(&self) -> f32 {
        let sum = self.taken.iter().map(|(_, s)| s.element_sum()).sum();
        if self.source.is_some() { sum } else { 0.0 }
    }

    /// How far the images in use are from a direction, radians.
    fn off(&self, direction: Vec3) -> f32 {
        self.made[self.in_use].map_or(f32::INFINITY, |made| {
            made.direction.angle_between(direction)
        })
    }

    /// How much new images are wanted: more than 1 if at all.
    fn urgency(&self) -> Option<f32> {
        let source = self.source.as_ref()?;
        let Some(made) = self.made[self.in_use] else {
            return Some(f32::INFINITY);
        };
        let radius = source.angular_radius;
        let moved = self.off(source.direction) / STEP.max(STEP_OF_RADIUS * made.radius);
        let widened = (radius - made.radius).abs() / (STEP + STEP_OF_WIDTH * made.radius);
        let urgency = moved.max(widened);
        (urgency > 1.0).then_some(urgency)
    }

    fn wanted(&self, slot: usize) -> Option<Wanted> {
        let source = self.source.as_ref()?;
        let unused = self.made[self.in_use].is_none();
        Some(Wanted {
            slot,
            set: if unused { self.in_use } else { 1 - self.in_use },
            directions: directions(source),
            made: Some(Made {
                direction: source.direction,
                radius: source.angular_radius,
            }),
        })
    }

    fn fade(&mut self, at_once: bool) {
        let off = self.source.as_ref().map(|s| self.off(s.direction));
        self.lit = off.is_some_and(|off| off < NEAR || (self.lit && off < FAR));
        self.faded_in = match (self.lit, at_once) {
            (true, true) => FADE,
            (true, false) => (self.faded_in + 1).min(FADE),
            (false, true) => 0,
            (false, false) => self.faded_in.saturating_sub(1),
        };
    }
}

/// Directions over a source and their shares: those of its lights, in groups where they are
/// many, each spread over its part of the width where they are few.
fn directions(source: &FaceSource) -> Vec<(Vec3, f32)> {
    let size = source.spread.len().div_ceil(MOST_DIRECTIONS).max(1);
    let group = |parts: &[(Vec3, f32)]| {
        let share: f32 = parts.iter().map(|(_, share)| share).sum();
        let middle: Vec3 = parts.iter().map(|(d, share)| *d * *share).sum();
        middle.try_normalize().map(|middle| (middle, share))
    };
    let mut groups: Vec<_> = source.spread.chunks(size).filter_map(group).collect();
    let total: f32 = groups.iter().map(|(_, share)| share).sum();
    if total <= 0.0 {
        groups = vec![(source.direction, 1.0)];
    } else {
        groups.iter_mut().for_each(|(_, share)| *share /= total);
    }
    let radius = source.angular_radius / (groups.len() as f32).sqrt();
    let wished = (radius / ONE_DIRECTION).powi(2).ceil().max(1.0) as usize;
    let each = wished.min(MOST_DIRECTIONS / groups.len()).max(1);
    let spread = |(middle, share): &(Vec3, f32)| {
        let share = *share / each as f32;
        disc(*middle, radius, each).map(move |d| (d, share))
    };
    groups.iter().flat_map(spread).collect()
}

/// Directions spread evenly over a small disc about its middle, along a golden spiral.
fn disc(middle: Vec3, radius: f32, count: usize) -> impl Iterator<Item = Vec3> {
    let (right, up) = middle.any_orthonormal_pair();
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let point = move |i: usize| {
        let out = ((i as f32 + 0.5) / count as f32).sqrt();
        Vec2::from_angle(golden * i as f32) * (radius.tan() * out)
    };
    // A few points of a spiral lie to one side of it.
    let off = (0..count).map(point).sum::<Vec2>() / count.max(1) as f32;
    (0..count).map(move |i| {
        let at = point(i) - off;
        (middle + right * at.x + up * at.y).normalize()
    })
}

#[cfg(test)]
mod tests;
