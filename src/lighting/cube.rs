//! Cube-map geometry: the texel of a direction, and the solid angle of a texel.

use super::light::CubeMap;
use glam::{DVec3, Vec3};

/// Returns the unit direction of the point (`s`, `t`), each 0..=1, of a face. Faces and orientation
/// as in the table "Major axis direction" of the Vulkan specification (the same as WebGPU's).
#[must_use]
pub fn face_direction(face: usize, s: f64, t: f64) -> DVec3 {
    let (a, b) = (2.0 * s - 1.0, 2.0 * t - 1.0);
    let d = match face {
        0 => DVec3::new(1.0, -b, -a),
        1 => DVec3::new(-1.0, -b, a),
        2 => DVec3::new(a, 1.0, b),
        3 => DVec3::new(a, -1.0, -b),
        4 => DVec3::new(a, -b, 1.0),
        _ => DVec3::new(-a, -b, -1.0),
    };
    d.normalize()
}

/// Returns the face and the coordinates s and t (each 0..=1) of a direction: the inverse of
/// [`face_direction`].
#[must_use]
pub fn locate(d: Vec3) -> (usize, f32, f32) {
    let a = d.abs();
    let (face, major, sc, tc) = if a.x >= a.y && a.x >= a.z {
        if d.x >= 0.0 {
            (0, a.x, -d.z, -d.y)
        } else {
            (1, a.x, d.z, -d.y)
        }
    } else if a.y >= a.z {
        if d.y >= 0.0 {
            (2, a.y, d.x, d.z)
        } else {
            (3, a.y, d.x, -d.z)
        }
    } else if d.z >= 0.0 {
        (4, a.z, d.x, -d.y)
    } else {
        (5, a.z, -d.x, -d.y)
    };
    let half = 0.5 / major.max(f32::MIN_POSITIVE);
    (face, sc * half + 0.5, tc * half + 0.5)
}

/// Returns the index, face-major, of the texel of a direction in a map of `size` texels along a
/// side.
#[must_use]
pub fn texel_of(size: u32, d: Vec3) -> usize {
    let (face, s, t) = locate(d);
    let n = size as usize;
    let x = ((s * size as f32) as usize).min(n - 1);
    let y = ((t * size as f32) as usize).min(n - 1);
    (face * n + y) * n + x
}

/// Solid angle between the face's centre and the corner (`a`, `b`) on the plane at
/// distance 1: the antiderivative of (1 + a² + b²)^(−3/2).
fn corner_solid_angle(a: f64, b: f64) -> f64 {
    (a * b).atan2((a * a + b * b + 1.0).sqrt())
}

/// Every texel's direction and solid angle, face-major like [`CubeMap`].
#[derive(Clone, Debug)]
pub struct CubeGrid {
    /// Texels along a side.
    pub size: u32,
    /// Unit direction of each texel's centre, world.
    pub directions: Vec<Vec3>,
    /// Solid angle of each texel, steradians; their sum is 4π.
    pub solid_angles: Vec<f32>,
}

impl CubeGrid {
    /// Creates the grid of a cube with `size` texels along a side.
    #[must_use]
    pub fn new(size: u32) -> Self {
        let n = f64::from(size);
        let (mut directions, mut solid_angles) = (Vec::new(), Vec::new());
        for face in 0..6 {
            for y in 0..size {
                for x in 0..size {
                    let (s, t) = ((f64::from(x) + 0.5) / n, (f64::from(y) + 0.5) / n);
                    directions.push(face_direction(face, s, t).as_vec3());
                    solid_angles.push(texel_solid_angle(size, x, y) as f32);
                }
            }
        }
        Self {
            size,
            directions,
            solid_angles,
        }
    }

    /// Returns the up to eight neighbours of each texel, across the edges of faces too.
    #[must_use]
    pub fn neighbours(&self) -> Vec<[u32; 8]> {
        let step = 2.0 / self.size as f32;
        self.directions
            .iter()
            .map(|&d| {
                let (right, up) = tangent_frame(d);
                std::array::from_fn(|k| {
                    let angle = k as f32 * std::f32::consts::FRAC_PI_4;
                    // Texels shrink towards a face's corners, to 1/√27 in solid angle: a step of
                    // one texel there is half a step at the centre.
                    let (_, s, t) = locate(d);
                    let (a, b) = (2.0 * s - 1.0, 2.0 * t - 1.0);
                    let reach = step / (1.0 + a * a + b * b).powf(0.75);
                    let moved = d + (right * angle.cos() + up * angle.sin()) * reach * 1.1;
                    texel_of(self.size, moved) as u32
                })
            })
            .collect()
    }
}

