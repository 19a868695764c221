use super::*;
use crate::cube::CubeGrid;
use crate::resample::PixelDirections;
use glam::{DVec2, Quat};
use penumbra_camera::PlacedView;
use penumbra_camera::{EnvironmentView, FisheyeLens};
use penumbra_interface::RigidTransform;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::sync::Arc;

const EVEN: [u32; 4] = [2, 4, 6, 8];

/// A fisheye of 1000² pixels that looks up.
fn pixels() -> PixelDirections {
    let view = EnvironmentView::Fisheye {
        lens: FisheyeLens {
            width: 1000,
            height: 1000,
            focal: 316.0,
            centre: DVec2::new(498.7, 502.1),
            distortion: [0.0; 4],
            max_theta: FRAC_PI_2,
        },
        world_from_camera: RigidTransform::IDENTITY,
    };
    PixelDirections::new(&PlacedView::new(&view, None, None).unwrap(), None)
}

fn light(dome: &GeodesicDome, table: Membership, radiance: Vec<[f32; 3]>) -> FaceLight {
    FaceLight {
        frequency: dome.frequency(),
        membership: Arc::new(table),
        radiance: Arc::new(radiance),
        sources: Vec::new(),
    }
}

/// Uniform random directions of the upper hemisphere, from a fixed seed.
struct Directions(u64);

impl Directions {
    fn number(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005);
        self.0 = self.0.wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform over the cap around the zenith with lowest z `height`.
    fn above(&mut self, height: f64) -> DVec3 {
        let z = height + (1.0 - height) * self.number();
        let (sin, cos) = (TAU * self.number()).sin_cos();
        let level = (1.0 - z * z).sqrt();
        DVec3::new(level * cos, level * sin, z)
    }
}

#[test]
fn dome_of_frequency_two_has_forty_faces() {
    for frequency in EVEN {
        let dome = GeodesicDome::new(frequency).unwrap();
        assert_eq!(dome.faces.len(), 10 * (frequency * frequency) as usize);
        assert!(dome.faces.iter().all(|f| f.centre.z > 0.0));
        assert!(
            dome.faces
                .iter()
                .flat_map(|f| f.corners)
                .all(|c| c.z >= 0.0)
        );
    }
    for refused in [0, 1, 3, 5, 18, u32::MAX] {
        assert!(GeodesicDome::new(refused).is_none(), "{refused}");
    }
}

#[test]
fn solid_angles_add_up_to_the_hemisphere() {
    for frequency in EVEN {
        let dome = GeodesicDome::new(frequency).unwrap();
        let sum: f64 = dome.faces.iter().map(|f| f64::from(f.solid_angle)).sum();
        assert!((sum - TAU).abs() < 1e-5, "{frequency}: {sum}");
        // Counter-clockwise from outside: no face is inverted.
        for face in &dome.faces {
            let [a, b, c] = face.corners;
            assert!(a.dot(b.cross(c)) > 0.0);
            let ratio = f64::from(face.solid_angle) * dome.faces.len() as f64 / TAU;
            assert!((0.6..1.4).contains(&ratio), "{frequency}: {ratio}");
        }
    }
}

/// Bakes store images in this order.
#[test]
fn order_of_faces_is_fixed() {
    let centres = |frequency, numbers: &[usize]| -> Vec<Vec3> {
        let dome = GeodesicDome::new(frequency).unwrap();
        numbers.iter().map(|&k| dome.faces[k].centre).collect()
    };
    let near = |a: &[Vec3], b: &[[f32; 3]]| {
        for (a, b) in a.iter().zip(b) {
            assert!(a.distance(Vec3::from(*b)) < 1e-3, "{a} {b:?}");
        }
    };
    near(&centres(2, &[0, 1, 2, 3, 19, 20, 34, 35, 39]), &ORDER_OF_2);
    near(&centres(4, &[0, 79, 80, 159]), &ORDER_OF_4);
}

