//! What a lamp's maps look at, and from where.
//!
//! A lamp outside the casters has one map that fits around them, or around a narrow spot's
//! cone. A lamp among the casters looks all round with the six faces of a cube. A rectangle
//! looks from several places, whose views share each map like tiles.

use super::caster_hull::CasterHull;
use glam::{Mat4, Vec3, Vec4};
use penumbra_scene::{PlacedArea, PlacedLamp};

/// Twin of WGSL `LAMP_NEAR`.
const NEAR: f32 = 1e-3;
/// A single map is not made wider than this half angle: its corners would be coarse. Of a
/// rectangle, whose shadows are soft, it may.
const WIDEST: f32 = 0.9;
const WIDEST_OF_AREA: f32 = 1.2;
/// Places that a rectangle looks from, each way: by one map; and all round, or as one of more than
/// [`FEW_AREAS`], when each place would cost too much.
const ACROSS: u32 = 4;
const ACROSS_OF_MANY: u32 = 2;
const FEW_AREAS: usize = 4;
/// Views of one lamp at most.
pub const MOST_VIEWS_EACH: usize = 24;

/// See the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Coverage {
    /// No casters.
    Nothing,
    /// A square pyramid around `forward`, `tangent` wide to each side.
    One { forward: Vec3, tangent: f32 },
    /// All round.
    Cube,
}

/// Right, up, forward and the tangent of the half width of a map.
pub type MapAxes = ([Vec3; 3], f32);

impl Coverage {
    pub fn of(lamp: &PlacedLamp, hull: &CasterHull) -> Self {
        let Some((forward, angle)) = hull.cone_from(lamp.position) else {
            return Self::Nothing;
        };
        if let Some(area) = &lamp.area {
            return Self::of_area(lamp, area, hull, (forward, angle));
        }
        let spot = lamp.cone.map(|(_, cutoff)| (lamp.direction, cutoff));
        let hull = Some((forward, angle + 0.01)).filter(|_| angle.is_finite());
        let narrowest = [hull, spot]
            .into_iter()
            .flatten()
            .min_by(|a, b| a.1.total_cmp(&b.1));
        Self::around(narrowest, WIDEST)
    }

    fn of_area(
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
        Self::around(cone, WIDEST_OF_AREA)
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

    /// Maps.
    pub const fn layers(&self) -> usize {
        match self {
            Self::Nothing => 0,
            Self::One { .. } => 1,
            Self::Cube => 6,
        }
    }

    /// Views in each map, each way, of one of so many areas.
    pub const fn across(&self, lamp: &PlacedLamp, areas: usize) -> u32 {
        match (self, lamp.area) {
            (_, None) => 1,
            (Self::Cube, Some(_)) => ACROSS_OF_MANY,
            (_, Some(_)) if areas > FEW_AREAS => ACROSS_OF_MANY,
            (_, Some(_)) => ACROSS,
        }
    }

    /// Of each map, whose views have `size` texels a side. Texels on the edge of a cube's face
    /// show a little of what lies beyond it.
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

/// Places that a lamp is looked from, `across²` of a rectangle, row by row from its upper left:
/// one in each cell, no two in line (correlated multi-jittered, Kensler 2013). Twin of WGSL
/// `area_eye`.
pub fn eyes(lamp: &PlacedLamp, across: u32) -> impl Iterator<Item = Vec3> {
    let n = across as f32;
    (0..across * across).map(move |i| {
        let (x, y) = ((i % across) as f32, (i / across) as f32);
        let place = |cell: f32, within: f32| (cell + (within + 0.5) / n) * 2.0 / n - 1.0;
        let off = |area: PlacedArea| area.half_right * place(x, y) - area.half_up * place(y, x);
        lamp.position + lamp.area.map_or(Vec3::ZERO, off)
    })
}

/// Reversed depth with the far plane at infinity.
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
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
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
    fn every_place_of_a_rectangle_sees_all_casters_in_its_map() {
        let lamp = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::NEG_Z, false);
        let coverage = Coverage::of(&lamp, &cube());
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
    fn what_is_behind_a_one_sided_rectangle_does_not_count() {
        let away = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::Z, false);
        assert_eq!(Coverage::of(&away, &cube()), Coverage::Nothing);
        let both = screen(Vec3::new(0.0, 0.0, 1.5), Vec3::Z, true);
        assert!(matches!(Coverage::of(&both, &cube()), Coverage::One { .. }));
        let among = screen(Vec3::ZERO, Vec3::Z, false);
        assert_eq!(Coverage::of(&among, &cube()), Coverage::Cube);
        let most = Coverage::Cube.layers() * 4;
        assert!(most <= MOST_VIEWS_EACH && (ACROSS * ACROSS) as usize <= MOST_VIEWS_EACH);
    }

    #[test]
    fn places_are_spread_over_the_rectangle_no_two_in_line() {
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
