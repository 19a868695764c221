//! Planes on the real ground: a fine one around the model and larger, coarser ones for the long
//! shadows of low lights.

use super::rectangle::Axes;
use super::surface::{Fragment, bounds};
use super::{Layer, Receiver, ShadowingPlane};
use crate::scene::Scene;
use glam::{DVec2, DVec3};

/// Shadow lengths per height of the caster that the nested planes hold. The lights of a dome of
/// frequency 2 have elevations of 72.5°, 52.6°, 40.1°, 20.1°, 10.8° and 9.1°; the values are the
/// cotangents of 9.1°, 20.1° and 40.1°.
const LONG: f64 = 6.25;
const MEDIUM: f64 = 2.75;
const SHORT: f64 = 1.2;

/// A flat, possibly slanted piece of the real ground.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    axes: Axes,
    /// Offset along the normal, metres.
    height: f64,
    /// Corners of its rectangle along the axes.
    limits: (DVec2, DVec2),
    /// Index of its phantom; `None` for the unbounded ground of a scene without one.
    pub part: Option<u32>,
}

impl Ground {
    /// Finds the ground of a scene: the phantom of that name, else the unbounded plane at
    /// [`Scene::ground_height`], else the largest phantom that is flat and faces up.
    pub fn find(scene: &Scene, phantoms: &[Fragment]) -> Option<Self> {
        let parts = 0..scene.phantom_parts.len() as u32;
        let flat = |part: u32| Self::from_part(phantoms, part).map(|g| (g.area(), g));
        let named = parts
            .clone()
            .find(|p| scene.phantom_parts[*p as usize].name == "ground");
        if let Some((_, ground)) = named.and_then(flat) {
            return Some(ground);
        }
        if let Some(height) = scene.ground_height {
            return Some(Self {
                axes: Axes::around(DVec3::Z),
                height,
                limits: (DVec2::NEG_INFINITY, DVec2::INFINITY),
                part: None,
            });
        }
        parts
            .filter_map(flat)
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|g| g.1)
    }

    fn from_part(phantoms: &[Fragment], part: u32) -> Option<Self> {
        let own = || phantoms.iter().filter(move |f| f.part == part);
        let normal = own()
            .map(|f| f.normal * f.area)
            .sum::<DVec3>()
            .try_normalize()?;
        let axes = Axes::around(normal);
        let along = own().flat_map(|f| f.corners).map(|p| p.dot(normal));
        let (min, max) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, m), d| {
            (l.min(d), m.max(d))
        });
        let limits = flat_bounds(&axes, own().flat_map(|f| f.corners));
        let size = (limits.1 - limits.0).max_element();
        let is_flat = normal.z > 0.9 && max - min <= (0.01 * size).max(1e-3);
        is_flat.then_some(Self {
            axes,
            height: f64::midpoint(min, max),
            limits,
            part: Some(part),
        })
    }

    fn area(&self) -> f64 {
        let size = self.limits.1 - self.limits.0;
        size.x * size.y
    }

    /// Returns at most `max_planes` planes around the shadows of `model`, finest first.
    pub fn planes(
        &self,
        model: &[Fragment],
        max_planes: usize,
        offset_m: f64,
    ) -> Vec<ShadowingPlane> {
        let corners = || model.iter().flat_map(|f| f.corners);
        let top = corners()
            .map(|p| p.dot(self.axes.normal))
            .fold(f64::NEG_INFINITY, f64::max);
        let height = (top - self.height).max(0.0);
        let foot = flat_bounds(&self.axes, corners());
        let reaches: &[f64] = match max_planes {
            0 => &[],
            1 => &[MEDIUM],
            2 => &[SHORT, LONG],
            _ => &[SHORT, MEDIUM, LONG],
        };
        let mut out: Vec<ShadowingPlane> = Vec::new();
        for reach in reaches {
            let Some(plane) = self.plane(foot, reach * height, offset_m) else {
                continue;
            };
            let area = |p: &ShadowingPlane| p.half_size.x * p.half_size.y;
            // At the border of the ground a larger plane would be the same.
            if out
                .last()
                .is_none_or(|last| area(&plane) > 1.2 * area(last))
            {
                out.push(plane);
            } else if let Some(last) = out.last_mut() {
                *last = plane;
            }
        }
        out
    }

    fn plane(&self, foot: (DVec2, DVec2), reach: f64, offset_m: f64) -> Option<ShadowingPlane> {
        let margin = reach + 0.1 * (foot.1 - foot.0).max_element();
        let low = (foot.0 - margin).max(self.limits.0);
        let high = (foot.1 + margin).min(self.limits.1);
        let half = (high - low) / 2.0;
        if half.min_element().is_nan() || half.min_element() <= 0.0 {
            return None;
        }
        // Shadows are baked for the rectangle itself: a large offset would shift those of low lights.
        let offset = offset_m.min(half.max_element() * 1e-3).max(1e-6);
        let middle = low.midpoint(high);
        let Axes { right, up, normal } = self.axes;
        Some(ShadowingPlane {
            centre: right * middle.x + up * middle.y + normal * (self.height + offset),
            right,
            up,
            half_size: half,
            depth: 2.0 * offset + 2e-3,
            layer: Layer::Real,
            receiver: Receiver::Plane,
            parts: self.part.into_iter().collect(),
        })
    }
}

fn flat_bounds(axes: &Axes, points: impl Iterator<Item = DVec3>) -> (DVec2, DVec2) {
    let (low, high) = bounds(points.map(|p| axes.flat(p).extend(0.0)));
    (low.truncate(), high.truncate())
}
