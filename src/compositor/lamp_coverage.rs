//! The directions and viewpoints of a lamp's shadow maps.
//!
//! A lamp outside the casters has one map that fits around them, or around the cone of a narrow
//! spot. A lamp among the casters has the six faces of a cube. An area lamp has several
//! viewpoints, whose views share each map like tiles.

use super::caster_hull::CasterHull;
use glam::{Mat4, Vec3, Vec4};
use penumbra_scene::{PlacedArea, PlacedLamp};

/// Twin of WGSL `LAMP_NEAR`.
const NEAR: f32 = 1e-3;
/// Maximum half angle of a single map, radians: a wider map would be coarse at its corners. Maps of
/// area lamps, whose shadows are soft, may be wider.
const MAX_HALF_ANGLE: f32 = 0.9;
const MAX_HALF_ANGLE_OF_AREA: f32 = 1.2;
/// Viewpoints along each side of an area lamp with one map.
const ACROSS: u32 = 4;
/// Viewpoints along each side of an area lamp with a cube, or among more than [`FEW_AREAS`] area
/// lamps, where more viewpoints would take too much time.
const ACROSS_OF_MANY: u32 = 2;
/// Maximum number of area lamps with [`ACROSS`] viewpoints.
const FEW_AREAS: usize = 4;
/// Maximum number of views of one lamp.
pub const MAX_VIEWS_EACH: usize = 24;

/// The directions that the maps of a lamp cover.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coverage {
    /// No casters.
    Nothing,
    /// A square pyramid around `forward`, `tangent` wide to each side.
    One { forward: Vec3, tangent: f32 },
    /// All directions.
    Cube,
}

/// Right, up and forward of a map, and the tangent of its half angle.
pub type MapAxes = ([Vec3; 3], f32);

impl Coverage {
    /// The coverage that `lamp` needs for the casters in `hull`.
    pub fn for_lamp(lamp: &PlacedLamp, hull: &CasterHull) -> Self {
        let Some((forward, angle)) = hull.cone_from(lamp.position) else {
            return Self::Nothing;
        };
        if let Some(area) = &lamp.area {
            return Self::for_area(lamp, area, hull, (forward, angle));
        }
        let spot = lamp.cone.map(|(_, cutoff)| (lamp.direction, cutoff));
        let hull = Some((forward, angle + 0.01)).filter(|_| angle.is_finite());
        let narrowest = [hull, spot]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        Self::around(narrowest, MAX_HALF_ANGLE)
    }

    fn for_area(
        lamp: &PlacedLamp,
        area: &PlacedArea,
        hull: &CasterHull,
        (forward, angle): (Vec3, f32),
    ) -> Self {
        let plane = lamp.position.dot(lamp.direction);
        let (behind, ahead) = hull.extent(lamp.direction).unwrap_or_default();
        if !area.two_sided && ahead <= plane {
            return Self::Nothing;
        }
        let whole = area.two_sided || behind >= plane;
        let widest = eyes(lamp, ACROSS)
            .map(|eye| hull.angle_around(eye, forward))
            .fold(angle, f32::max);
        let cone = (whole && widest.is_finite()).then_some((forward, widest + 0.01));
        Self::around(cone, MAX_HALF_ANGLE_OF_AREA)
    }

    fn around(cone: Option<(Vec3, f32)>, widest: f32) -> Self {
        match cone {
            Some((forward, angle)) if angle < widest => Self::One {
                forward,
                tangent: angle.tan(),
            },
            _ => Self::Cube,
        }
    }

    /// Number of maps.
    pub const fn layers(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::One { .. } => 1,
            Self::Cube => 6,
        }
    }

    /// Number of views in each map, each way, among `areas` area lamps.
    pub const fn across(&self, lamp: &PlacedLamp, areas: usize) -> u32 {
        match (self, lamp.area) {
            (_, None) => 1,
            (Self::Cube, Some(_)) => ACROSS_OF_MANY,
            (_, Some(_)) if areas > FEW_AREAS => ACROSS_OF_MANY,
            (_, Some(_)) => ACROSS,
        }
    }

    /// The axes of each map, whose views have `size` texels a side. Faces of a cube are slightly
    /// wider than 90°, so that the texels at their edges show what lies beyond.
    pub fn axes(&self, size: u32) -> Vec<MapAxes> {
        match *self {
            Self::Nothing => Vec::new(),
            Self::One { forward, tangent } => {
                let (right, up) = forward.any_orthonormal_pair();
                vec![([right, up, forward], tangent)]
            }
            Self::Cube => (0..6)
                .map(|face| {
                    let axis = |k: usize| Vec3::AXES[(face / 2 + k) % 3];
                    let forward = if face % 2 == 0 { axis(0) } else { -axis(0) };
                    ([axis(1), axis(2), forward], 1.0 + 4.0 / size as f32)
                })
                .collect(),
        }
    }
}

