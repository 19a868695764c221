//! Motions of a scene file's objects: keys, and animations of models.

use super::Entry;
use super::typed::{AnimationFile, ObjectKeyFile, Place};
use crate::gltf_file::Playing;
use crate::motion::Motion;
use crate::motion::{Channel, Easing, Track, Turning};
use glam::{DMat4, DQuat, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_strict_toml::Fault;
use std::sync::Arc;

/// Maximum number of keys of an object.
const MAX_KEYS: usize = 1000;

/// World from the frame of lamps that are attached to an object with the motion `world`: the object's
/// pose if it does not move; else the identity, as its motion is applied to the lamps later.
pub(super) fn lamp_frame(world: &Motion) -> DMat4 {
    if world.moves() {
        DMat4::IDENTITY
    } else {
        world.at(0.0)
    }
}

impl Entry {
    /// Returns the selected animation of its model.
    pub(super) fn playing(&self, at: &str) -> Result<Playing<'_>, Fault> {
        let playing = match &self.animation {
            None | Some(AnimationFile::Plays(false)) => return Ok(Playing::Nothing),
            Some(AnimationFile::Plays(true)) => Playing::First,
            Some(AnimationFile::Named(name)) => Playing::Named(name),
        };
        let file = self.file.as_deref().unwrap_or_default();
        if [".glb", ".gltf"].iter().any(|end| has_extension(file, end)) {
            return Ok(playing);
        }
        Err(Fault::new(
            format!("{at}.animation"),
            "goes with a `file` that is a .glb or .gltf; use `keys` to move other objects",
        ))
    }

    /// Returns its motion: world from its own frame, with scale.
    pub(super) fn motion(&self, at: &str, world_from_model: DMat4) -> Result<Motion, Fault> {
        let RigidTransform {
            rotation,
            translation,
        } = self.place().placement(at)?;
        let scale = self.scale.map_or(DVec3::ONE, |s| s.0);
        let base = Motion::default().then(world_from_model);
        let track = self.track(at, Track::resting(translation, rotation, scale))?;
        Ok(match track {
            Some(track) => base.then_along(Arc::new(track)),
            None => base.then(DMat4::from_scale_rotation_translation(
                scale,
                rotation,
                translation,
            )),
        })
    }

    /// Converts its keys to a track; `None` without keys.
    fn track(&self, at: &str, rest: Track) -> Result<Option<Track>, Fault> {
        let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
        if self.keys.is_empty() {
            let alone = [
                ("repeat_s", self.repeat_s.is_some()),
                ("easing", self.easing.is_some()),
            ];
            return match alone.into_iter().find(|(_, given)| *given) {
                Some((key, _)) => Err(wrong(key, "goes with `keys`")),
                None => Ok(None),
            };
        }
        if self.keys.len() > MAX_KEYS {
            let reason = format!("expected at most {MAX_KEYS} keys");
            return Err(wrong("keys", &reason));
        }
        let seconds = self.seconds(at)?;
        let easing = self.easing.unwrap_or_default();
        let numbered = || (0..).map(|i| format!("{at}.keys[{i}]")).zip(&self.keys);
        let poses: Vec<RigidTransform> = numbered()
            .map(|(at, key)| self.key_place(key).placement(&at))
            .collect::<Result<_, _>>()?;
        let moves = self.keys.iter().any(|k| k.position_m.is_some());
        let turns = self
            .keys
            .iter()
            .any(|k| k.rotation_deg.is_some() || k.rotation_wxyz.is_some());
        let scales = self.keys.iter().any(|k| k.scale.is_some());
        let positions = poses.iter().map(|p| p.translation).collect();
        let sizes = self
            .keys
            .iter()
            .map(|k| k.scale.map_or(rest.rest.2, |s| s.0));
        let scale = Channel::new(seconds.clone(), sizes.collect(), easing).filter(|_| scales);
        Ok(Some(Track {
            position: Channel::new(seconds.clone(), positions, easing).filter(|_| moves),
            turning: match turns {
                true => self.turning(at, &seconds, &poses, easing)?,
                false => None,
            },
            scale,
            repeat: self.repeat(at, seconds.last().copied().unwrap_or_default())?,
            ..rest
        }))
    }

    fn seconds(&self, at: &str) -> Result<Vec<f64>, Fault> {
        for (i, key) in self.keys.iter().enumerate() {
            let wrong = |reason: &str| Err(Fault::new(format!("{at}.keys[{i}].at_s"), reason));
            if !(0.0..=1e6).contains(&key.at_s) {
                return wrong("expected seconds from 0 to 1000000");
            }
            let before = i.checked_sub(1).and_then(|k| self.keys.get(k));
            if before.is_some_and(|before| before.at_s >= key.at_s) {
                return wrong(
                    "expected more than the key before it: at_s increases from key to key",
                );
            }
        }
        Ok(self.keys.iter().map(|k| k.at_s).collect())
    }

    fn repeat(&self, at: &str, last: f64) -> Result<Option<f64>, Fault> {
        match self.repeat_s {
            Some(s) if !(s.is_finite() && s > 0.0 && s >= last) => Err(Fault::new(
                format!("{at}.repeat_s"),
                "expected seconds, not before the last key",
            )),
            repeat => Ok(repeat),
        }
    }

    /// Interpolates angles separately, or quaternions along the shorter arc.
    fn turning(
        &self,
        at: &str,
        seconds: &[f64],
        poses: &[RigidTransform],
        easing: Easing,
    ) -> Result<Option<Turning>, Fault> {
        let each = self.keys.iter().map(|k| self.key_place(k));
        let by_quaternion: Vec<bool> = each.clone().map(|p| p.rotation_wxyz.is_some()).collect();
        if by_quaternion.iter().all(|q| *q) {
            let rotations: Vec<DQuat> = poses.iter().map(|p| p.rotation).collect();
            let channel = Channel::new(seconds.to_vec(), rotations, easing);
            return Ok(channel.map(Turning::Quaternions));
        }
        if let Some(i) = by_quaternion.iter().position(|q| *q) {
            return Err(Fault::new(
                format!("{at}.keys[{i}].rotation_wxyz"),
                "either all keys have rotation_wxyz or all have rotation_deg",
            ));
        }
        let angles = each.map(|p| DVec3::from(p.rotation_deg.unwrap_or_default()) * RADIANS);
        let channel = Channel::new(seconds.to_vec(), angles.collect(), easing);
        Ok(channel.map(Turning::Angles))
    }

    /// Pose of a key; its missing values are those of the object.
    fn key_place(&self, key: &ObjectKeyFile) -> Place {
        let own = key.rotation_deg.is_some() || key.rotation_wxyz.is_some();
        Place {
            position_m: key.position_m.or(self.position_m),
            rotation_deg: key.rotation_deg.or(self.rotation_deg.filter(|_| !own)),
            rotation_wxyz: key.rotation_wxyz.or(self.rotation_wxyz.filter(|_| !own)),
        }
    }

    /// Pose of the object.
    const fn place(&self) -> Place {
        Place {
            position_m: self.position_m,
            rotation_deg: self.rotation_deg,
            rotation_wxyz: self.rotation_wxyz,
        }
    }

    /// Returns the first key that makes it move; phantoms must not have one.
    pub(super) const fn moving_key(&self) -> Option<&'static str> {
        if !self.keys.is_empty() {
            Some("keys")
        } else if self.repeat_s.is_some() {
            Some("repeat_s")
        } else if self.easing.is_some() {
            Some("easing")
        } else if self.animation.is_some() {
            Some("animation")
        } else {
            None
        }
    }
}

const RADIANS: f64 = std::f64::consts::PI / 180.0;

fn has_extension(file: &str, end: &str) -> bool {
    let tail = file
        .len()
        .checked_sub(end.len())
        .and_then(|at| file.get(at..));
    tail.is_some_and(|tail| tail.eq_ignore_ascii_case(end))
}
