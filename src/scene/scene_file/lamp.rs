//! Lamps of a scene file.

use super::area;
use super::typed::{Colour, LampFile, LampKeyFile, LampKind, Photometry};
use crate::mesh::SceneTexture;
use crate::photometric::{black_body, normalise_luminance, white_of_ev100};
use crate::virtual_light::{VirtualLight, VirtualLightKey, VirtualLightKind};
use glam::{DMat4, DVec3, Vec3};
use penumbra_strict_toml::Fault;
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Maximum number of keys of a lamp.
const MAX_KEYS: usize = 1000;
/// Maximum coordinate, metres.
const MAX_COORDINATE: f64 = 1e5;
/// Maximum brightness, candela, lumen or cd/m².
const MAX_BRIGHTNESS: f64 = 1e9;

/// Data on which the poses and intensities of lamps depend.
pub(super) struct Surroundings<'a> {
    /// Poses of objects by name: world from their own frame.
    pub objects: &'a HashMap<String, DMat4>,
    /// Luminance of the scene camera's white, cd/m².
    pub white: Option<f64>,
    /// Folder of textures.
    pub folder: &'a Path,
}

/// Luminance of the scene camera's white, cd/m², if the file has it.
pub(super) fn white(file: Option<&Photometry>) -> Result<Option<f64>, Fault> {
    let Some(file) = file else {
        return Ok(None);
    };
    let wrong = |key: &str, reason: &str| Err(Fault::new(format!("photometry.{key}"), reason));
    match (file.white_cd_m2, file.ev100) {
        (Some(_), Some(_)) => wrong("ev100", "goes without white_cd_m2; leave one out"),
        (Some(white), None) if !(1e-3..=1e9).contains(&white) => {
            wrong("white_cd_m2", "expected cd/m² from 0.001 to 1e9")
        }
        (None, Some(ev)) if !(-10.0..=30.0).contains(&ev) => {
            wrong("ev100", "expected an exposure value at ISO 100, -10 to 30")
        }
        (white, ev) => Ok(white.or(ev.map(white_of_ev100))),
    }
}

/// The error of a model with lamps in a file without the luminance of the camera's white.
pub(super) fn without_white(at: &str) -> Fault {
    Fault::new(
        format!("{at}.file"),
        "its lamps are in candela: give the luminance of the camera's white, `white_cd_m2` or `ev100` under [photometry]",
    )
}

pub(super) fn lamp(
    file: &LampFile,
    at: &str,
    surroundings: &Surroundings<'_>,
) -> Result<VirtualLight, Fault> {
    let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
    let world_from_lamp = match &file.attached_to {
        None => DMat4::IDENTITY,
        Some(name) => *surroundings.objects.get(name).ok_or_else(|| {
            wrong(
                "attached_to",
                &format!("there is no [[object]] named \"{name}\""),
            )
        })?,
    };
    let keys = keys(file, at, world_from_lamp)?;
    let kind = kind(file, at, &keys, world_from_lamp)?;
    let screen = area::screen(file, at, kind, surroundings.folder)?;
    let picture = screen.as_ref().and_then(|s| s.texture.as_deref());
    Ok(VirtualLight {
        name: file.name.clone().unwrap_or_else(|| "lamp".to_owned()),
        intensity: intensity(file, at, (kind, picture), surroundings.white)?,
        kind,
        screen,
        repeat: repeat(file, at, &keys)?,
        keys,
    })
}

