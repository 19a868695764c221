//! `[planes]`: shadowing planes and their bake (Kakuta et al. 2004, 2007).

use super::range::{Result, set, whole, within};
use penumbra_scene::PlaneShading;
use penumbra_scene::planes::{BakeSettings, Receiver};
use penumbra_strict_toml::Fault;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Supported frequencies of the geodesic dome; at odd ones the horizon would cut through faces.
pub const FREQUENCIES: [u32; 4] = [2, 4, 6, 8];

/// Returns the number of lights of a dome of `frequency` on the upper hemisphere: half of the
/// 20 · frequency² triangles of a subdivided icosahedron.
#[must_use]
pub const fn lights_of_dome(frequency: u32) -> u32 {
    10 * frequency * frequency
}

/// Where shadows on virtual objects are received.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Deserialize,
    serde::Serialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum PlaneReceiver {
    /// `"surface"`: the first surface behind the plane.
    #[default]
    Surface,
    /// `"plane"`: the plane itself (Kakuta 2004, 2007).
    Plane,
}

impl From<PlaneReceiver> for Receiver {
    fn from(receiver: PlaneReceiver) -> Self {
        match receiver {
            PlaneReceiver::Surface => Self::Surface,
            PlaneReceiver::Plane => Self::Plane,
        }
    }
}

/// `[planes]`, used when `shadows.technique` is `"shadowing-planes"`.
#[derive(Clone, Debug, PartialEq)]
pub struct PlanesConfig {
    /// Maximum number of planes, including those on the ground and on phantoms.
    pub count: u32,
    /// Maximum number of parts that a complex model is divided into.
    pub clusters: u32,
    /// Texels along a side of a basis image, a multiple of 4.
    pub resolution: u32,
    /// Frequency of the geodesic dome, one of [`FREQUENCIES`].
    pub frequency: u32,
    /// Directions per face of the dome.
    pub samples: u32,
    /// Distance of planes from the surfaces that they cover, metres.
    pub offset: f64,
    /// Where shadows on virtual objects are received.
    pub receiver: PlaneReceiver,
    /// Whether the brightest compact sources cast shadows from their true directions instead of the
    /// centres of faces.
    pub sources: bool,
    /// Lights that contribute less than this share of all light are skipped.
    pub skip_below: f32,
    /// A light is summed again when it changes by more than this share of all light.
    pub recompute_above: f32,
    /// Shading of virtual objects.
    pub shading: PlaneShading,
    /// Folder for bakes; the system's cache folder if `None`.
    pub cache: Option<PathBuf>,
}

impl Default for PlanesConfig {
    fn default() -> Self {
        let bake = BakeSettings::default();
        Self {
            count: 38,
            clusters: 6,
            resolution: bake.resolution,
            frequency: bake.frequency,
            samples: bake.samples,
            offset: 0.02,
            receiver: PlaneReceiver::Surface,
            sources: true,
            skip_below: 0.002,
            recompute_above: 0.01,
            shading: PlaneShading::Irradiance,
            cache: None,
        }
    }
}

impl PlanesConfig {
    /// Returns the settings of the bake.
    #[must_use]
    pub const fn bake_settings(&self) -> BakeSettings {
        BakeSettings {
            resolution: self.resolution,
            frequency: self.frequency,
            samples: self.samples,
        }
    }
}

/// The section of the file.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PlanesFile {
    count: Option<u32>,
    clusters: Option<u32>,
    resolution: Option<u32>,
    frequency: Option<u32>,
    samples: Option<u32>,
    offset_m: Option<f64>,
    receiver: Option<PlaneReceiver>,
    sources: Option<bool>,
    skip_below: Option<f64>,
    recompute_above: Option<f64>,
    shading: Option<PlaneShading>,
    cache: Option<String>,
}

pub(super) fn planes(file: PlanesFile, folder: &Path, out: &mut PlanesConfig) -> Result<()> {
    set(&mut out.count, whole("planes.count", file.count, 2..=256)?);
    let clusters = whole("planes.clusters", file.clusters, 1..=64)?;
    set(&mut out.clusters, clusters);
    set(&mut out.resolution, resolution(file.resolution)?);
    set(&mut out.frequency, frequency(file.frequency)?);
    set(&mut out.samples, samples(file.samples)?);
    let offset = within("planes.offset_m", file.offset_m, 0.0..=10.0)?;
    set(&mut out.offset, offset);
    set(&mut out.receiver, file.receiver);
    set(&mut out.sources, file.sources);
    let skip = within("planes.skip_below", file.skip_below, 0.0..=1.0)?;
    set(&mut out.skip_below, skip.map(|share| share as f32));
    let recompute = within("planes.recompute_above", file.recompute_above, 0.0..=1.0)?;
    set(
        &mut out.recompute_above,
        recompute.map(|share| share as f32),
    );
    set(&mut out.shading, file.shading);
    out.cache = file.cache.map(|path| folder.join(path));
    Ok(())
}

fn resolution(value: Option<u32>) -> Result<Option<u32>> {
    match value {
        Some(v) if !(v.is_multiple_of(4) && (16..=512).contains(&v)) => Err(Fault::new(
            "planes.resolution",
            format!("expected a multiple of 4 from 16 to 512, found {v}"),
        )),
        value => Ok(value),
    }
}

/// Checks the number of directions per face: a face is subdivided into a square number of triangles.
fn samples(value: Option<u32>) -> Result<Option<u32>> {
    match value {
        Some(v) if !((1..=64).contains(&v) && v.isqrt().pow(2) == v) => Err(Fault::new(
            "planes.samples",
            format!("expected a square number from 1 to 64, found {v}"),
        )),
        value => Ok(value),
    }
}

fn frequency(value: Option<u32>) -> Result<Option<u32>> {
    match value {
        Some(v) if !FREQUENCIES.contains(&v) => Err(Fault::new(
            "planes.frequency",
            format!("expected one of {FREQUENCIES:?}, found {v}"),
        )),
        value => Ok(value),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_geodesic_domes_have_the_light_counts_of_the_paper() {
        assert_eq!(FREQUENCIES.map(lights_of_dome), [40, 160, 360, 640]);
    }
}