const ORDER_OF_2: [[f32; 3]; 9] = [
    [0.2430, 0.1765, 0.9538],
    [0.7445, 0.1765, 0.6439],
    [0.4911, 0.3568, 0.7947],
    [0.3980, 0.6535, 0.6439],
    [0.7445, -0.1765, 0.6439],
    [0.5481, 0.7626, 0.3435],
    [0.5481, -0.7626, 0.3435],
    [0.9875, 0.0000, 0.1579],
    [0.3051, -0.9391, 0.1579],
];
const ORDER_OF_4: [[f32; 3]; 4] = [
    [0.1109, 0.0806, 0.9906],
    [0.8364, -0.0806, 0.5422],
    [0.5737, 0.7994, 0.1786],
    [0.4512, -0.8884, 0.0850],
];

#[test]
fn faces_are_found_by_their_centres() {
    for frequency in [2, 4, 6, 8, MAX_FREQUENCY] {
        let dome = GeodesicDome::new(frequency).unwrap();
        for (k, face) in dome.faces.iter().enumerate() {
            assert_eq!(dome.face_of(face.centre * 3.0), Some(k));
        }
    }
}

#[test]
fn edges_belong_to_the_first_face_and_horizon_to_one() {
    for frequency in EVEN {
        let dome = GeodesicDome::new(frequency).unwrap();
        for (k, face) in dome.faces.iter().enumerate() {
            for (corner, next) in [(0, 1), (1, 2), (2, 0)] {
                let (a, b) = (face.corners[corner], face.corners[next]);
                let found = dome.face_of(a).unwrap();
                let shares = dome.faces[found].corners.contains(&a);
                assert!(shares && found <= k, "{frequency}: {k} {found}");
                let found = dome.face_of(a + b).unwrap();
                let ends = [a, b].map(|end| dome.faces[found].corners.contains(&end));
                assert_eq!(ends, [true; 2], "{frequency}: {k} {found}");
            }
        }
        let level = (0..3600).map(|i| (f64::from(i) * TAU / 3600.0).sin_cos());
        for (sin, cos) in level {
            let d = DVec3::new(cos, sin, 0.0).as_vec3();
            assert!(dome.face_of(d).is_some() && dome.face_of(d.with_z(-1e-30)).is_none());
        }
        for nowhere in [Vec3::ZERO, Vec3::NAN, Vec3::NEG_Z, Vec3::Z * f32::INFINITY] {
            assert_eq!(dome.face_of(nowhere), None);
        }
    }
}

#[test]
fn six_groups_divide_the_hemisphere_evenly() {
    for frequency in EVEN {
        let dome = GeodesicDome::new(frequency).unwrap();
        let groups = dome.six_groups();
        let sizes: Vec<Vec3> = dome
            .faces
            .iter()
            .map(|f| Vec3::splat(f.solid_angle))
            .collect();
        let sums = groups.sums(&sizes).map(|s| f64::from(s.x));
        assert!((sums.iter().sum::<f64>() - TAU).abs() < 1e-4);
        for lower in &sums[1..] {
            assert!((lower - sums[1]).abs() < 1e-5, "{frequency}: {sums:?}");
        }
        for sum in sums {
            assert!((sum * 6.0 / TAU - 1.0).abs() < 0.3, "{frequency}: {sums:?}");
        }
    }
}

#[test]
fn constant_radiance_gives_the_solid_angles() {
    let (pixels, grid) = (pixels(), CubeGrid::new(64));
    for frequency in EVEN {
        let dome = GeodesicDome::new(frequency).unwrap();
        for (directions, sizes) in [
            (&pixels.directions, &pixels.solid_angles),
            (&grid.directions, &grid.solid_angles),
        ] {
            let table = Membership::new(&dome, directions, sizes);
            let radiance = vec![[0.5, 1.0, 7.0]; directions.len()];
            let sums = sum_faces(&light(&dome, table, radiance));
            for (sum, face) in sums.iter().zip(&dome.faces) {
                let expected = Vec3::new(0.5, 1.0, 7.0) * face.solid_angle;
                assert!(((*sum - expected) / expected).abs().max_element() < 1e-6);
            }
        }
    }
}

