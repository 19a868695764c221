//! The paper's light dome: directional lights at fixed texels of the downsampled cube map
//! (Supan 2006, section V C).
//!
//! | lights | texels |
//! |---|---|
//! | 8 | above ground: the 2×2 texels of +Z and the upper half of each side face; else the eight octants |
//! | 24 | 2×2 per face |
//! | 48 | the upper hemisphere of 4×4 per face |
//! | 64 | those, and the 16 texels just below the horizon (dark above ground) |
//! | 96 | 4×4 per face |
//! | 384 | 8×8 per face |

use super::cube::CubeGrid;
use super::light::{DomeLight, LightKind};
use super::place::LightPlace;
use glam::Vec3;
use std::f32::consts::PI;

/// Numbers of lights of the available grids.
pub const GRID_SIZES: [usize; 6] = [8, 24, 48, 64, 96, 384];

/// Assigns the texels of a fine map to the lights of a regular grid.
#[derive(Clone, Debug)]
pub struct DomeGrid {
    directions: Vec<Vec3>,
    /// Light of every fine texel; `u16::MAX` for none.
    light_of_texel: Vec<u16>,
    ground: bool,
}

impl DomeGrid {
    /// Creates the largest grid of at most `budget` lights (at least 8) for a fine map `fine`. With
    /// `ground`, everything below the horizon is dropped.
    #[must_use]
    pub fn new(budget: usize, ground: bool, fine: &CubeGrid) -> Self {
        let size = GRID_SIZES
            .into_iter()
            .rev()
            .find(|&n| n <= budget)
            .unwrap_or(GRID_SIZES[0]);
        let directions = grid_directions(size, ground);
        let light_of_texel = fine
            .directions
            .iter()
            .map(|d| {
                let below = ground && d.z <= 0.0;
                if below {
                    u16::MAX
                } else {
                    nearest(&directions, *d, size, ground)
                }
            })
            .collect();
        Self {
            directions,
            light_of_texel,
            ground,
        }
    }

    /// Returns the lights of a fine map. With ground, their irradiance on it adds up to exactly
    /// that of the map's upper hemisphere, per channel.
    #[must_use]
    pub fn lights(&self, texels: &[Vec3], fine: &CubeGrid) -> Vec<DomeLight> {
        let mut sums = vec![(Vec3::ZERO, 0.0f32); self.directions.len()];
        for ((&k, l), w) in self
            .light_of_texel
            .iter()
            .zip(texels)
            .zip(&fine.solid_angles)
        {
            if let Some(sum) = sums.get_mut(k as usize) {
                sum.0 += *l * *w;
                sum.1 += w;
            }
        }
        let mut lights: Vec<DomeLight> = self
            .directions
            .iter()
            .zip(sums)
            .map(|(&direction, (irradiance, solid_angle))| DomeLight {
                direction,
                irradiance,
                angular_radius: (solid_angle / PI).sqrt(),
                kind: LightKind::Cell,
                place: LightPlace::FAR,
            })
            .collect();
        if self.ground {
            normalise(&mut lights, ground_irradiance(texels, fine));
        }
        lights
    }
}

/// Returns the irradiance of the upper hemisphere on level ground, by numerical integration.
#[must_use]
pub fn ground_irradiance(texels: &[Vec3], grid: &CubeGrid) -> Vec3 {
    super::harmonics::irradiance_of(Vec3::Z, &grid.directions, &grid.solid_angles, texels)
}

/// Scales lights so that their total irradiance on the ground is `target`, per channel.
pub fn normalise(lights: &mut [DomeLight], target: Vec3) {
    let sum: Vec3 = lights
        .iter()
        .map(|l| l.irradiance * l.direction.z.max(0.0))
        .sum();
    let scale = Vec3::select(sum.cmpgt(Vec3::splat(1e-12)), target / sum, Vec3::ONE);
    for light in lights {
        light.irradiance *= scale;
    }
}

