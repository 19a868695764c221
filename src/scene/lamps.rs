//! State of virtual lights at one instant.

use crate::virtual_light::{VirtualLight, VirtualLightKey, VirtualLightKind};
use glam::{DVec3, Vec3};
use penumbra_numerics::smoothstep;

/// Maximum number of lamps of a scene.
pub const MAX_LAMPS: usize = 32;

/// A virtual light at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedLamp {
    /// World, metres.
    pub position: Vec3,
    /// Unit vector along which a spot or an area emits, world; arbitrary for a point.
    pub direction: Vec3,
    /// Linear RGB, scene camera units: facing it at r metres the irradiance is
    /// `intensity / r²`.
    pub intensity: Vec3,
    /// Half angles of a spot, radians: full intensity inside the first, zero outside the second.
    pub cone: Option<(f32, f32)>,
    /// Rectangle of an area light.
    pub area: Option<PlacedArea>,
}

/// Rectangle of an area light, perpendicular to the lamp's direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedArea {
    /// From its centre to the middle of its right edge, as seen from in front; world, metres.
    pub half_right: Vec3,
    /// From its centre to the middle of its upper edge; world, metres.
    pub half_up: Vec3,
    /// Whether it emits to both sides.
    pub two_sided: bool,
    /// Index of its lamp in the scene, for its [`Screen`](crate::virtual_light::Screen).
    pub screen: usize,
}

impl PlacedArea {
    /// Area, square metres.
    #[must_use]
    pub fn size(&self) -> f32 {
        4.0 * self.half_right.length() * self.half_up.length()
    }

    /// Corners around `middle`, counter-clockwise as seen from in front.
    #[must_use]
    pub fn corners(&self, middle: Vec3) -> [Vec3; 4] {
        let (r, u) = (self.half_right, self.half_up);
        [-r - u, r - u, r + u, u - r].map(|offset| middle + offset)
    }
}

impl PlacedLamp {
    /// Share of the intensity that is emitted along the unit vector `away`.
    #[must_use]
    pub fn falloff(&self, away: Vec3) -> f32 {
        let Some((beam, cutoff)) = self.cone else {
            return 1.0;
        };
        let angle = self.direction.dot(away).clamp(-1.0, 1.0).acos();
        ((cutoff - angle) / (cutoff - beam).max(1e-6)).clamp(0.0, 1.0)
    }
}

impl VirtualLight {
    /// State of the lamp `seconds` after the session's start; `None` without keys.
    #[must_use]
    pub fn at(&self, seconds: f64) -> Option<PlacedLamp> {
        let seconds = match self.repeat {
            Some(repeat) if repeat > 0.0 => seconds.rem_euclid(repeat),
            _ => seconds,
        };
        let key = key_at(&self.keys, seconds)?;
        let towards = key.target.map(|t| t - key.position);
        let direction = towards.and_then(DVec3::try_normalize);
        let direction = direction.unwrap_or(DVec3::NEG_Z);
        let cone = match self.kind {
            VirtualLightKind::Spot { beam, cutoff } => Some((beam as f32, cutoff as f32)),
            VirtualLightKind::Point | VirtualLightKind::Area { .. } => None,
        };
        Some(PlacedLamp {
            position: key.position.as_vec3(),
            direction: direction.as_vec3(),
            intensity: self.intensity * key.gain as f32,
            cone,
            area: self.area(direction),
        })
    }

    fn area(&self, direction: DVec3) -> Option<PlacedArea> {
        let VirtualLightKind::Area {
            half_size,
            up,
            two_sided,
        } = self.kind
        else {
            return None;
        };
        let right = up.cross(direction).try_normalize();
        let right = right.unwrap_or_else(|| direction.any_orthonormal_vector());
        Some(PlacedArea {
            half_right: (right * half_size.x).as_vec3(),
            half_up: (direction.cross(right) * half_size.y).as_vec3(),
            two_sided,
            screen: 0,
        })
    }
}

