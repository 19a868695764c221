//! A scene: virtual objects, phantoms and virtual lights, and their state at an instant.

use crate::edit::SceneObject;
use crate::lamps::{PlacedArea, PlacedLamp};
use crate::mesh::Part;
use crate::motion::Motions;
use crate::planes::ShadowingPlane;
use crate::virtual_light::VirtualLight;
use glam::{DMat3, DMat4, DVec3, Vec3};

/// Virtual objects, proxies of real objects, and lamps.
#[derive(Clone, Debug, Default)]
pub struct Scene {
    /// Parts of virtual objects.
    pub virtual_parts: Vec<Part>,
    /// Which parts and lamps belong together; empty if they are one object.
    pub objects: Vec<SceneObject>,
    /// Proxies of real objects: they write depth and receive shadows, and have no colour of their
    /// own.
    pub phantom_parts: Vec<Part>,
    /// Height of level ground, world, metres (plane z = height); `None` without level ground.
    pub ground_height: Option<f64>,
    /// Virtual lights.
    pub lamps: Vec<VirtualLight>,
    /// Shadowing planes that are placed by hand.
    pub planes: Vec<ShadowingPlane>,
    /// Motions of parts and lamps; the scene holds their initial poses.
    pub motions: Motions,
    /// Warnings for the user, one line each, about a scene that can be rendered nevertheless.
    pub warnings: Vec<String>,
}

impl Scene {
    /// Whether a virtual part has Phong's lobe, for which the environment must be filtered.
    #[must_use]
    pub fn has_phong(&self) -> bool {
        let mut materials = self.virtual_parts.iter().map(|p| &p.material);
        materials.any(|m| m.phong.is_some())
    }

    /// Writes the state of all lamps that are not dark at `seconds` to `placed`, which is cleared
    /// first.
    pub fn lamps_at(&self, seconds: f64, placed: &mut Vec<PlacedLamp>) {
        placed.clear();
        let mut carried = self.motions.lamps.iter().peekable();
        for (i, lamp) in self.lamps.iter().enumerate() {
            let carrier = carried.next_if(|mover| mover.index == i);
            let Some(mut lamp) = lamp.at(seconds) else {
                continue;
            };
            if let Some(area) = &mut lamp.area {
                area.screen = i;
            }
            if lamp.intensity.max_element() > 0.0 {
                let place = carrier.map(|mover| mover.motion.at(seconds));
                placed.push(place.map_or(lamp, |place| carry(&lamp, place)));
            }
        }
    }

    /// Sets the poses of all moving parts to those at `seconds`.
    pub fn place_at(&mut self, seconds: f64) {
        for mover in &self.motions.parts {
            if let Some(part) = self.virtual_parts.get_mut(mover.index) {
                part.world_from_part = mover.motion.at(seconds);
            }
        }
    }
}

/// Transforms a lamp on a carrier to the world.
fn carry(lamp: &PlacedLamp, world_from_carrier: DMat4) -> PlacedLamp {
    let position = world_from_carrier.transform_point3(lamp.position.as_dvec3());
    let axes = DMat3::from_mat4(world_from_carrier);
    let rotated = |v: Vec3| (axes * v.as_dvec3()).normalize_or(DVec3::NEG_Z).as_vec3();
    // A lamp keeps its size; its carrier's scale is ignored.
    let edge = |half: Vec3| rotated(half) * half.length();
    PlacedLamp {
        position: position.as_vec3(),
        direction: rotated(lamp.direction),
        area: lamp.area.map(|area| PlacedArea {
            half_right: edge(area.half_right),
            half_up: edge(area.half_up),
            ..area
        }),
        ..*lamp
    }
}

/// Divides `parts` into those that do not move and those that do.
#[must_use]
pub fn still_and_moving<'a>(
    parts: &'a [Part],
    motions: &Motions,
) -> (Vec<&'a Part>, Vec<&'a Part>) {
    let mut movers = motions.parts.iter().peekable();
    let mut split = (Vec::new(), Vec::new());
    for (i, part) in parts.iter().enumerate() {
        if movers.next_if(|mover| mover.index == i).is_some() {
            split.1.push(part);
        } else {
            split.0.push(part);
        }
    }
    split
}