#[test]
fn weights_are_within_a_hundredth_of_pixel_solid_angles() {
    let pixels = pixels();
    let dome = GeodesicDome::new(2).unwrap();
    let table = Membership::new(&dome, &pixels.directions, &pixels.solid_angles);
    for (pixel, weight) in table.pixels.iter().zip(&table.weights) {
        let own = pixels.solid_angles[*pixel as usize];
        // The faces at the horizon lack the pixels that its rim cuts: 0.6 %.
        assert!((weight / own - 1.0).abs() < 0.01, "{pixel}: {weight} {own}");
    }
    let seen = |(d, w): (&Vec3, &f32)| *w > 0.0 && d.z >= 0.0;
    let rows = pixels.directions.iter().zip(&pixels.solid_angles);
    assert_eq!(table.pixels.len(), rows.filter(|r| seen(*r)).count());
}

#[test]
fn source_of_one_pixel_lies_entirely_in_its_face() {
    let pixels = pixels();
    let dome = GeodesicDome::new(4).unwrap();
    let table = Membership::new(&dome, &pixels.directions, &pixels.solid_angles);
    for (x, y) in [(500, 500), (333, 201), (812, 644), (510, 190), (120, 480)] {
        let i = y * 1000 + x;
        let mut radiance = vec![[0.0; 3]; pixels.directions.len()];
        radiance[i] = [9000.0, 8000.0, 5000.0];
        let sums = sum_faces(&light(&dome, table.clone(), radiance));
        let face = dome.face_of(pixels.directions[i]).unwrap();
        for (k, sum) in sums.iter().enumerate() {
            let whole = if k == face {
                9000.0 * pixels.solid_angles[i]
            } else {
                0.0
            };
            assert!(
                (sum.x - whole).abs() <= 0.02 * whole,
                "({x}, {y}): {k} {sum}"
            );
        }
    }
}

#[test]
fn face_without_pixels_takes_the_nearest() {
    let (dome, grid) = (GeodesicDome::new(MAX_FREQUENCY).unwrap(), CubeGrid::new(4));
    let table = Membership::new(&dome, &grid.directions, &grid.solid_angles);
    let radiance = vec![[2.0; 3]; grid.directions.len()];
    let sums = sum_faces(&light(&dome, table, radiance));
    for (sum, face) in sums.iter().zip(&dome.faces) {
        assert!((sum.x / face.solid_angle - 2.0).abs() < 1e-5);
    }
    // Without any visible pixel there is no light and no failure.
    let nothing = Membership::new(&dome, &grid.directions, &vec![0.0; grid.directions.len()]);
    assert_eq!(nothing.begins.len(), dome.faces.len() + 1);
    assert!(nothing.pixels.is_empty());
}

#[test]
fn rotated_dome_matches_rotated_world() {
    let (dome, grid) = (GeodesicDome::new(4).unwrap(), CubeGrid::new(64));
    let rotation = Quat::from_rotation_y(0.7) * Quat::from_rotation_z(1.1);
    let rotated_directions: Vec<Vec3> = grid.directions.iter().map(|d| rotation * *d).collect();
    let plain = Membership::new(&dome, &grid.directions, &grid.solid_angles);
    let rotated = Membership::rotated(&dome, rotation, &rotated_directions, &grid.solid_angles);
    // Directions on an edge may fall to either side of it.
    let differ = plain.begins.iter().zip(&rotated.begins);
    assert!(differ.clone().all(|(a, b)| a.abs_diff(*b) <= 12));
    assert_ne!(
        plain,
        Membership::new(&dome, &rotated_directions, &grid.solid_angles)
    );
}

/// A sky that brightens towards the horizon and the sun, and the sun.
fn sky(d: DVec3, sun: DVec3) -> DVec3 {
    let glow = d.dot(sun).max(0.0).powi(8);
    let blue = DVec3::new(0.2, 0.4, 0.9) * (1.5 - d.z) + DVec3::new(0.8, 0.7, 0.5) * glow;
    let disc = if d.dot(sun) > SUN_COSINE {
        DVec3::new(400.0, 380.0, 300.0)
    } else {
        DVec3::ZERO
    };
    blue + disc
}