/// The kind as given, or inferred from other keys.
fn kind(
    file: &LampFile,
    at: &str,
    keys: &[VirtualLightKey],
    world_from_lamp: DMat4,
) -> Result<VirtualLightKind, Fault> {
    let wrong = |key: &str, reason: &str| Err(Fault::new(format!("{at}.{key}"), reason));
    let aims = keys.iter().filter(|k| k.target.is_some()).count();
    let cone = file.beam_deg.map(|_| "beam_deg");
    let cone = cone.or(file.cutoff_deg.map(|_| "cutoff_deg"));
    if aims != 0 && aims != keys.len() {
        return wrong("keys", "either all have a target_m or none has");
    }
    match (file.kind, cone) {
        (Some(LampKind::Area), Some(key)) => wrong(key, "goes with a spot only"),
        (Some(LampKind::Area), None) => area::kind(file, at, keys, world_from_lamp),
        (Some(LampKind::Point), Some(key)) => wrong(key, "goes with a spot only"),
        (Some(LampKind::Point), None) if aims > 0 => wrong(
            "target_m",
            "goes with a spot or an area; a point emits in all directions",
        ),
        (Some(LampKind::Spot), _) | (None, Some(_)) if aims == 0 => {
            wrong("target_m", "a spot needs it: x, y, z in metres")
        }
        (Some(LampKind::Point) | None, None) if aims == 0 => Ok(VirtualLightKind::Point),
        _ => spot(file, at),
    }
}

/// The lamp's keys; one for a lamp that does not move.
fn keys(file: &LampFile, at: &str, world: DMat4) -> Result<Vec<VirtualLightKey>, Fault> {
    if file.keys.len() > MAX_KEYS {
        let reason = format!("expected at most {MAX_KEYS} keys");
        return Err(Fault::new(format!("{at}.keys"), reason));
    }
    if file.keys.is_empty() {
        return Ok(vec![key(file, &LampKeyFile::default(), at, world)?]);
    }
    let numbered = file.keys.iter().enumerate();
    let keys: Vec<VirtualLightKey> = numbered
        .map(|(i, k)| key(file, k, &format!("{at}.keys[{i}]"), world))
        .collect::<Result<_, _>>()?;
    if keys.is_sorted_by(|a, b| a.seconds < b.seconds) {
        return Ok(keys);
    }
    Err(Fault::new(
        format!("{at}.keys"),
        "expected at_s to increase from key to key",
    ))
}

fn key(
    file: &LampFile,
    own: &LampKeyFile,
    at: &str,
    world: DMat4,
) -> Result<VirtualLightKey, Fault> {
    let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
    let point = |key: &str, value: Option<[f64; 3]>| match value.map(DVec3::from) {
        Some(p) if !p.is_finite() || p.abs().max_element() > MAX_COORDINATE => {
            Err(wrong(key, "expected x, y, z within 100000 m"))
        }
        point => Ok(point),
    };
    let position = point("position_m", own.position_m.or(file.position_m))?
        .ok_or_else(|| wrong("position_m", "a lamp needs it: x, y, z in metres"))?;
    let target = point("target_m", own.target_m.or(file.target_m))?;
    let target = target.or(area::ahead(file, at, position)?);
    if target.is_some_and(|t| t.distance(position) < 1e-6) {
        return Err(wrong(
            "target_m",
            "expected another position than position_m",
        ));
    }
    if !(0.0..=1e6).contains(&own.at_s) {
        return Err(wrong("at_s", "expected seconds from 0 to 1000000"));
    }
    let gain = own.gain.unwrap_or(1.0);
    if !(0.0..=1e6).contains(&gain) {
        return Err(wrong("gain", "expected a number from 0 to 1000000"));
    }
    Ok(VirtualLightKey {
        seconds: own.at_s,
        position: world.transform_point3(position),
        target: target.map(|t| world.transform_point3(t)),
        gain,
    })
}

fn repeat(file: &LampFile, at: &str, keys: &[VirtualLightKey]) -> Result<Option<f64>, Fault> {
    let last = keys.last().map_or(0.0, |k| k.seconds);
    match file.repeat_s {
        Some(s) if !(s.is_finite() && s > 0.0 && s >= last) => Err(Fault::new(
            format!("{at}.repeat_s"),
            "expected seconds, not before the last key",
        )),
        repeat => Ok(repeat),
    }
}

