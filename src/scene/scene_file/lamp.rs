//! Lamps of a scene file. They stand still.

use super::typed::LampFile;
use crate::calibration::rig_json::{VirtualLight, VirtualLightKey, VirtualLightKind};
use crate::config::toml_text::Fault;
use glam::DVec3;

pub(super) fn lamp(file: &LampFile, at: &str) -> Result<VirtualLight, Fault> {
    let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
    let place = |key: &str, value: Option<[f64; 3]>| match value.map(DVec3::from) {
        Some(p) if !p.is_finite() || p.abs().max_element() > 1e5 => {
            Err(wrong(key, "expected x, y, z within 100000 m"))
        }
        place => Ok(place),
    };
    let position = place("position_m", file.position_m)?
        .ok_or_else(|| wrong("position_m", "a lamp needs it: x, y, z in metres"))?;
    let target = place("target_m", file.target_m)?;
    if target.is_some_and(|t| t.distance(position) < 1e-6) {
        return Err(wrong("target_m", "expected another place than position_m"));
    }
    let intensity = file
        .intensity
        .ok_or_else(|| wrong("intensity", "a lamp needs it: three linear numbers"))?;
    Ok(VirtualLight {
        name: file.name.clone().unwrap_or_else(|| "lamp".to_owned()),
        kind: match target {
            Some(_) => spot(file, at)?,
            None if file.beam_deg.or(file.cutoff_deg).is_some() => {
                return Err(wrong("target_m", "a spot needs it: x, y, z in metres"));
            }
            None => VirtualLightKind::Point,
        },
        intensity: intensity.0,
        keys: vec![VirtualLightKey {
            seconds: 0.0,
            position,
            target,
            gain: 1.0,
        }],
    })
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