/// Three degrees.
const SUN_COSINE: f64 = 0.998_629_5;

/// Finds the face by the planes through its edges, testing one face after the other.
fn face_by_planes(dome: &GeodesicDome, d: DVec3) -> usize {
    let inside = |f: &Face| {
        let [a, b, c] = f.corners.map(Vec3::as_dvec3);
        [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(p, q)| p.cross(*q).dot(d) >= 0.0)
    };
    dome.faces.iter().position(inside).unwrap()
}

/// Integrates S_i of the sky over 400 000 random directions, and of the sun's disc over 100 000
/// more within it; with the standard errors.
fn monte_carlo(dome: &GeodesicDome, sun: DVec3) -> Vec<(f64, f64)> {
    let mut random = Directions(7);
    let (mut sums, mut squares) = (vec![0.0; dome.faces.len()], vec![0.0; dome.faces.len()]);
    let rotation = glam::DQuat::from_rotation_arc(DVec3::Z, sun);
    for (count, size) in [(400_000, TAU), (100_000, TAU * (1.0 - SUN_COSINE))] {
        for _ in 0..count {
            let whole = count == 400_000;
            let d = if whole {
                random.above(0.0)
            } else {
                rotation * random.above(SUN_COSINE)
            };
            let in_disc = d.dot(sun) > SUN_COSINE;
            // Each direction is counted by one of the two integrations.
            if whole == in_disc {
                continue;
            }
            let (face, value) = (
                face_by_planes(dome, d),
                sky(d, sun).y * size / f64::from(count),
            );
            sums[face] += value;
            squares[face] += value * value;
        }
    }
    sums.into_iter()
        .zip(squares.into_iter().map(f64::sqrt))
        .collect()
}

/// The tolerance is four standard errors of the integration, plus the error of pixels on an edge,
/// which belong to one face entirely: pixels of 0.18° along edges of up to 36° and on the sun's
/// rim, with errors of at most half a pixel, of either sign equally often.
#[test]
fn sums_agree_with_monte_carlo_integration() {
    let pixels = pixels();
    for frequency in [2, 4] {
        let dome = GeodesicDome::new(frequency).unwrap();
        let table = Membership::new(&dome, &pixels.directions, &pixels.solid_angles);
        // Inside a face, and across an edge.
        let face = &dome.faces[27];
        for sun in [face.centre, face.corners[0] + face.corners[1] * 1.1] {
            let sun = sun.as_dvec3().normalize();
            let shown = |d: &Vec3| sky(d.as_dvec3(), sun).as_vec3().to_array();
            let radiance = pixels.directions.iter().map(shown).collect();
            let sums = sum_faces(&light(&dome, table.clone(), radiance));
            for (k, (sum, (expected, error))) in
                sums.iter().zip(monte_carlo(&dome, sun)).enumerate()
            {
                let difference = (f64::from(sum.y) - expected).abs();
                let tolerance = 4.0 * error + 0.01 * expected;
                assert!(
                    difference < tolerance,
                    "{frequency} {k}: {} {expected} {error}",
                    sum.y
                );
            }
        }
    }
}

proptest! {
    #[test]
    fn every_upper_direction_has_a_face(
        height in 0.0f64..1.0, rotation in 0.0f64..TAU, half in 1u32..=8,
    ) {
        let dome = GeodesicDome::new(2 * half).unwrap();
        let level = (1.0 - height * height).sqrt();
        let d = DVec3::new(level * rotation.cos(), level * rotation.sin(), height).as_vec3();
        let found = dome.face_of(d).unwrap();
        let first = dome.faces.iter().position(|f| {
            f.edge_normals().iter().all(|n| n.dot(d.as_dvec3()) >= -ON_EDGE)
        });
        prop_assert_eq!(Some(found), first);
        let centre = dome.faces[found].centre;
        prop_assert!(f64::from(centre.angle_between(d)) < PI / 3.0 / f64::from(half));
    }
}
