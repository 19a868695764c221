//! What stands in the scene, as a `rig.json` lists it: object, phantoms, ground, markers,
//! virtual lights.

use super::cameras::flag;
use super::{Marker, Node, ObjectPlacement, PhantomPlacement, Result, name_of};
use glam::{DMat4, DVec3, Vec3};
use penumbra_scene::GroundPlane;
use penumbra_scene::gltf_file::z_up_from_y_up;
use penumbra_scene::{VirtualLight, VirtualLightKey, VirtualLightKind};

pub(super) fn object(node: &Node) -> Result<ObjectPlacement> {
    let world_from_glb = match node.find("T_world_glb") {
        Some(n) => n.transform()?,
        None => {
            let world_from_object = node
                .need(
                    "T_world_object",
                    "the object's pose in the world, or T_world_glb",
                )?
                .transform()?;
            world_from_object * z_up_from_y_up()
        }
    };
    Ok(ObjectPlacement {
        file: node.need("glb", "a file name")?.text()?.to_owned(),
        world_from_glb,
    })
}

fn albedo(node: &Node) -> Result<Option<Vec3>> {
    let Some(node) = node.find("albedo_linear_rgb") else {
        return Ok(None);
    };
    let rgb = node.colour()?;
    if rgb.iter().any(|c| *c > 1.0) {
        return Err(node.wrong("three numbers between 0 and 1"));
    }
    Ok(Some(Vec3::from(rgb)))
}

pub(super) fn phantom(node: &Node) -> Result<PhantomPlacement> {
    let in_world = match node.find("ply_frame") {
        Some(frame) => match frame.text()? {
            "world" => true,
            "phantom" | "local" => false,
            _ => return Err(frame.wrong("\"world\" or \"phantom\"")),
        },
        None => true,
    };
    let world_from_file = if in_world {
        DMat4::IDENTITY
    } else {
        node.need("pose", "the phantom's pose in the world")?
            .transform()?
    };
    Ok(PhantomPlacement {
        name: name_of(node, "phantom")?,
        file: node.need("ply", "a file name")?.text()?.to_owned(),
        world_from_file,
        mirror: flag(node, "mirror")?,
        albedo: albedo(node)?,
    })
}

pub(super) fn ground(node: &Node) -> Result<GroundPlane> {
    let normal = match node.find("normal") {
        Some(n) => n
            .vector()?
            .try_normalize()
            .ok_or_else(|| n.wrong("a direction other than 0, 0, 0"))?,
        None => DVec3::Z,
    };
    Ok(GroundPlane {
        normal,
        offset: node.find("offset").map_or(Ok(0.0), |n| n.number())?,
        size: node.find("size_m").map_or(Ok(10.0), |n| n.positive())?,
        albedo: albedo(node)?,
    })
}

pub(super) fn marker(node: &Node) -> Result<Marker> {
    let family = node.need("family", "e.g. \"tag36h11\"")?.text()?.to_owned();
    Ok(Marker {
        family,
        id: node.need("id", "a whole number")?.pixels()?,
        size: node.need("size_m", "metres")?.positive()?,
        world_from_marker: node
            .need("T_world_marker", "the marker's pose in the world")?
            .rigid()?,
    })
}

pub(super) fn virtual_light(node: &Node) -> Result<VirtualLight> {
    let kind = light_kind(node)?;
    let keys = node.need("keys", "a list of t, pos, target, gain")?;
    let keys: Vec<_> = keys
        .list(100_000)?
        .iter()
        .map(light_key)
        .collect::<Result<_>>()?;
    let aimless = keys.iter().any(|k| k.target.is_none());
    if keys.is_empty() || (aimless && kind != VirtualLightKind::Point) {
        return Err(node.wrong("given at least one key, and a target in each if it is a spot"));
    }
    if keys.windows(2).any(|k| k[0].seconds >= k[1].seconds) {
        return Err(node.wrong("given keys in the order of their times, no two at the same"));
    }
    Ok(VirtualLight {
        repeat: None,
        screen: None,
        name: name_of(node, "light")?,
        kind,
        intensity: Vec3::from(node.need("intensity", "linear RGB")?.colour()?),
        keys,
    })
}

fn light_kind(node: &Node) -> Result<VirtualLightKind> {
    let kind = node.need("kind", "\"point\" or \"spot\"")?;
    match kind.text()? {
        "point" => Ok(VirtualLightKind::Point),
        "spot" => {
            let beam = node.need("beam_deg", "degrees")?.positive()?;
            let cutoff = node.need("cutoff_deg", "degrees")?;
            let degrees = cutoff.positive()?;
            if degrees > 180.0 || degrees < beam {
                return Err(cutoff.wrong("a half angle of at least beam_deg and at most 180"));
            }
            Ok(VirtualLightKind::Spot {
                beam: beam.to_radians(),
                cutoff: degrees.to_radians(),
            })
        }
        _ => Err(kind.wrong("\"point\" or \"spot\"")),
    }
}

fn light_key(node: &Node) -> Result<VirtualLightKey> {
    let gain = node.find("gain");
    let key = VirtualLightKey {
        seconds: node.need("t", "seconds")?.number()?,
        position: node.need("pos", "x, y, z in metres")?.vector()?,
        target: node.find("target").map(|n| n.vector()).transpose()?,
        gain: gain.as_ref().map_or(Ok(1.0), Node::number)?,
    };
    if let Some(gain) = gain.filter(|_| key.gain < 0.0) {
        return Err(gain.wrong("a number of at least 0"));
    }
    if key.target.is_some_and(|t| t.distance(key.position) < 1e-6) {
        return Err(node.wrong("given a target that is not the lamp's own place"));
    }
    Ok(key)
}