/// Interpolates between the keys around `seconds` by smoothstep; constant before the first and after
/// the last.
fn key_at(keys: &[VirtualLightKey], seconds: f64) -> Option<VirtualLightKey> {
    let after = keys.partition_point(|k| k.seconds <= seconds);
    let next = keys.get(after).or(keys.last())?;
    let last = after
        .checked_sub(1)
        .and_then(|i| keys.get(i))
        .unwrap_or(next);
    let span = next.seconds - last.seconds;
    let eased = if span > 0.0 {
        smoothstep(last.seconds, next.seconds, seconds)
    } else {
        0.0
    };
    Some(VirtualLightKey {
        seconds,
        position: last.position.lerp(next.position, eased),
        target: last.target.zip(next.target).map(|(a, b)| a.lerp(b, eased)),
        gain: last.gain + (next.gain - last.gain) * eased,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;

    fn key(seconds: f64, x: f64, gain: f64) -> VirtualLightKey {
        VirtualLightKey {
            seconds,
            position: DVec3::new(x, 0.0, 1.0),
            target: Some(DVec3::new(x, 0.0, 0.0)),
            gain,
        }
    }

    fn spot(keys: Vec<VirtualLightKey>) -> VirtualLight {
        VirtualLight {
            name: "spot".into(),
            kind: VirtualLightKind::Spot {
                beam: 0.4,
                cutoff: 0.6,
            },
            intensity: Vec3::ONE,
            keys,
            repeat: None,
            screen: None,
        }
    }

    #[test]
    fn interpolates_between_keys_by_smoothstep() {
        let lamp = spot(vec![
            key(1.0, 0.0, 1.0),
            key(3.0, 8.0, 3.0),
            key(4.0, 0.0, 0.0),
        ]);
        let x = |t: f64| f64::from(lamp.at(t).unwrap().position.x);
        assert_eq!((x(-5.0), x(1.0), x(2.0), x(3.0)), (0.0, 0.0, 4.0, 8.0));
        // Smoothstep of a quarter is 5/32.
        assert!((x(1.5) - 8.0 * 5.0 / 32.0).abs() < 1e-6);
        assert!((x(3.5) - 4.0).abs() < 1e-6 && x(9.0) == 0.0);
        assert_eq!(lamp.at(2.0).unwrap().intensity, Vec3::splat(2.0));
        assert_eq!(lamp.at(2.0).unwrap().direction, Vec3::NEG_Z);
    }

    #[test]
    fn repeats_its_path() {
        let keys = vec![key(0.0, 0.0, 1.0), key(2.0, 4.0, 1.0)];
        let lamp = VirtualLight {
            repeat: Some(3.0),
            ..spot(keys)
        };
        let x = |t: f64| lamp.at(t).unwrap().position.x;
        assert_eq!((x(1.0), x(2.5), x(4.0), x(-2.0)), (2.0, 4.0, 2.0, 2.0));
    }

    #[test]
    fn lamp_without_keys_has_no_state() {
        assert!(spot(Vec::new()).at(0.0).is_none());
    }

    #[test]
    fn spot_falls_off_linearly_from_beam_to_cutoff() {
        let lamp = spot(vec![key(0.0, 0.0, 1.0)]).at(0.0).unwrap();
        let falloff = |angle: f32| lamp.falloff(Vec3::new(angle.sin(), 0.0, -angle.cos()));
        for (angle, share) in [
            (0.0, 1.0),
            (0.39, 1.0),
            (0.45, 0.75),
            (0.5, 0.5),
            (0.61, 0.0),
        ] {
            assert!((falloff(angle) - share).abs() < 1e-3, "{angle}");
        }
    }

    #[test]
    fn area_is_upright_and_faces_its_target() {
        let kind = VirtualLightKind::Area {
            half_size: glam::DVec2::new(0.4, 0.3),
            up: DVec3::Z,
            two_sided: false,
        };
        let at = DVec3::new(0.0, 2.0, 1.0);
        let key = VirtualLightKey {
            position: at,
            target: Some(DVec3::new(0.0, 0.0, 1.0)),
            ..key(0.0, 0.0, 1.0)
        };
        let lamp = VirtualLight {
            kind,
            ..spot(vec![key])
        };
        let dark = spot(Vec::new());
        let scene = Scene {
            lamps: vec![dark, lamp],
            ..Scene::default()
        };
        let mut lamps = Vec::new();
        scene.lamps_at(0.0, &mut lamps);
        let placed = lamps[0];
        let area = placed.area.unwrap();
        // A viewer at the target looks along +Y; +X is to the right.
        assert!(area.half_right.distance(Vec3::X * 0.4) < 1e-6, "{area:?}");
        assert!(area.half_up.distance(Vec3::Z * 0.3) < 1e-6, "{area:?}");
        assert!(area.screen == 1 && (area.size() - 0.48).abs() < 1e-6);
        let [a, b, c, _] = area.corners(placed.position);
        let normal = (b - a).cross(c - b).normalize();
        assert!(normal.distance(placed.direction) < 1e-6, "{normal}");
    }
}
