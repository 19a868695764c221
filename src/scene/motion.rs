//! Motions of parts and lamps: chains of transforms, some of which change over time.
//!
//! Time is the session's. Evaluating a motion allocates nothing, and equal times give bit-identical
//! results.

use glam::{DMat4, DQuat, DVec3, EulerRot};
use penumbra_numerics::smoothstep;
use std::sync::Arc;

/// Minimum scale as a share of the rest scale: a normal needs a surface.
const MIN_SCALE: f64 = 1e-6;

/// Interpolation between keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Easing {
    /// `"step"`: constant until the next key.
    Step,
    /// `"linear"`.
    Linear,
    /// `"smooth"`: smoothstep, as for lamps.
    #[default]
    Smooth,
    /// glTF's cubic spline; three values per key: in-tangent, value, out-tangent.
    #[serde(skip)]
    Cubic,
}

/// A value that can be interpolated.
pub trait Value: Copy {
    /// Interpolates linearly from `self` (t = 0) to `to` (t = 1).
    #[must_use]
    fn towards(self, to: Self, t: f64) -> Self;
    /// Returns the weighted sum of four values.
    fn blend(parts: [(Self, f64); 4]) -> Self;
}

impl Value for DVec3 {
    fn towards(self, to: Self, t: f64) -> Self {
        self.lerp(to, t)
    }

    fn blend(parts: [(Self, f64); 4]) -> Self {
        parts.into_iter().map(|(v, w)| v * w).sum()
    }
}

impl Value for DQuat {
    /// Along the shorter arc.
    fn towards(self, to: Self, t: f64) -> Self {
        self.slerp(to, t)
    }

    fn blend(parts: [(Self, f64); 4]) -> Self {
        let sum = parts.into_iter().fold(glam::DVec4::ZERO, |sum, (q, w)| {
            sum + glam::DVec4::from(q) * w
        });
        let unit = sum.try_normalize().unwrap_or(glam::DVec4::W);
        Self::from_vec4(unit)
    }
}

/// A value over time; constant before the first key and after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel<T> {
    seconds: Vec<f64>,
    values: Vec<T>,
    easing: Easing,
}

impl<T: Value> Channel<T> {
    /// Creates a channel. `seconds` must increase; `values` has one value per key, three for
    /// [`Easing::Cubic`]. `None` otherwise, or without keys.
    #[must_use]
    pub fn new(seconds: Vec<f64>, values: Vec<T>, easing: Easing) -> Option<Self> {
        let each = if easing == Easing::Cubic { 3 } else { 1 };
        let grow = seconds.is_sorted_by(|a, b| a < b) && seconds.iter().all(|s| s.is_finite());
        let fits = !seconds.is_empty() && values.len() == each * seconds.len();
        (grow && fits).then_some(Self {
            seconds,
            values,
            easing,
        })
    }

    /// Time of the last key, seconds.
    #[must_use]
    pub fn end(&self) -> f64 {
        self.seconds.last().copied().unwrap_or_default()
    }

    fn key(&self, k: usize) -> Option<T> {
        let at = if self.easing == Easing::Cubic {
            3 * k + 1
        } else {
            k
        };
        self.values.get(at).copied()
    }

    /// The value at `seconds`.
    fn at(&self, seconds: f64) -> Option<T> {
        let after = self.seconds.partition_point(|s| *s <= seconds);
        let Some(before) = after.checked_sub(1) else {
            return self.key(0);
        };
        let (Some(&from), Some(&to)) = (self.seconds.get(before), self.seconds.get(after)) else {
            return self.key(before);
        };
        let span = to - from;
        let t = (seconds - from) / span;
        let (a, b) = (self.key(before)?, self.key(after)?);
        Some(match self.easing {
            Easing::Step => a,
            Easing::Linear => a.towards(b, t),
            Easing::Smooth => a.towards(b, smoothstep(0.0, 1.0, t)),
            Easing::Cubic => {
                let out = *self.values.get(3 * before + 2)?;
                let into = *self.values.get(3 * after)?;
                hermite([a, out, b, into], t, span)
            }
        })
    }
}

/// ```text
/// glTF 2.0, appendix C.4, with h = span:
///   (2t³ − 3t² + 1) a + h (t³ − 2t² + t) out + (3t² − 2t³) b + h (t³ − t²) into
/// ```
fn hermite<T: Value>([a, out, b, into]: [T; 4], t: f64, span: f64) -> T {
    let (t2, t3) = (t * t, t * t * t);
    T::blend([
        (a, 2.0 * t3 - 3.0 * t2 + 1.0),
        (out, span * (t3 - 2.0 * t2 + t)),
        (b, 3.0 * t2 - 2.0 * t3),
        (into, span * (t3 - t2)),
    ])
}

/// A rotation over time.
#[derive(Clone, Debug, PartialEq)]
pub enum Turning {
    /// Yaw, pitch and roll about z, y and x, radians, interpolated separately, so that full turns are
    /// possible.
    Angles(Channel<DVec3>),
    /// Quaternions, along the shorter arc.
    Quaternions(Channel<DQuat>),
}