fn spot(file: &LampFile, at: &str) -> Result<VirtualLightKind, Fault> {
    let (beam, cutoff) = (
        file.beam_deg.unwrap_or(20.0),
        file.cutoff_deg.unwrap_or(30.0),
    );
    if !(beam > 0.0 && beam <= cutoff && cutoff <= 180.0) {
        return Err(Fault::new(
            format!("{at}.cutoff_deg"),
            "expected half angles above 0, beam_deg (20 unless given) at most cutoff_deg (30), and that at most 180",
        ));
    }
    Ok(VirtualLightKind::Spot {
        beam: beam.to_radians(),
        cutoff: cutoff.to_radians(),
    })
}

/// Converts the intensity from the given unit to linear RGB, scene camera units.
fn intensity(
    file: &LampFile,
    at: &str,
    (kind, picture): (VirtualLightKind, Option<&SceneTexture>),
    white: Option<f64>,
) -> Result<Vec3, Fault> {
    let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
    let (key, typed) = match (file.intensity, file.candela, file.lumen, file.nit) {
        (Some(Colour(rgb)), None, None, None) => {
            let (colour, kelvin) = (file.colour.map(|_| "colour"), file.kelvin.map(|_| "kelvin"));
            return match colour.or(kelvin) {
                Some(key) => Err(wrong(
                    key,
                    "goes with candela or lumen; `intensity` has a colour",
                )),
                None => Ok(rgb),
            };
        }
        (None, Some(candela), None, None) => ("candela", candela),
        (None, None, Some(lumen), None) => ("lumen", lumen),
        (None, None, None, Some(nit)) => ("nit", nit),
        _ => {
            let reason = "a lamp needs it: three linear numbers; or one of candela, lumen and, for an area, nit";
            return Err(wrong("intensity", reason));
        }
    };
    if !(0.0..=MAX_BRIGHTNESS).contains(&typed) {
        return Err(wrong(key, "expected a number from 0 to 1e9"));
    }
    let white = white.ok_or_else(|| {
        let reason = "needs the luminance of the camera's white: `white_cd_m2` or `ev100` under [photometry]";
        wrong(key, reason)
    })?;
    let candela = match key {
        "lumen" => typed / solid_angle(kind),
        "nit" => typed * area::square_metres(kind) * area::mean_luminance(picture),
        _ => typed,
    };
    Ok(tint(file, at)? * (candela / white) as f32)
}

/// The lamp's colour, at a luminance of 1.
fn tint(file: &LampFile, at: &str) -> Result<Vec3, Fault> {
    let wrong = |key: &str, reason: &str| Err(Fault::new(format!("{at}.{key}"), reason));
    match (file.colour, file.kelvin) {
        (Some(_), Some(_)) => wrong("kelvin", "goes without `colour`; leave one out"),
        (Some(Colour(rgb)), None) => Ok(normalise_luminance(rgb)),
        (None, Some(k)) if !(500.0..=40_000.0).contains(&k) => {
            wrong("kelvin", "expected a colour temperature from 500 to 40000")
        }
        (None, Some(k)) => Ok(black_body(k)),
        (None, None) => Ok(Vec3::ONE),
    }
}

/// Lumen per candela, steradians: the sphere; ∫ 2π f sin θ dθ over a spot's cone with its linear edge;
/// ∫ cos θ over the emitting sides of an area.
fn solid_angle(kind: VirtualLightKind) -> f64 {
    match kind {
        VirtualLightKind::Point => 2.0 * TAU,
        VirtualLightKind::Area { two_sided, .. } => PI * if two_sided { 2.0 } else { 1.0 },
        VirtualLightKind::Spot { beam, cutoff } => {
            let wide = cutoff - beam;
            let edge = if wide > 1e-9 {
                ((cutoff - beam) * beam.cos() - cutoff.sin() + beam.sin()) / wide
            } else {
                0.0
            };
            2.0 * PI * (1.0 - beam.cos() + edge)
        }
    }
}
