//! Decides which compact sources have images of their own, and when these are baked again. It
//! counts frames instead of reading a clock, so that replays are reproducible.

use super::options::MAX_SOURCES;
use glam::{Quat, Vec2, Vec3};
use penumbra_lighting::geodesic::FaceSource;

/// Minimum movement of a source for which its images are baked again, radians (0.25°): it moves the
/// shadow of a point five metres above the ground by two centimetres.
const MIN_MOVEMENT: f32 = 0.004_36;
/// The same as a fraction of the source's radius: the penumbra hides smaller movements.
const MIN_MOVEMENT_OF_RADIUS: f32 = 0.125;
/// Minimum relative change of a source's radius for which its images are baked again.
const MIN_CHANGE_OF_RADIUS: f32 = 0.25;
/// Maximum deviation of images from the direction of their source at which they come into use,
/// radians (2°).
const MAX_DEVIATION_TO_START: f32 = 0.035;
/// Maximum deviation at which they stay in use, radians (11°): the centre of a face of the papers'
/// dome is as near, so that beyond it the faces serve the source as well.
const MAX_DEVIATION_TO_KEEP: f32 = 0.2;
/// Number of frames over which light moves between a source and its faces.
const FADE_FRAMES: u8 = 8;
/// Minimum ratio of the strengths of two sources for the stronger to replace the weaker in its
/// slot.
const MIN_REPLACEMENT_RATIO: f32 = 1.5;
/// Maximum number of directions from which a source's images are baked.
const MAX_DIRECTIONS: usize = 16;
/// Half angle of the part of a source that one direction represents, radians (0.5°), up to
/// [`MAX_DIRECTIONS`] directions.
const DIRECTION_HALF_ANGLE: f32 = 0.008_7;

/// The direction and radius of a source for which images were baked.
#[derive(Clone, Copy, Debug, PartialEq)]
struct BakedSource {
    direction: Vec3,
    radius: f32,
}

/// A source and its two sets of images: one in use, one for the next bake.
#[derive(Clone, Debug, Default)]
struct Slot {
    /// The source that the slot follows, in the frame of the bake.
    source: Option<FaceSource>,
    /// Irradiance that the source takes from faces; kept while it fades out.
    taken: Vec<(u32, Vec3)>,
    baked: [Option<BakedSource>; 2],
    in_use: usize,
    /// Whether the images are near enough to the source's direction to be used.
    is_lit: bool,
    /// Frames by which the source is faded in, at most [`FADE_FRAMES`].
    faded_in: u8,
}

/// A request for new images: their slot and set, and the source for which they are baked.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct BakeRequest {
    pub slot: usize,
    pub set: usize,
    /// Unit vectors in the frame of the bake, and shares, which add up to 1.
    pub directions: Vec<(Vec3, f32)>,
    source: Option<BakedSource>,
}

impl BakeRequest {
    /// Returns the mean direction: its scalar product with a surface's normal is the irradiance of
    /// a surface that no caster shadows. It is shorter than 1 for a wide source.
    pub fn mean(&self) -> Vec3 {
        self.directions.iter().map(|(d, share)| *d * *share).sum()
    }
}

/// The slots of all sources that may have images of their own.
#[derive(Clone, Debug, Default)]
pub(super) struct SourceSlots {
    slots: [Slot; MAX_SOURCES],
    has_started: bool,
    /// Rotates directions from the world to the frame of the bake.
    pub bake_from_world: Quat,
}

impl SourceSlots {
    /// Takes over the sources of this frame, strongest first. Returns true for the first frame with
    /// light: then nothing fades, and all images should be baked at once.
    pub fn follow(&mut self, sources: &[FaceSource]) -> bool {
        for slot in &mut self.slots {
            let known = slot.source.as_ref().map(|s| s.id);
            let found = sources.iter().find(|s| Some(s.id) == known);
            match found {
                Some(found) => slot.take(found, self.bake_from_world),
                None => slot.source = None,
            }
        }
        for source in sources.iter().take(MAX_SOURCES) {
            self.assign(source);
        }
        !std::mem::replace(&mut self.has_started, true)
    }

    /// Assigns a slot to a source that has none, if one is available.
    fn assign(&mut self, source: &FaceSource) {
        let is = |slot: &&Slot| slot.source.as_ref().is_some_and(|s| s.id == source.id);
        if self.slots.iter().any(|slot| is(&slot)) {
            return;
        }
        let rotation = self.bake_from_world;
        let direction = rotation * source.direction;
        // A source that was lost and found again gets its old slot.
        let deviation = |slot: &Slot| slot.deviation(direction);
        let free = self.slots.iter_mut().filter(|slot| slot.source.is_none());
        let nearest = free.min_by(|a, b| deviation(a).total_cmp(&deviation(b)));
        if let Some(slot) = nearest {
            if slot.faded_in == 0 || slot.deviation(direction) < MAX_DEVIATION_TO_START {
                slot.take(source, rotation);
            }
            return;
        }
        let strength = source.irradiance().element_sum();
        let slots = self.slots.iter_mut();
        let weakest = slots.min_by(|a, b| a.strength().total_cmp(&b.strength()));
        // The weaker source fades out before its slot is assigned again.
        if let Some(slot) =
            weakest.filter(|slot| strength > MIN_REPLACEMENT_RATIO * slot.strength())
        {
            slot.source = None;
        }
    }

    /// The most urgent request for images.
    pub fn request(&self) -> Option<BakeRequest> {
        let rows = self.slots.iter().enumerate();
        let urgencies = rows.filter_map(|(i, slot)| Some((i, slot.urgency()?)));
        let (slot, _) = urgencies.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
        self.slots[slot].request(slot)
    }

