//! What the shading of objects tells of a lamp's energy where no shadow does: a lamp overhead, whose
//! shadows hide below what casts them, still lights tops more than sides.
//!
//! The faces of a phantom are taken to reflect about alike. Each face beside the largest one is a piece of
//! evidence as independent as a part of the picture; a loss that saturates keeps one painted box from
//! deciding.

use super::{SAME_NORMAL, SeenSurfaces};
use glam::Vec3;
use std::collections::BTreeMap;

/// Least number of points of a face.
const MIN_POINTS: usize = 10;
/// Scale of the loss, logarithms of light: faces of one object differ by dirt, paint and what stands
/// beside them.
const SCALE: f32 = 0.3;
/// Number of pairs of points for which a face counts.
const WEIGHT: f32 = 40.0;

/// Numbers of points that show a surface from one side.
type Face = (Vec3, Vec<usize>);

/// The faces of each surface, the largest first.
#[derive(Debug, Default)]
pub(super) struct Faces(Vec<Vec<Vec<usize>>>);

impl Faces {
    pub fn of(surfaces: &SeenSurfaces) -> Self {
        let mut by_surface: BTreeMap<u32, Vec<Face>> = BTreeMap::new();
        for (i, point) in surfaces.points.iter().enumerate() {
            let Some(point) = point else { continue };
            let faces = by_surface.entry(point.surface).or_default();
            match faces
                .iter_mut()
                .find(|f| f.0.dot(point.normal) > SAME_NORMAL)
            {
                Some((_, points)) => points.push(i),
                None => faces.push((point.normal, vec![i])),
            }
        }
        let large = |faces: Vec<Face>| {
            let mut faces: Vec<Vec<usize>> = faces.into_iter().map(|(_, points)| points).collect();
            faces.retain(|points| points.len() >= MIN_POINTS);
            faces.sort_by_key(|points| std::cmp::Reverse(points.len()));
            faces
        };
        let all = by_surface.into_values().map(large);
        Self(all.filter(|faces| faces.len() > 1).collect())
    }

    /// The loss of each face but the largest, with these logarithms of the irradiance of all points.
    pub fn losses(
        &self,
        surfaces: &SeenSurfaces,
        channel: usize,
        log: &[f32],
    ) -> impl Iterator<Item = f32> {
        let reflectance = move |points: &Vec<usize>| {
            let seen = |i: &usize| surfaces.points[*i].map_or(0.0, |p| p.log_values[channel]);
            let sum: f32 = points.iter().map(|i| seen(i) - log[*i]).sum();
            sum / points.len() as f32
        };
        self.0.iter().flat_map(move |faces| {
            let largest = reflectance(&faces[0]);
            faces[1..].iter().map(move |face| {
                let square = ((reflectance(face) - largest) / SCALE).powi(2);
                WEIGHT * square / (1.0 + square)
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{overhead, seen_lamp, sky};
    use super::super::*;
    use super::*;

    /// By what the light of a lamp overhead, of which a third is clipped away, is multiplied.
    fn found(boxes: usize, painted: usize) -> f32 {
        let (seen, mut lamp) = overhead(boxes, painted);
        lamp.irradiance *= 0.33;
        lamp.clipped = 0.7;
        let blocked = |_: DVec3, _: DVec3, _: f64| false;
        let lamps = [seen_lamp(lamp)];
        let mut search = DistanceSearch::new(&seen, &lamps, (&sky(), None), DVec3::ZERO, &blocked);
        search.find_factor(0, Vec3::ONE, Colour::BestMatch).x * 0.33
    }

    #[test]
    fn tops_and_sides_tell_how_bright_a_lamp_overhead_is() {
        let share = found(2, 0);
        assert!((share - 1.0).abs() < 0.12, "{share}");
        // One box whose sides are painted darker does not outweigh two others.
        let share = found(3, 1);
        assert!((share - 1.0).abs() < 0.25, "{share}");
    }

    #[test]
    fn one_face_is_not_evidence_enough() {
        assert_eq!(found(0, 0), 0.33);
    }
}
