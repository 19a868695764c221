//! Area lamps of a scene file.

use super::material::read_texture;
use super::typed::{LampFile, LampKind};
use crate::mesh::SceneTexture;
use crate::photometric::mean_colour;
use crate::virtual_light::{Screen, VirtualLightKey, VirtualLightKind};
use glam::{DMat4, DVec2, DVec3};
use penumbra_strict_toml::Fault;
use std::path::Path;
use std::sync::Arc;

/// Minimum and maximum side, metres.
const MIN_SIZE: f64 = 1e-4;
const MAX_SIZE: f64 = 1000.0;
/// Maximum cosine between `up` and the normal; beyond it the orientation of the picture is undefined.
const PARALLEL: f64 = 0.9999;

/// Returns the shape and orientation of the area; `keys` are the lamp's, in the world.
pub(super) fn kind(
    file: &LampFile,
    at: &str,
    keys: &[VirtualLightKey],
    world_from_lamp: DMat4,
) -> Result<VirtualLightKind, Fault> {
    let wrong = |key: &str, reason: &str| Err(Fault::new(format!("{at}.{key}"), reason));
    let Some(size) = file.size_m.map(DVec2::from) else {
        return wrong("size_m", "an area needs it: width and height in metres");
    };
    if !size
        .to_array()
        .iter()
        .all(|s| (MIN_SIZE..=MAX_SIZE).contains(s))
    {
        return wrong("size_m", "expected metres from 0.0001 to 1000");
    }
    let Some(facing) = keys.first().and_then(|k| Some(k.target? - k.position)) else {
        let reason = "an area needs it, x, y, z in metres; or `direction`";
        return wrong("target_m", reason);
    };
    let typed = DVec3::from(file.up.unwrap_or([0.0, 0.0, 1.0]));
    let up = world_from_lamp.transform_vector3(typed);
    let up = up.try_normalize().filter(|_| typed.is_finite());
    let parallel = |up: DVec3| up.dot(facing.normalize_or_zero()).abs() > PARALLEL;
    match (up, file.up) {
        (Some(up), Some(_)) if !parallel(up) => Ok(area(file, size, up)),
        (Some(up), None) => Ok(area(file, size, if parallel(up) { DVec3::Y } else { up })),
        _ => wrong("up", "expected a direction other than the one it faces"),
    }
}

fn area(file: &LampFile, size: DVec2, up: DVec3) -> VirtualLightKind {
    VirtualLightKind::Area {
        half_size: 0.5 * size,
        up,
        two_sided: file.two_sided.unwrap_or(false),
    }
}

/// Returns the target of a lamp with a `direction`.
pub(super) fn ahead(file: &LampFile, at: &str, position: DVec3) -> Result<Option<DVec3>, Fault> {
    let wrong = |reason: &str| Err(Fault::new(format!("{at}.direction"), reason));
    let Some(direction) = file.direction.map(DVec3::from) else {
        return Ok(None);
    };
    if file.kind != Some(LampKind::Area) || file.target_m.is_some() {
        return wrong("goes with an area that has no target_m; leave one out");
    }
    match direction.try_normalize() {
        Some(direction) => Ok(Some(position + direction)),
        None => wrong("expected x, y, z other than 0, 0, 0"),
    }
}

/// Returns the appearance of an area; `None` for other lamps, which must not have its keys.
pub(super) fn screen(
    file: &LampFile,
    at: &str,
    kind: VirtualLightKind,
    folder: &Path,
) -> Result<Option<Screen>, Fault> {
    let wrong = |key: &str, reason: String| Err(Fault::new(format!("{at}.{key}"), reason));
    if !matches!(kind, VirtualLightKind::Area { .. }) {
        let given = [
            ("size_m", file.size_m.is_some()),
            ("texture", file.texture.is_some()),
            ("two_sided", file.two_sided.is_some()),
            ("visible", file.visible.is_some()),
            ("nit", file.nit.is_some()),
            ("up", file.up.is_some()),
        ];
        return match given.iter().find(|(_, given)| *given) {
            Some((key, _)) => wrong(key, "goes with kind = \"area\" only".to_owned()),
            None => Ok(None),
        };
    }
    let texture = match &file.texture {
        None => None,
        Some(name) => match read_texture(folder, name) {
            Ok(texture) if mean_luminance(Some(&texture)) > 0.0 => Some(Arc::new(texture)),
            Ok(_) => return wrong("texture", format!("{name} is entirely black")),
            Err(reason) => return wrong("texture", reason),
        },
    };
    Ok(Some(Screen {
        texture,
        visible: file.visible.unwrap_or(true),
    }))
}

/// Area of an area light, m²; 0 for other lamps.
pub(super) fn square_metres(kind: VirtualLightKind) -> f64 {
    match kind {
        VirtualLightKind::Area { half_size, .. } => 4.0 * half_size.x * half_size.y,
        VirtualLightKind::Point | VirtualLightKind::Spot { .. } => 0.0,
    }
}

/// Mean luminance of an area's texture, relative to white.
pub(super) fn mean_luminance(picture: Option<&SceneTexture>) -> f64 {
    picture.map_or(1.0, |p| {
        f64::from(crate::photometric::luminance(mean_colour(p)))
    })
}
