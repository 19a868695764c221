//! Virtual objects in the picture of a lens with distortion.

use crate::soft_dots;
use crate::stage::{Stage, flat, lighting, looking_from, noise, painted, spiral};
use glam::{DVec2, DVec3, Vec3, Vec4};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_compositor::LensOutput;
use penumbra_picture::Picture;
use penumbra_scene::{Material, primitives};

/// Barrel, pincushion, a wide lens with tangential terms, one whose distortion reverses, a strong
/// pincushion, and one with all terms.
const LENSES: [[f64; 5]; 6] = [
    [-0.32, 0.12, 0.0, 0.0, -0.02],
    [0.22, -0.04, 0.0, 0.0, 0.0],
    [-0.28, 0.09, 0.004, -0.003, 0.0],
    [-0.45, 0.35, -0.001, 0.002, -0.08],
    [0.25, 0.0, -0.002, 0.001, 0.03],
    [-0.12, 0.02, 0.006, 0.005, 0.01],
];
const SIZE: (u32, u32) = (320, 240);

fn lens(distortion: [f64; 5]) -> PinholeCamera {
    PinholeCamera {
        width: SIZE.0,
        height: SIZE.1,
        focal: DVec2::new(230.0, 232.0),
        centre: DVec2::new(157.3, 121.6),
        distortion,
    }
}

/// One metre above an emissive table: camera (x, y, 1) is world (x, −y, 0).
fn stage(distortion: [f64; 5]) -> Stage {
    let mut stage = Stage::new(SIZE.0, SIZE.1).without_ground();
    stage.camera = lens(distortion);
    stage.pose = Some(looking_from(DVec3::Z, DVec3::ZERO));
    stage.picture = flat(SIZE.0, SIZE.1, [0, 0, 0]);
    stage.lit(lighting(spiral(8, 2.0), 0.5))
}

/// An emissive material that reflects no light.
fn emissive() -> Material {
    Material {
        base_colour: Vec4::new(0.0, 0.0, 0.0, 1.0),
        emissive: Vec3::splat(0.7),
        specular: 0.0,
        ..Material::default()
    }
}

fn light_of(picture: &Picture, x: i64, y: i64) -> f64 {
    let inside = (0..i64::from(SIZE.0)).contains(&x) && (0..i64::from(SIZE.1)).contains(&y);
    let i = 4 * (y * i64::from(SIZE.0) + x) as usize;
    if inside {
        let response = Response::srgb();
        let linear = |code: u8| f64::from(response.linear_from_code()[code as usize]);
        linear(picture.rgba[i]) / linear((response.encoded_from_linear(0.7) * 255.0).round() as u8)
    } else {
        0.0
    }
}

/// The point on the plane z = 1 that a pixel shows, by Newton's method in 2-D.
fn plane_point(camera: &PinholeCamera, pixel: DVec2) -> DVec2 {
    let mut p = (pixel - camera.centre) / camera.focal;
    let shown = |p: DVec2| camera.project(p.extend(1.0)).unwrap();
    for _ in 0..60 {
        let (e, off) = (1e-6, pixel - shown(p));
        let across = (shown(p + DVec2::X * e) - shown(p - DVec2::X * e)) / (2.0 * e);
        let down = (shown(p + DVec2::Y * e) - shown(p - DVec2::Y * e)) / (2.0 * e);
        let step = DVec2::new(off.perp_dot(down), across.perp_dot(off)) / across.perp_dot(down);
        // From the corners of a strong lens full steps overshoot.
        p += 0.5 * step;
    }
    p
}

/// Root mean square and maximum error of the centres of dots over the entire picture, pixels; the
/// dots are ten pixels wide and eight from the picture's edges.
fn dot_errors(distortion: [f64; 5]) -> (f64, f64) {
    const ACROSS: i32 = 9;
    let camera = lens(distortion);
    let shown = |p: DVec2| camera.project(p.extend(1.0)).unwrap();
    // World y is the camera's −y.
    let seen = |world: DVec3| shown(DVec2::new(world.x, -world.y));
    let mut stage = stage(distortion);
    let mut dots = Vec::new();
    for (i, j) in (0..ACROSS).flat_map(|j| (0..ACROSS).map(move |i| (i, j))) {
        let share = DVec2::new(f64::from(i), f64::from(j)) / f64::from(ACROSS - 1);
        let size = DVec2::new(f64::from(SIZE.0), f64::from(SIZE.1));
        let p = plane_point(&camera, DVec2::splat(8.3) + share * (size - 17.7));
        let e = 1e-4;
        let across = (shown(p + DVec2::X * e) - shown(p - DVec2::X * e)) / (2.0 * e);
        let down = (shown(p + DVec2::Y * e) - shown(p - DVec2::Y * e)) / (2.0 * e);
        let side = 10.0 / across.perp_dot(down).sqrt();
        let at = DVec3::new(p.x, -p.y, 0.0);
        stage = stage.with_virtual(soft_dots::dot(side, at));
        dots.push(soft_dots::truth(side, at, seen));
    }
    let out = stage.compose();
    let off = |truth: &DVec2| soft_dots::found(&out, *truth, 9) - *truth;
    let off: Vec<DVec2> = dots.iter().map(off).collect();
    let mean = off.iter().sum::<DVec2>() / off.len() as f64;
    println!("{distortion:?}: {:.4} {:.4} px on average", mean.x, mean.y);
    soft_dots::rms_and_worst(&off.iter().map(|o| o.length()).collect::<Vec<_>>())
}

