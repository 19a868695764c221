//! Shadowing planes that are placed by hand.

use super::typed::{PlaneFile, PlaneLayer, PlaneReceiver};
use crate::planes::{Layer, Receiver, ShadowingPlane};
use glam::{DVec2, DVec3};
use penumbra_strict_toml::Fault;

/// Maximum coordinate and size, metres.
const MAX_COORDINATE: f64 = 1e5;
/// Minimum sine of the angle between `up` and `normal`.
const MIN_SINE: f64 = 1e-3;

pub(super) fn plane(file: &PlaneFile, at: &str) -> Result<ShadowingPlane, Fault> {
    let wrong = |key: &str, reason: &str| Fault::new(format!("{at}.{key}"), reason);
    let centre = file.centre_m.map(DVec3::from);
    let centre = centre
        .filter(|c| c.is_finite() && c.abs().max_element() <= MAX_COORDINATE)
        .ok_or_else(|| wrong("centre_m", "a plane needs it: x, y, z within 100000 m"))?;
    let normal = file.normal.and_then(|n| DVec3::from(n).try_normalize());
    let normal = normal.ok_or_else(|| {
        wrong(
            "normal",
            "a plane needs it: x, y, z of a direction, away from the covered surfaces",
        )
    })?;
    let (right, up) = axes(file, normal).ok_or_else(|| {
        wrong(
            "up",
            "expected x, y, z of a direction that is not the normal's",
        )
    })?;
    let length = |v: &f64| (1e-3..=MAX_COORDINATE).contains(v);
    let size = file
        .size_m
        .filter(|s| s.iter().all(length))
        .ok_or_else(|| {
            wrong(
                "size_m",
                "a plane needs it: width and height, metres from 0.001 to 100000",
            )
        })?;
    let depth = file.depth_m.filter(length).ok_or_else(|| {
        wrong("depth_m", "a plane needs it: metres from 0.001 to 100000, the maximum distance of covered surfaces behind it")
    })?;
    let layer = match file.layer.unwrap_or(PlaneLayer::Virtual) {
        PlaneLayer::Real => Layer::Real,
        PlaneLayer::Virtual => Layer::Virtual,
    };
    Ok(ShadowingPlane {
        centre,
        right,
        up,
        half_size: DVec2::from(size) / 2.0,
        depth,
        layer,
        receiver: receiver(file.receiver, layer),
        parts: Vec::new(),
    })
}

/// Right and up of the rectangle.
fn axes(file: &PlaneFile, normal: DVec3) -> Option<(DVec3, DVec3)> {
    let default = if normal.z.abs() > 0.95 {
        DVec3::Y
    } else {
        DVec3::Z
    };
    let up = file
        .up
        .map_or(Some(default), |up| DVec3::from(up).try_normalize())?;
    let right = up.cross(normal);
    let right = (right.length() > MIN_SINE).then(|| right.normalize())?;
    Some((right, normal.cross(right)))
}

/// Default receivers: the real ground is flat, virtual parts rarely are.
fn receiver(typed: Option<PlaneReceiver>, layer: Layer) -> Receiver {
    match (typed, layer) {
        (Some(PlaneReceiver::Plane), _) | (None, Layer::Real) => Receiver::Plane,
        (Some(PlaneReceiver::Surface), _) | (None, Layer::Virtual) => Receiver::Surface,
    }
}