/// A transform T · R · S over time; components without a channel are constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Translation, rotation and scale without channels.
    pub rest: (DVec3, DQuat, DVec3),
    /// Translation, metres, in the parent's frame.
    pub position: Option<Channel<DVec3>>,
    /// Rotation.
    pub turning: Option<Turning>,
    /// Scale per axis.
    pub scale: Option<Channel<DVec3>>,
    /// Period, seconds; `None` if it does not repeat.
    pub repeat: Option<f64>,
}

impl Track {
    /// Creates a constant transform.
    #[must_use]
    pub const fn resting(position: DVec3, rotation: DQuat, scale: DVec3) -> Self {
        Self {
            rest: (position, rotation, scale),
            position: None,
            turning: None,
            scale: None,
            repeat: None,
        }
    }

    /// Time of the last key of all channels, seconds.
    #[must_use]
    pub fn end(&self) -> f64 {
        let turning = match &self.turning {
            Some(Turning::Angles(c)) => c.end(),
            Some(Turning::Quaternions(c)) => c.end(),
            None => 0.0,
        };
        let end = |c: &Option<Channel<DVec3>>| c.as_ref().map_or(0.0, Channel::end);
        end(&self.position).max(turning).max(end(&self.scale))
    }

    fn at(&self, seconds: f64) -> DMat4 {
        let seconds = match self.repeat {
            Some(repeat) if repeat > 0.0 => seconds.rem_euclid(repeat),
            _ => seconds,
        };
        let (position, rotation, scale) = self.rest;
        let value = |c: &Option<Channel<DVec3>>| c.as_ref().and_then(|c| c.at(seconds));
        let turned = self.turning.as_ref().and_then(|t| match t {
            Turning::Angles(c) => {
                let DVec3 { x, y, z } = c.at(seconds)?;
                Some(DQuat::from_euler(EulerRot::ZYX, x, y, z))
            }
            Turning::Quaternions(c) => c.at(seconds),
        });
        let size = value(&self.scale).unwrap_or(scale);
        let floor = scale.abs() * MIN_SCALE + f64::MIN_POSITIVE;
        DMat4::from_scale_rotation_translation(
            size.abs().max(floor).copysign(scale),
            turned.unwrap_or(rotation),
            value(&self.position).unwrap_or(position),
        )
    }
}

/// One link of a chain.
#[derive(Clone, Debug, PartialEq)]
enum Joint {
    Still(DMat4),
    Moving(Arc<Track>),
}

/// Where something is at any time: a chain of placements, the world's first.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motion {
    joints: Vec<Joint>,
}

impl Motion {
    /// Appends a constant transform to the chain.
    #[must_use]
    pub fn then(mut self, place: DMat4) -> Self {
        match self.joints.last_mut() {
            Some(Joint::Still(last)) => *last *= place,
            _ => self.joints.push(Joint::Still(place)),
        }
        self
    }

    /// Appends a moving transform.
    #[must_use]
    pub fn then_along(mut self, track: Arc<Track>) -> Self {
        self.joints.push(Joint::Moving(track));
        self
    }

    /// Appends another chain.
    #[must_use]
    pub fn then_all(self, other: &Self) -> Self {
        other.joints.iter().fold(self, |chain, joint| match joint {
            Joint::Still(place) => chain.then(*place),
            Joint::Moving(track) => chain.then_along(track.clone()),
        })
    }

    /// Whether any transform of the chain moves.
    #[must_use]
    pub fn moves(&self) -> bool {
        self.joints.iter().any(|j| matches!(j, Joint::Moving(_)))
    }

    /// Time of the last key of all tracks, seconds.
    #[must_use]
    pub fn end(&self) -> f64 {
        let ends = self.joints.iter().map(|joint| match joint {
            Joint::Still(_) => 0.0,
            Joint::Moving(track) => track.end(),
        });
        ends.fold(0.0, f64::max)
    }

    /// Transform from the frame at the chain's end to that at its start, `seconds` after the
    /// session's start.
    #[must_use]
    pub fn at(&self, seconds: f64) -> DMat4 {
        self.joints
            .iter()
            .fold(DMat4::IDENTITY, |place, joint| match joint {
                Joint::Still(next) => place * *next,
                Joint::Moving(track) => place * track.at(seconds),
            })
    }
}

/// Motion of one of [`crate::Scene::virtual_parts`] or [`crate::Scene::lamps`].
#[derive(Clone, Debug, PartialEq)]
pub struct Mover {
    /// Index of the part or lamp.
    pub index: usize,
    /// World from the part's frame; of a lamp, world from the frame of its keys.
    pub motion: Motion,
}

/// Motions of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Motions {
    /// Parts, in the order of their indices.
    pub parts: Vec<Mover>,
    /// Lamps on moving carriers, in the order of their indices.
    pub lamps: Vec<Mover>,
}

impl Motions {
    /// Whether no part moves.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.parts.is_empty()
    }
}

#[cfg(test)]
mod tests;