/// The limit without a lens is the error of the measurement itself, nearly all of it the same for
/// all dots.
#[test]
fn dots_lie_at_their_distorted_positions_over_the_entire_picture() {
    let (rms, baseline) = dot_errors([0.0; 5]);
    println!("without a lens: {rms:.4} px root mean square, worst {baseline:.4} px");
    assert!(baseline < 0.06, "{baseline} px");
    for distortion in LENSES {
        let (rms, worst) = dot_errors(distortion);
        println!("{distortion:?}: {rms:.4} px root mean square, worst {worst:.4} px");
        assert!(worst < 0.1, "{distortion:?}: {worst} px");
    }
}

/// Tilt of the table: its edge crosses the samples of a row at all phases within 16 rows, where the
/// lens does not bend it upright.
const TILT: f64 = 0.0625;
/// Number of rows that are averaged.
const ROWS: usize = 32;

/// Column at which the table's edge, `edge` to the right of the centre, crosses a row.
fn crossing(camera: &PinholeCamera, edge: f64, row: f64) -> f64 {
    let shown = |along: f64| {
        let right = DVec2::from_angle(TILT).rotate(DVec2::new(2.0, along));
        let world = DVec2::new(edge - 2.0, 0.0) + right;
        camera.project(DVec3::new(world.x, -world.y, 1.0)).unwrap()
    };
    let (mut low, mut high) = (-0.8, 0.6);
    for _ in 0..60 {
        let centre = 0.5 * (low + high);
        if shown(centre).y > row {
            low = centre
        } else {
            high = centre
        }
    }
    shown(low).x
}

/// Error of the edge of a table of two triangles (maximum over means of 32 rows), and its curvature
/// by the lens, pixels.
fn edge_error(distortion: [f64; 5], x_pixel: f64) -> (f64, f64) {
    let camera = lens(distortion);
    let edge = plane_point(&camera, DVec2::new(x_pixel, 120.0)).x;
    let at = DVec3::new(edge - 2.0, 0.0, 0.0);
    let mut table = painted(primitives::plane(4.0, 8.0), at, emissive());
    table.world_from_part *= glam::DMat4::from_rotation_z(TILT);
    let out = stage(distortion).with_virtual(table).compose();
    let mut off = Vec::new();
    let mut edges = Vec::new();
    for y in 2..i64::from(SIZE.1) - 2 {
        let truth = crossing(&camera, edge, y as f64);
        if !(12.0..f64::from(SIZE.0) - 12.0).contains(&truth) {
            continue;
        }
        let near = truth.round() as i64;
        let light: f64 = (near - 8..near + 8).map(|x| light_of(&out, x, y)).sum();
        off.push((near - 8) as f64 - 0.5 + light - truth);
        edges.push(truth);
    }
    let mean = |rows: &[f64]| (rows.iter().sum::<f64>() / rows.len() as f64).abs();
    let worst = off.windows(ROWS).map(mean).fold(0.0, f64::max);
    assert!(edges.len() > 2 * ROWS);
    let (first, centre, last) = (edges[0], edges[edges.len() / 2], edges[edges.len() - 1]);
    (worst, (centre - 0.5 * (first + last)).abs())
}

/// The case without a lens shows the error of the measurement itself.
#[test]
fn edge_of_two_triangles_follows_the_distortion() {
    for distortion in [[0.0; 5]].into_iter().chain(LENSES) {
        for x_pixel in [40.0, 150.0, 270.0] {
            let (worst, bend) = edge_error(distortion, x_pixel);
            println!("{distortion:?}: an edge bent by {bend:.1} px is off by {worst:.4} px");
            assert!(worst < 0.1, "{distortion:?} {x_pixel}: {worst} px");
        }
    }
}

#[test]
fn pixels_without_virtual_change_keep_the_cameras_codes() {
    for distortion in LENSES {
        let mut stage = stage(distortion);
        stage.picture = noise(SIZE.0, SIZE.1);
        assert!(stage.compose() == stage.picture);
        let dot = primitives::plane(0.1, 0.1);
        let with = stage.with_virtual(painted(dot, DVec3::ZERO, emissive()));
        let out = with.compose();
        let changed = |i: usize| out.rgba[4 * i..4 * i + 4] != with.picture.rgba[4 * i..4 * i + 4];
        let pixels = (SIZE.0 * SIZE.1) as usize;
        let count = (0..pixels).filter(|i| changed(*i)).count();
        assert!((300..900).contains(&count), "{count}");
        for i in (0..pixels).filter(|i| changed(*i)) {
            let (x, y) = (i as f64 % f64::from(SIZE.0), (i / SIZE.0 as usize) as f64);
            let off = DVec2::new(x, y) - with.camera.centre;
            assert!(off.abs().max_element() < 15.0, "{off}");
        }
    }
}

#[test]
fn undistorted_picture_has_straight_edges_and_the_cameras_focal_length() {
    let distortion = LENSES[0];
    let stage = stage(distortion).with_virtual(painted(
        primitives::plane(4.0, 8.0),
        DVec3::new(0.3 - 2.0, 0.0, 0.0),
        emissive(),
    ));
    let mut compositor = stage.compositor();
    compositor.set_lens_output(LensOutput::Undistorted);
    let out = stage.compose_with(&mut compositor);
    assert_eq!((out.width, out.height), SIZE);
    let truth = stage.camera.centre.x + 0.3 * stage.camera.focal.x;
    for y in 2..i64::from(SIZE.1) - 2 {
        let light: f64 = (0..i64::from(SIZE.0)).map(|x| light_of(&out, x, y)).sum();
        assert!(
            (light - 0.5 - truth).abs() < 0.13,
            "{y}: {light} for {truth}"
        );
    }
}