/// Returns the solid angle, steradians, of the texel in column `x` and row `y` of any face.
#[must_use]
pub fn texel_solid_angle(size: u32, x: u32, y: u32) -> f64 {
    let edge = |i: u32| 2.0 * f64::from(i) / f64::from(size) - 1.0;
    let (a0, a1, b0, b1) = (edge(x), edge(x + 1), edge(y), edge(y + 1));
    corner_solid_angle(a1, b1) - corner_solid_angle(a0, b1) - corner_solid_angle(a1, b0)
        + corner_solid_angle(a0, b0)
}

/// Sine and cosine of the azimuth of point `k` of a spiral (golden angle): any number of them is evenly spread
/// about its middle.
pub(super) fn spiral(k: usize) -> (f32, f32) {
    const GOLDEN: f32 = 0.381_966;
    (std::f32::consts::TAU * GOLDEN * k as f32).sin_cos()
}

/// Returns two unit vectors that span the plane perpendicular to `d`, the first horizontal.
#[must_use]
pub fn tangent_frame(d: Vec3) -> (Vec3, Vec3) {
    let side = Vec3::Z.cross(d);
    let right = if side.length_squared() > 1e-8 {
        side.normalize()
    } else {
        Vec3::X
    };
    (right, d.cross(right))
}

/// Solid angles of a face's texels, steradians, row by row; each corner is computed once.
fn face_solid_angles(size: u32) -> Vec<f32> {
    let edge = |i: u32| 2.0 * f64::from(i) / f64::from(size) - 1.0;
    let row = |y: u32| (0..=size).map(move |x| corner_solid_angle(edge(x), edge(y)));
    let mut above: Vec<f64> = row(0).collect();
    let mut all = Vec::with_capacity((size * size) as usize);
    for y in 1..=size {
        let below: Vec<f64> = row(y).collect();
        let corners = above.windows(2).zip(below.windows(2));
        all.extend(corners.map(|(a, b)| (b[1] - b[0] - a[1] + a[0]) as f32));
        above = below;
    }
    all
}

/// Returns the next smaller map: each texel is the mean of four, weighted by their solid angles, so
/// that the integral over the sphere is preserved.
#[must_use]
pub fn halve(size: u32, texels: &[Vec3]) -> Vec<Vec3> {
    let half = (size / 2) as usize;
    let n = size as usize;
    let weights = face_solid_angles(size);
    let mut out = Vec::with_capacity(6 * half * half);
    for (face, y, x) in (0..6 * half * half).map(|i| (i / (half * half), i / half % half, i % half))
    {
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let i = (2 * y + dy) * n + 2 * x + dx;
            sum += texels[face * n * n + i] * weights[i];
            total += weights[i];
        }
        out.push(sum / total);
    }
    out
}

/// Samples a level bilinearly within a face (clamped at edges), for previews and tests.
#[must_use]
pub fn sample(map: &CubeMap, level: usize, direction: Vec3) -> Vec3 {
    let Some(texels) = map.levels.get(level) else {
        return Vec3::ZERO;
    };
    let n = (map.size >> level) as usize;
    let (face, s, t) = locate(direction);
    let at = |v: f32| (v * n as f32 - 0.5).clamp(0.0, (n - 1) as f32);
    let (x, y) = (at(s), at(t));
    let (x0, y0) = (x as usize, y as usize);
    let (x1, y1) = ((x0 + 1).min(n - 1), (y0 + 1).min(n - 1));
    let texel = |x: usize, y: usize| Vec3::from(texels[(face * n + y) * n + x]);
    let (fx, fy) = (x - x0 as f32, y - y0 as f32);
    texel(x0, y0)
        .lerp(texel(x1, y0), fx)
        .lerp(texel(x0, y1).lerp(texel(x1, y1), fx), fy)
}

