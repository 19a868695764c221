//! Animations of glTF files: translation, rotation and scale of nodes, with step, linear or cubic
//! spline interpolation (section 3.11 and appendix C). Weights of morph targets are ignored.

use super::gltf_bytes::{Fault, Source};
use super::motion::{Channel, Easing, Motion, Track, Turning};
use glam::{DMat4, DQuat, DVec3, Mat4};
use gltf::accessor::Dimensions;
use gltf::animation::{Interpolation, Property};
use gltf::json::validation::Checked;
use std::collections::HashMap;
use std::sync::Arc;

/// Rotation from glTF's +Y-up to Penumbra's +Z-up frame: (x, y, z) to (x, −z, y).
#[must_use]
pub fn z_up_from_y_up() -> DMat4 {
    DMat4::from_cols_array_2d(&[
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ])
}

/// Selection of a model's animation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Playing<'a> {
    /// None: rest pose.
    #[default]
    Nothing,
    /// The file's first animation.
    First,
    /// The animation of this name.
    Named(&'a str),
}

/// Node hierarchy of a document and the tracks of its moving nodes.
pub(super) struct Skeleton {
    parents: Vec<Option<usize>>,
    locals: Vec<DMat4>,
    tracks: HashMap<usize, Arc<Track>>,
    /// Whether the selected animation exists.
    pub found: bool,
}

/// Returns the names of all animations; unnamed ones have their index as name.
pub(super) fn names(document: &gltf::Document) -> Vec<String> {
    let named = document.animations().enumerate();
    named
        .map(|(i, a)| a.name().map_or_else(|| i.to_string(), str::to_owned))
        .collect()
}

impl Skeleton {
    pub(super) fn read(source: &Source, playing: Playing<'_>, file: &str) -> Result<Self, Fault> {
        let document = &source.document;
        let mut parents = vec![None; document.nodes().len()];
        for node in document.nodes() {
            for child in node.children() {
                if let Some(parent) = parents.get_mut(child.index()) {
                    *parent = Some(node.index());
                }
            }
        }
        let local = |n: gltf::Node| Mat4::from_cols_array_2d(&n.transform().matrix()).as_dmat4();
        let mut animations = document.animations().zip(names(document));
        let animation = match playing {
            Playing::Nothing => None,
            Playing::First => animations.next(),
            Playing::Named(wanted) => animations.find(|(_, name)| name == wanted),
        };
        let tracks = animation.as_ref().map(|(a, name)| {
            tracks(source, a.index(), file).map_err(|e| format!("animation `{name}`: {e}"))
        });
        Ok(Self {
            parents,
            locals: document.nodes().map(local).collect(),
            found: playing == Playing::Nothing || animation.is_some(),
            tracks: tracks.transpose()?.unwrap_or_default(),
        })
    }

    /// Returns the motion of a node in its model (+Z up); `None` if it does not move.
    pub(super) fn motion(&self, node: usize) -> Option<Motion> {
        let mut path = vec![node];
        while let Some(parent) = path
            .last()
            .and_then(|n| self.parents.get(*n).copied().flatten())
            && path.len() <= self.parents.len()
        {
            path.push(parent);
        }
        let z_up = z_up_from_y_up();
        let root = Motion::default().then(z_up);
        let chain = path.iter().rev().fold(root, |chain, n| {
            match (self.tracks.get(n), self.locals.get(*n)) {
                (Some(track), _) => chain.then_along(track.clone()),
                (None, local) => chain.then(local.copied().unwrap_or(DMat4::IDENTITY)),
            }
        });
        let chain = chain.then(z_up.transpose());
        chain.moves().then_some(chain)
    }
}

/// Reads the tracks of all nodes that animation `index` moves, in glTF's frame. They repeat after
/// the last key.
fn tracks(source: &Source, index: usize, file: &str) -> Result<HashMap<usize, Arc<Track>>, Fault> {
    let document = &source.document;
    check_indices(document, index)?;
    let mut tracks: HashMap<usize, Track> = HashMap::new();
    let channels = document.animations().nth(index);
    for channel in channels.iter().flat_map(gltf::Animation::channels) {
        let (node, sampler) = (channel.target().node(), channel.sampler());
        let label = node
            .name()
            .map_or_else(|| node.index().to_string(), str::to_owned);
        let wrong = |e: Fault| format!("node `{label}`: {e}");
        let track = tracks.entry(node.index()).or_insert_with(|| at_rest(&node));
        let read = Keys::read(source, &sampler);
        match channel.target().property() {
            Property::Translation => {
                let keys = read.and_then(|k| k.positions(source, &sampler.output()));
                track.position = Some(keys.map_err(wrong)?);
            }
            Property::Rotation => {
                let keys = read.and_then(|k| k.rotations(source, &sampler.output()));
                track.turning = Some(Turning::Quaternions(keys.map_err(wrong)?));
            }
            Property::Scale => {
                let keys = read.and_then(|k| k.scales(source, &sampler.output()));
                let (channel, first) = keys.map_err(wrong)?;
                (track.scale, track.rest.2) = (Some(channel), first);
            }
            Property::MorphTargetWeights => {
                tracing::warn!(file, node = label, "weights of morph targets are ignored");
            }
        }
    }
    let length = tracks.values().map(Track::end).fold(0.0, f64::max);
    let repeating = |(node, mut track): (usize, Track)| {
        track.repeat = (length > 0.0).then_some(length);
        (node, Arc::new(track))
    };
    Ok(tracks.into_iter().map(repeating).collect())
}