    /// Puts the images of a finished request into use.
    pub fn finish(&mut self, request: &BakeRequest) {
        if let Some(slot) = self.slots.get_mut(request.slot) {
            slot.baked[request.set] = request.source;
            slot.in_use = request.set;
        }
    }

    /// Moves one frame's share of the light between sources and their faces; with `at_once`, all of
    /// it.
    pub fn fade(&mut self, at_once: bool) {
        for slot in &mut self.slots {
            slot.fade(at_once);
        }
    }

    /// For each slot, the set in use, the share of the source's light that it has taken, and the
    /// source's irradiance by face.
    pub fn in_use(&self) -> impl Iterator<Item = (usize, f32, &[(u32, Vec3)])> {
        self.slots.iter().map(|slot| {
            let share = f32::from(slot.faded_in) / f32::from(FADE_FRAMES);
            (slot.in_use, share, slot.taken.as_slice())
        })
    }
}

impl Slot {
    /// Follows `source`, whose direction is rotated into the frame of the bake.
    fn take(&mut self, source: &FaceSource, bake_from_world: Quat) {
        // Runs in every frame: reuse the memory.
        self.taken.clone_from(&source.irradiance_in_faces);
        let own = self.source.get_or_insert_default();
        own.id = source.id;
        own.angular_radius = source.angular_radius;
        own.direction = bake_from_world * source.direction;
        own.spread.clear();
        let rotated = source
            .spread
            .iter()
            .map(|(d, share)| (bake_from_world * *d, *share));
        own.spread.extend(rotated);
    }

    /// Sum of the irradiance that the source takes from faces; 0 without a source.
    fn strength(&self) -> f32 {
        let sum = self.taken.iter().map(|(_, s)| s.element_sum()).sum();
        if self.source.is_some() { sum } else { 0.0 }
    }

    /// Angle between a direction and that of the images in use, radians; infinite without images.
    fn deviation(&self, direction: Vec3) -> f32 {
        self.baked[self.in_use].map_or(f32::INFINITY, |baked| {
            baked.direction.angle_between(direction)
        })
    }

    /// Urgency of new images, greater than 1; `None` if none are needed.
    fn urgency(&self) -> Option<f32> {
        let source = self.source.as_ref()?;
        let Some(baked) = self.baked[self.in_use] else {
            return Some(f32::INFINITY);
        };
        let radius = source.angular_radius;
        let moved = self.deviation(source.direction)
            / MIN_MOVEMENT.max(MIN_MOVEMENT_OF_RADIUS * baked.radius);
        let widened =
            (radius - baked.radius).abs() / (MIN_MOVEMENT + MIN_CHANGE_OF_RADIUS * baked.radius);
        let urgency = moved.max(widened);
        (urgency > 1.0).then_some(urgency)
    }

    fn request(&self, slot: usize) -> Option<BakeRequest> {
        let source = self.source.as_ref()?;
        let is_free = self.baked[self.in_use].is_none();
        Some(BakeRequest {
            slot,
            set: if is_free {
                self.in_use
            } else {
                1 - self.in_use
            },
            directions: directions(source),
            source: Some(BakedSource {
                direction: source.direction,
                radius: source.angular_radius,
            }),
        })
    }

    fn fade(&mut self, at_once: bool) {
        let deviation = self.source.as_ref().map(|s| self.deviation(s.direction));
        self.is_lit = deviation.is_some_and(|angle| {
            angle < MAX_DEVIATION_TO_START || (self.is_lit && angle < MAX_DEVIATION_TO_KEEP)
        });
        self.faded_in = match (self.is_lit, at_once) {
            (true, true) => FADE_FRAMES,
            (true, false) => (self.faded_in + 1).min(FADE_FRAMES),
            (false, true) => 0,
            (false, false) => self.faded_in.saturating_sub(1),
        };
    }
}

/// Returns directions over a source and their shares: the directions of its lights, in groups if
/// they are many, and several per light, over its part of the source's width, if they are few.
fn directions(source: &FaceSource) -> Vec<(Vec3, f32)> {
    let size = source.spread.len().div_ceil(MAX_DIRECTIONS).max(1);
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
    let needed = (radius / DIRECTION_HALF_ANGLE).powi(2).ceil().max(1.0) as usize;
    let each = needed.min(MAX_DIRECTIONS / groups.len()).max(1);
    let spread = |(middle, share): &(Vec3, f32)| {
        let share = *share / each as f32;
        disc(*middle, radius, each).map(move |d| (d, share))
    };
    groups.iter().flat_map(spread).collect()
}

/// Directions spread evenly over a small disc about its centre, along a golden spiral.
fn disc(middle: Vec3, radius: f32, count: usize) -> impl Iterator<Item = Vec3> {
    let (right, up) = middle.any_orthonormal_pair();
    let golden = std::f32::consts::PI * (3.0 - 5.0_f32.sqrt());
    let point = move |i: usize| {
        let out = ((i as f32 + 0.5) / count as f32).sqrt();
        Vec2::from_angle(golden * i as f32) * (radius.tan() * out)
    };
    // The mean of a few points of a spiral is not its centre.
    let mean = (0..count).map(point).sum::<Vec2>() / count.max(1) as f32;
    (0..count).map(move |i| {
        let at = point(i) - mean;
        (middle + right * at.x + up * at.y).normalize()
    })
}

#[cfg(test)]
mod tests;