fn grid_directions(size: usize, ground: bool) -> Vec<Vec3> {
    let side = |n: u32| CubeGrid::new(n).directions;
    match size {
        8 if ground => side(2)[16..20]
            .iter()
            .copied()
            .chain(
                [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y]
                    .map(|d| (d + Vec3::Z * 0.5).normalize()),
            )
            .collect(),
        8 => (0..8)
            .map(|i| {
                let sign = |bit: u32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
                Vec3::new(sign(0), sign(1), sign(2)).normalize()
            })
            .collect(),
        24 => side(2),
        48 => side(4).into_iter().filter(|d| d.z > 0.0).collect(),
        64 => {
            let all = side(4);
            let upper = all.iter().filter(|d| d.z > 0.0);
            // The first row of the side faces below the horizon: |z| is a quarter of the largest
            // component.
            let below = all
                .iter()
                .filter(|d| d.z < 0.0 && -d.z < 0.3 * d.abs().max_element());
            upper.chain(below).copied().collect()
        }
        96 => side(4),
        _ => side(8),
    }
}

/// Returns the light whose texel contains a direction. All grids except that of 64 divide the
/// requested directions into the texels nearest to each light.
fn nearest(directions: &[Vec3], d: Vec3, size: usize, ground: bool) -> u16 {
    let n = match size {
        24 => 2,
        48 | 64 | 96 => 4,
        384 => 8,
        _ => return nearest_of_eight(directions, d, ground),
    };
    let grid_direction = texel_centre(n, d);
    directions
        .iter()
        .position(|l| l.dot(grid_direction) > 0.9999)
        .map_or(u16::MAX, |i| i as u16)
}

fn nearest_of_eight(directions: &[Vec3], d: Vec3, ground: bool) -> u16 {
    let (face, ..) = super::cube::locate(d);
    let k = if !ground {
        return octant(directions, d);
    } else if face == 4 {
        return octant(&directions[..4], d);
    } else {
        4 + face
    };
    k as u16
}

fn octant(directions: &[Vec3], d: Vec3) -> u16 {
    let dots = directions.iter().map(|l| l.dot(d)).enumerate();
    dots.max_by(|a, b| a.1.total_cmp(&b.1))
        .map_or(u16::MAX, |(i, _)| i as u16)
}

fn texel_centre(n: u32, d: Vec3) -> Vec3 {
    let (face, s, t) = super::cube::locate(d);
    let centre =
        |v: f32| (f64::from((v * n as f32).min(n as f32 - 1.0).floor()) + 0.5) / f64::from(n);
    super::cube::face_direction(face, centre(s), centre(t)).as_vec3()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_have_the_requested_number_of_lights() {
        for size in GRID_SIZES {
            for ground in [true, false] {
                assert_eq!(grid_directions(size, ground).len(), size, "{size} {ground}");
            }
        }
    }

    #[test]
    fn the_lights_add_up_to_the_ground_irradiance() {
        let fine = CubeGrid::new(32);
        let texels: Vec<Vec3> = fine
            .directions
            .iter()
            .map(|d| Vec3::new(1.0, d.x + 1.5, d.y * d.y + d.z.max(0.0)))
            .collect();
        let expected = ground_irradiance(&texels, &fine);
        for size in GRID_SIZES {
            let lights = DomeGrid::new(size, true, &fine).lights(&texels, &fine);
            let sum: Vec3 = lights
                .iter()
                .map(|l| l.irradiance * l.direction.z.max(0.0))
                .sum();
            assert!(
                ((sum - expected) / expected).abs().max_element() < 1e-5,
                "{size}: {sum} {expected}"
            );
        }
    }

    #[test]
    fn constant_sphere_is_preserved_without_ground() {
        let fine = CubeGrid::new(32);
        let texels = vec![Vec3::ONE; fine.directions.len()];
        for size in [8, 24, 96, 384] {
            let lights = DomeGrid::new(size, false, &fine).lights(&texels, &fine);
            let sum: f32 = lights.iter().map(|l| l.irradiance.x).sum();
            assert!((sum - 4.0 * PI).abs() < 1e-3, "{size}: {sum}");
        }
    }
}
