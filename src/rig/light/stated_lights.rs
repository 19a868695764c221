//! Lamps and windows whose places the user states.

use glam::{DVec3, Vec3};
use penumbra_config::RoomLight;
use penumbra_lighting::adaptive::CompactSource;
use penumbra_lighting::place::{LampDistance, LampPlane};

/// Angle between a stated light and a source, radians, in addition to the source's radius, up to
/// which they are the same.
const WITHIN: f32 = 0.15;
/// Environment pictures after which all of the environment has probably been seen.
const CHECKED_AFTER: u32 = 20;
/// Least distance of a lamp, and largest one at which a direction is compared with a window, metres.
const NEAREST: f32 = 0.05;
const FARTHEST: f64 = 1e4;

/// A stated light.
enum StatedLight {
    /// A lamp at a place.
    Lamp(DVec3),
    /// A rectangle: its middle, and the vectors from there to the middles of two sides.
    Window(DVec3, [DVec3; 2], LampPlane),
}

/// The stated lights.
pub(super) struct StatedLights {
    all: Vec<StatedLight>,
    /// Number of pictures.
    pictures: u32,
}

/// Where a source is by what is stated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StatedPlace {
    /// Distance of its middle from where it is seen.
    pub distance: LampDistance,
    /// The plane of the window that it is.
    pub plane: Option<LampPlane>,
}

impl StatedLights {
    pub fn new(all: &[RoomLight]) -> Self {
        Self {
            all: all.iter().map(StatedLight::new).collect(),
            pictures: 0,
        }
    }

    /// Returns where a source is, by the stated light nearest to its direction; `None` if there is none.
    pub fn place(&self, source: &CompactSource, observer: DVec3) -> Option<StatedPlace> {
        let eye = observer + source.viewpoint.as_dvec3();
        let apart = |light: &&StatedLight| light.apart(source.direction, eye);
        let lights = self.all.iter();
        let nearest = lights.min_by(|a, b| apart(a).total_cmp(&apart(b)))?;
        nearest
            .is_at(source, eye)
            .then(|| nearest.place(source.direction, eye))
    }

    /// Warns once of stated lights that nothing is seen of.
    pub fn check(&mut self, sources: &[CompactSource], observer: DVec3) {
        self.pictures = self.pictures.saturating_add(1);
        if self.pictures == CHECKED_AFTER {
            for at in self.in_vain(sources, observer) {
                tracing::warn!(
                    "[[room_light]] at {:.2}, {:.2}, {:.2} m: the environment camera sees no light in that \
                     direction, so it has no effect; is the position right, and is the lamp on?",
                    at.x,
                    at.y,
                    at.z
                );
            }
        }
    }

    /// Returns the middles of the stated lights in whose direction there is no source.
    fn in_vain<'a>(
        &'a self,
        sources: &'a [CompactSource],
        observer: DVec3,
    ) -> impl Iterator<Item = DVec3> + 'a {
        let is_seen = move |light: &StatedLight| {
            let eye = |s: &CompactSource| observer + s.viewpoint.as_dvec3();
            sources.iter().any(|s| light.is_at(s, eye(s)))
        };
        let unseen = self.all.iter().filter(move |light| !is_seen(light));
        unseen.map(StatedLight::middle)
    }
}

impl StatedLight {
    fn new(stated: &RoomLight) -> Self {
        match stated {
            RoomLight::Lamp { position } => Self::Lamp(DVec3::from(*position)),
            RoomLight::Window { corners } => {
                let [a, b, c, d] = corners.map(DVec3::from);
                let middle = (a + b + c + d) / 4.0;
                let halves = [(b + c - a - d) / 4.0, (c + d - a - b) / 4.0];
                let normal = halves[0].cross(halves[1]).normalize_or(DVec3::Z);
                let offset = normal.dot(middle);
                Self::Window(middle, halves, LampPlane { normal, offset })
            }
        }
    }

    const fn middle(&self) -> DVec3 {
        match self {
            Self::Lamp(middle) | Self::Window(middle, ..) => *middle,
        }
    }

    /// Where a source in a direction from `eye` is, if it is this one.
    fn place(&self, direction: Vec3, eye: DVec3) -> StatedPlace {
        let (inverse, plane) = match self {
            Self::Lamp(at) => {
                let away = at.distance(eye) as f32;
                (away.max(NEAREST).recip(), None)
            }
            Self::Window(_, _, plane) => {
                let direction = direction.as_dvec3();
                (plane.inverse_from(eye, direction), Some(*plane))
            }
        };
        let distance = LampDistance {
            inverse,
            sigma: 0.0,
        };
        StatedPlace { distance, plane }
    }

    /// The angle from a direction to the nearest point of it, seen from `eye`, radians.
    fn apart(&self, direction: Vec3, eye: DVec3) -> f32 {
        let nearest = match self {
            Self::Lamp(at) => *at,
            Self::Window(middle, halves, plane) => {
                let inverse = plane.inverse_from(eye, direction.as_dvec3());
                let away = f64::from(inverse.max(f32::MIN_POSITIVE))
                    .recip()
                    .min(FARTHEST);
                let beside = eye + direction.as_dvec3() * away - *middle;
                let share =
                    |half: &DVec3| (beside.dot(*half) / half.length_squared()).clamp(-1.0, 1.0);
                *middle + halves.iter().map(|half| *half * share(half)).sum::<DVec3>()
            }
        };
        (nearest - eye).as_vec3().angle_between(direction)
    }

    /// Whether a source is in its direction, seen from `eye`.
    fn is_at(&self, source: &CompactSource, eye: DVec3) -> bool {
        self.apart(source.direction, eye) < source.angular_radius + WITHIN
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(azimuth: f32) -> CompactSource {
        super::super::places::tests::source(1, azimuth)
    }

    #[test]
    fn stated_light_that_nothing_is_seen_of_is_told() {
        let lamp = |position| RoomLight::Lamp { position };
        let stated = StatedLights::new(&[lamp([1.0, 0.0, 0.0]), lamp([0.0, 2.0, 1.0])]);
        let sources = [source(0.1), source(2.0)];
        let told: Vec<DVec3> = stated.in_vain(&sources, DVec3::ZERO).collect();
        assert_eq!(told, [DVec3::new(0.0, 2.0, 1.0)]);
    }

    #[test]
    fn window_is_seen_where_its_rectangle_is() {
        // On the wall x = 2, from y = -1 to 1.
        let corners = [
            [2.0, -1.0, 0.0],
            [2.0, 1.0, 0.0],
            [2.0, 1.0, 1.5],
            [2.0, -1.0, 1.5],
        ];
        let stated = StatedLights::new(&[RoomLight::Window { corners }]);
        for azimuth in [0.0_f32, 0.4, -0.45] {
            let place = stated.place(&source(azimuth), DVec3::ZERO).expect("in it");
            let expected = azimuth.cos() / 2.0;
            assert!(
                (place.distance.inverse - expected).abs() < 1e-6,
                "{place:?}"
            );
            assert!(place.plane.is_some());
        }
        assert_eq!(stated.place(&source(0.8), DVec3::ZERO), None);
        assert_eq!(stated.place(&source(3.1), DVec3::ZERO), None);
    }
}