fn at_rest(node: &gltf::Node) -> Track {
    let (t, r, s) = node.transform().decomposed();
    let vector = |v: [f32; 3]| DVec3::from(v.map(f64::from));
    let rotation = DQuat::from_array(r.map(f64::from));
    let rotation = if rotation.length() > 0.5 && rotation.is_finite() {
        rotation.normalize()
    } else {
        DQuat::IDENTITY
    };
    Track::resting(vector(t), rotation, vector(s))
}

/// Checks indices and paths: the look-ups of the `gltf` crate rely on them without checks.
fn check_indices(document: &gltf::Document, index: usize) -> Result<(), Fault> {
    let root = document.as_json();
    let animation = root.animations.get(index).ok_or("it does not exist")?;
    let channels = animation.channels.iter().all(|c| {
        c.sampler.value() < animation.samplers.len() && c.target.node.value() < root.nodes.len()
    });
    let accessors = |s: &gltf::json::animation::Sampler| {
        s.input.value() < root.accessors.len() && s.output.value() < root.accessors.len()
    };
    if !channels || !animation.samplers.iter().all(accessors) {
        return Err("it refers to a missing node, sampler or accessor; export it again".into());
    }
    let mut paths = animation.channels.iter().map(|c| &c.target.path);
    if paths.any(|path| *path == Checked::Invalid) {
        return Err("its path is unknown; export it again".into());
    }
    Ok(())
}

/// Times and interpolation of a sampler.
struct Keys {
    seconds: Vec<f64>,
    easing: Easing,
}

impl Keys {
    fn read(source: &Source, sampler: &gltf::animation::Sampler<'_>) -> Result<Self, Fault> {
        let input = source.floats::<1>(&sampler.input(), Dimensions::Scalar)?;
        let seconds: Vec<f64> = input.into_iter().map(|[s]| f64::from(s)).collect();
        let grow = seconds.is_sorted_by(|a, b| a < b) && !seconds.is_empty();
        if !grow || !seconds.iter().all(|s| (0.0..=1e6).contains(s)) {
            return Err("the times of its keys do not increase from 0; export it again".into());
        }
        Ok(Self {
            seconds,
            easing: match sampler.interpolation() {
                Interpolation::Step => Easing::Step,
                Interpolation::Linear => Easing::Linear,
                Interpolation::CubicSpline => Easing::Cubic,
            },
        })
    }

    fn channel<T: super::motion::Value>(self, values: Vec<T>) -> Result<Channel<T>, Fault> {
        let wrong = || "it has more or fewer values than keys; export it again".to_owned();
        Channel::new(self.seconds, values, self.easing).ok_or_else(wrong)
    }

    /// Returns the values of the keys, without tangents.
    fn key_values<'v, T>(&self, values: &'v [T]) -> impl Iterator<Item = &'v T> + use<'v, T> {
        let (skip, step) = if self.easing == Easing::Cubic {
            (1, 3)
        } else {
            (0, 1)
        };
        values.iter().skip(skip).step_by(step)
    }

    fn positions(self, source: &Source, output: &gltf::Accessor) -> Result<Channel<DVec3>, Fault> {
        let values = vectors(source, output)?;
        self.channel(values)
    }

    fn rotations(self, source: &Source, output: &gltf::Accessor) -> Result<Channel<DQuat>, Fault> {
        let values = source.floats::<4>(output, Dimensions::Vec4)?;
        let mut rotations: Vec<DQuat> = values
            .into_iter()
            .map(|q| DQuat::from_array(q.map(f64::from)))
            .collect();
        let usable = |q: &DQuat| q.is_finite() && q.length() > 0.5;
        if !rotations.iter().all(|q| q.is_finite()) || !self.key_values(&rotations).all(usable) {
            return Err("a rotation that is no unit quaternion; export it again".into());
        }
        if self.easing != Easing::Cubic {
            rotations.iter_mut().for_each(|q| *q = q.normalize());
        }
        self.channel(rotations)
    }

    /// Reads scales; returns the first key's scale too.
    fn scales(
        self,
        source: &Source,
        output: &gltf::Accessor,
    ) -> Result<(Channel<DVec3>, DVec3), Fault> {
        let values = vectors(source, output)?;
        let first = self
            .key_values(&values)
            .next()
            .copied()
            .unwrap_or(DVec3::ONE);
        let has_same_signs = |v: &DVec3| (*v * first).min_element() > 0.0;
        if !self.key_values(&values).all(has_same_signs) {
            return Err(
                "its scale becomes zero or changes sign; keep it above 0 and hide the node \
                 in another way"
                    .into(),
            );
        }
        Ok((self.channel(values)?, first))
    }
}

fn vectors(source: &Source, output: &gltf::Accessor) -> Result<Vec<DVec3>, Fault> {
    let values = source.floats::<3>(output, Dimensions::Vec3)?;
    let values: Vec<DVec3> = values
        .into_iter()
        .map(|v| DVec3::from(v.map(f64::from)))
        .collect();
    if values.iter().all(|v| v.is_finite()) {
        return Ok(values);
    }
    Err("a value that is not finite; export it again".into())
}
