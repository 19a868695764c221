//! A synthetic session of a chessboard in front of a camera, to be replayed as a live device.

use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::{Lens, LensModel};
use penumbra_interface::{Frame, MonotonicTime, PixelFormat, RigidTransform};
use penumbra_session::{Camera, SessionWriter};
use std::path::Path;

/// The board on the command line: 7×5 inner corners, squares of 30 mm.
pub const BOARD: &str = "chess:7x5:0.03";
/// Focal length of the camera, pixels.
pub const FOCAL: f64 = 300.0;
/// Number of poses of the board.
const POSES: u32 = 24;
/// Pictures of each pose.
const PICTURES: u32 = 2;
/// Time between pictures, nanoseconds.
const SPACING: i64 = 220_000_000;

fn lens() -> Lens {
    let (focal, centre) = (DVec2::splat(FOCAL), DVec2::new(163.0, 118.0));
    let mut lens = Lens::ideal(LensModel::Brown, (320, 240), focal, centre);
    lens.coefficients[0] = -0.12;
    lens
}

/// Grey value of a point on the board's plane, metres from its outer corner.
fn brightness(p: DVec2) -> f64 {
    let (x, y) = (p.x / 0.03, p.y / 0.03);
    let inside = |v: f64, end: f64| (0.0..end).contains(&v);
    if !inside(x, 8.0) || !inside(y, 6.0) {
        let paper = inside(x + 1.0, 10.0) && inside(y + 1.0, 8.0);
        return if paper { 220.0 } else { 110.0 };
    }
    let dark = (x.floor() + y.floor()) % 2.0 == 0.0;
    if dark { 25.0 } else { 220.0 }
}

/// Samples along each side of a pixel.
const SAMPLES: u32 = 3;

/// Viewing directions of all samples, camera coordinates.
fn rays(lens: &Lens) -> Vec<DVec3> {
    let (wide, high) = (SAMPLES * lens.width, SAMPLES * lens.height);
    let ray = |i: u32| {
        let sample = DVec2::new(f64::from(i % wide), f64::from(i / wide)) + 0.5;
        lens.unproject(sample / f64::from(SAMPLES) - 0.5).unwrap()
    };
    (0..wide * high).map(ray).collect()
}

/// Renders the board in grey.
fn picture(lens: &Lens, rays: &[DVec3], camera_from_board: RigidTransform) -> Vec<u8> {
    let board_from_camera = camera_from_board.inverse();
    let eye = board_from_camera.translation;
    let seen = |ray: DVec3| {
        let ray = board_from_camera.rotation * ray;
        let t = -eye.z / ray.z;
        if t > 0.0 {
            brightness((eye + ray * t).truncate())
        } else {
            110.0
        }
    };
    let code = |i: u32| {
        let (x, y) = (i % lens.width, i / lens.width);
        let sample = |k: u32| {
            let row = SAMPLES * y + k / SAMPLES;
            let at = row * SAMPLES * lens.width + SAMPLES * x + k % SAMPLES;
            seen(rays[at as usize])
        };
        let samples = SAMPLES * SAMPLES;
        ((0..samples).map(sample).sum::<f64>() / f64::from(samples)) as u8
    };
    (0..lens.width * lens.height).map(code).collect()
}

/// Pose number `index` of the board (camera from board): over the complete picture, tilted to all sides.
fn pose(index: u32) -> RigidTransform {
    let (column, row) = (index % 5, (index / 5) % 5);
    let (a, b) = (f64::from(column) / 2.0 - 1.0, f64::from(row) / 2.0 - 1.0);
    let tilt = DQuat::from_rotation_x(0.5 * b) * DQuat::from_rotation_y(-0.5 * a);
    let rotation = tilt * DQuat::from_rotation_z(0.25 * a * b + 0.1);
    let at = DVec3::new(0.11 * a, 0.085 * b, 0.46 + 0.05 * a);
    RigidTransform::new(rotation, at - rotation * DVec3::new(0.12, 0.09, 0.0))
}

/// Writes the session to `path`.
pub fn record(path: &Path) {
    let lens = lens();
    let rays = rays(&lens);
    let pictures = (0..POSES).map(|index| picture(&lens, &rays, pose(index)));
    let pictures: Vec<Vec<u8>> = pictures.collect();
    let mut writer = SessionWriter::create(path).unwrap();
    for i in 0..POSES * PICTURES {
        let at = MonotonicTime::from_nanos(1_000_000_000 + SPACING * i64::from(i));
        let frame = Frame {
            data: pictures[(i / PICTURES) as usize].clone().into(),
            format: PixelFormat::Grey8,
            width: lens.width,
            height: lens.height,
            stride: 0,
            sequence: u64::from(i),
            captured_at: at,
            arrived_at: at,
            exposure: None,
            bracket_ev: 0.0,
            controls: None,
        };
        writer.frame(Camera::Scene, &frame).unwrap();
    }
    writer.finish().unwrap();
}