/// The viewpoints of a lamp: `across²` of an area lamp, row by row from its upper left, one in each
/// cell, no two with the same coordinate (correlated multi-jittered sampling, Kensler 2013). Twin
/// of WGSL `area_eye`.
pub fn eyes(lamp: &PlacedLamp, across: u32) -> impl Iterator<Item = Vec3> {
    let n = across as f32;
    (0..across * across).map(move |i| {
        let (x, y) = ((i % across) as f32, (i / across) as f32);
        let position = |cell: f32, within: f32| (cell + (within + 0.5) / n) * 2.0 / n - 1.0;
        let offset =
            |area: PlacedArea| area.half_right * position(x, y) - area.half_up * position(y, x);
        lamp.position + lamp.area.map_or(Vec3::ZERO, offset)
    })
}

/// Projection of a view from `eye`, with reversed depth and the far plane at infinity.
pub fn clip(eye: Vec3, ([right, up, forward], tangent): &MapAxes) -> Mat4 {
    let row = |axis: Vec3| axis.extend(-axis.dot(eye));
    Mat4::from_cols(
        row(*right / *tangent),
        row(*up / *tangent),
        Vec4::new(0.0, 0.0, 0.0, NEAR),
        row(*forward),
    )
    .transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn screen(position: Vec3, direction: Vec3, two_sided: bool) -> PlacedLamp {
        let (half_right, half_up) = direction.any_orthonormal_pair();
        PlacedLamp {
            position,
            direction,
            intensity: Vec3::ONE,
            cone: None,
            area: Some(PlacedArea {
                half_right: half_right * 0.2,
                half_up: half_up * 0.1,
                two_sided,
                screen: 0,
            }),
        }
    }

    fn cube() -> CasterHull {
        let corner = |i: u32| [i & 1, i >> 1 & 1, i >> 2].map(|c| c as f32 - 0.5);
        CasterHull::around(&(0..8).map(corner).collect::<Vec<_>>())
    }

    #[test]
    fn map_of_every_viewpoint_of_an_area_lamp_holds_all_casters() {
        let lamp = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::NEG_Z, false);
        let coverage = Coverage::for_lamp(&lamp, &cube());
        assert!(matches!(coverage, Coverage::One { .. }), "{coverage:?}");
        let axes = coverage.axes(256);
        for eye in eyes(&lamp, coverage.across(&lamp, 1)) {
            for i in 0..8 {
                let corner = [i & 1, i >> 1 & 1, i >> 2].map(|c| c as f32 - 0.5);
                let at = clip(eye, &axes[0]) * Vec3::from(corner).extend(1.0);
                assert!(at.x.abs() < at.w && at.y.abs() < at.w, "{eye}: {at}");
            }
        }
    }

    #[test]
    fn ignores_casters_behind_a_one_sided_area_lamp() {
        let away = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::Z, false);
        assert_eq!(Coverage::for_lamp(&away, &cube()), Coverage::Nothing);
        let both = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::Z, true);
        assert!(matches!(
            Coverage::for_lamp(&both, &cube()),
            Coverage::One { .. }
        ));
        let among = screen(Vec3::ZERO, Vec3::Z, false);
        assert_eq!(Coverage::for_lamp(&among, &cube()), Coverage::Cube);
        let most = Coverage::Cube.layers() * 4;
        assert!(most <= MAX_VIEWS_EACH && (ACROSS * ACROSS) as usize <= MAX_VIEWS_EACH);
    }

    #[test]
    fn viewpoints_have_evenly_spaced_distinct_coordinates() {
        let lamp = screen(Vec3::ZERO, Vec3::Z, false);
        let right = lamp.area.unwrap().half_right;
        let mut along: Vec<f32> = eyes(&lamp, 4)
            .map(|e| e.dot(right) / right.length_squared())
            .collect();
        along.sort_by(f32::total_cmp);
        for (i, x) in along.iter().enumerate() {
            assert!(
                (x - ((i as f32 + 0.5) / 8.0 - 1.0)).abs() < 1e-5,
                "{i}: {x}"
            );
        }
        assert!(eyes(&lamp, 4).sum::<Vec3>().length() < 1e-5);
    }
}