/// Samples a map of `n` texels along a side bilinearly across the edges of faces, as graphics
/// hardware does (except at the corners that only three faces share).
#[must_use]
pub fn sample_seamless(texels: &[[f32; 3]], n: u32, direction: Vec3) -> Vec3 {
    let (face, s, t) = locate(direction);
    let (x, y) = (s * n as f32 - 0.5, t * n as f32 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let texel = |x: f32, y: f32| {
        let (a, b) = ((x + 0.5) / n as f32, (y + 0.5) / n as f32);
        let beyond = !(0.0..=1.0).contains(&a) || !(0.0..=1.0).contains(&b);
        let index = if beyond {
            // The neighbouring face's texel lies where this face's plane continues, at the same
            // distance beyond the edge as it has within the other face.
            texel_of(n, folded(face, f64::from(a), f64::from(b)))
        } else {
            (face * n as usize + y as usize) * n as usize + x as usize
        };
        texels.get(index).map_or(Vec3::ZERO, |t| Vec3::from(*t))
    };
    let row = |y: f32| texel(x0, y).lerp(texel(x0 + 1.0, y), x - x0);
    row(y0).lerp(row(y0 + 1.0), y - y0)
}

/// Direction of a point up to half a texel beyond an edge of a face, folded over the edge.
fn folded(face: usize, s: f64, t: f64) -> Vec3 {
    let (a, b) = (2.0 * s - 1.0, 2.0 * t - 1.0);
    let over = (a.abs() - 1.0).max(b.abs() - 1.0).max(0.0);
    let edge = face_direction(face, s.clamp(0.0, 1.0), t.clamp(0.0, 1.0)).as_vec3();
    let middle = face_direction(face, 0.5, 0.5).as_vec3();
    // From the cube's edge along the neighbouring face, away from this one.
    let on_cube = edge / edge.abs().max_element();
    on_cube - middle * over as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn solid_angles_add_up_to_the_sphere() {
        for size in [1, 2, 7, 64] {
            let sum: f64 = CubeGrid::new(size)
                .solid_angles
                .iter()
                .map(|&w| f64::from(w))
                .sum();
            assert!(
                (sum - 4.0 * std::f64::consts::PI).abs() < 1e-4,
                "{size}: {sum}"
            );
        }
    }

    #[test]
    fn faces_are_oriented_as_specified() {
        // Vulkan, "Cube Map Face Selection": +X has sc = −rz, tc = −ry.
        assert_eq!(locate(Vec3::new(1.0, 0.5, 0.0)), (0, 0.5, 0.25));
        assert_eq!(locate(Vec3::new(0.0, 1.0, 0.5)), (2, 0.5, 0.75));
        assert_eq!(locate(Vec3::new(0.5, 0.0, -1.0)), (5, 0.25, 0.5));
    }

    #[test]
    fn neighbours_are_adjacent() {
        let grid = CubeGrid::new(16);
        for (i, around) in grid.neighbours().iter().enumerate() {
            for &k in around {
                let angle = grid.directions[i].angle_between(grid.directions[k as usize]);
                assert!(angle < 0.3, "{i} {k} {angle}");
            }
            let others = around.iter().filter(|&&k| k as usize != i).count();
            assert!(others >= 6, "texel {i} has {others} neighbours");
        }
    }

    #[test]
    fn face_solid_angles_equal_texel_solid_angles() {
        for (i, w) in face_solid_angles(16).into_iter().enumerate() {
            let alone = texel_solid_angle(16, i as u32 % 16, i as u32 / 16) as f32;
            assert!((w - alone).abs() < 1e-8, "{i}: {w} {alone}");
        }
    }

    #[test]
    fn halving_preserves_integral() {
        let grid = CubeGrid::new(16);
        let texels: Vec<Vec3> = grid
            .directions
            .iter()
            .map(|d| d.abs() * 3.0 + d.x)
            .collect();
        let integral = |g: &CubeGrid, t: &[Vec3]| -> Vec3 {
            t.iter().zip(&g.solid_angles).map(|(l, w)| *l * *w).sum()
        };
        let small = halve(16, &texels);
        let difference = integral(&grid, &texels) - integral(&CubeGrid::new(8), &small);
        assert!(difference.abs().max_element() < 1e-3, "{difference}");
    }

    proptest! {
        #[test]
        fn locate_inverts_face_direction(face in 0usize..6, s in 0.01f64..0.99, t in 0.01f64..0.99) {
            let (f, a, b) = locate(face_direction(face, s, t).as_vec3());
            prop_assert_eq!(f, face);
            prop_assert!((f64::from(a) - s).abs() < 1e-5 && (f64::from(b) - t).abs() < 1e-5);
        }
    }
}
