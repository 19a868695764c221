//! The three set-ups of the literature, by configuration alone: one camera that sees a mirrored
//! sphere next to a marker, two cameras with a sphere, two cameras with a fisheye. The pictures are
//! synthetic: a table with a marker under a sky with one bright window. The shadow of a virtual box
//! shows whether the direction of the window was estimated.

use crate::program::Desk;
use glam::{DMat3, DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_fiducials::Family;
use penumbra_interface::{Frame, MonotonicTime, PixelFormat};
use penumbra_picture::Picture;
use penumbra_session::{Camera, SessionWriter};
use serde_json::{Value, json};

const SPHERE: DVec3 = DVec3::new(0.13, 0.07, 0.04);
const RADIUS: f64 = 0.04;
const TAG: DVec3 = DVec3::new(-0.12, 0.06, 0.0);
const TAG_SIZE: f64 = 0.09;

/// A camera without lens distortion.
struct Pinhole {
    size: (u32, u32),
    focal: f64,
    eye: DVec3,
    /// Right, down, forward.
    axes: DMat3,
}

fn looking(size: (u32, u32), focal: f64, eye: DVec3, at: DVec3) -> Pinhole {
    let forward = (at - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    Pinhole {
        size,
        focal,
        eye,
        axes: DMat3::from_cols(right, forward.cross(right), forward),
    }
}

impl Pinhole {
    fn json(&self) -> Value {
        let [r, d, f] = self.axes.to_cols_array_2d();
        let e = self.eye;
        let (cx, cy) = self.centre();
        json!({
            "image_size": [self.size.0, self.size.1],
            "K": [[self.focal, 0, cx], [0, self.focal, cy], [0, 0, 1]],
            "T_world_cam": { "matrix_row_major": [
                [r[0], d[0], f[0], e.x], [r[1], d[1], f[1], e.y], [r[2], d[2], f[2], e.z], [0, 0, 0, 1]
            ] },
        })
    }

    fn centre(&self) -> (f64, f64) {
        let middle = |n: u32| 0.5 * (f64::from(n) - 1.0);
        (middle(self.size.0), middle(self.size.1))
    }

    fn draw(&self, window: DVec3, has_sphere: bool) -> Vec<u8> {
        let (cx, cy) = self.centre();
        render(self.size, |pixel| {
            let p = (pixel - DVec2::new(cx, cy)) / self.focal;
            let ray = (self.axes * p.extend(1.0)).normalize();
            seen(self.eye, ray, window, has_sphere)
        })
    }
}

/// Renders grey values, each the mean of 3² samples of its pixel.
fn render((width, height): (u32, u32), light: impl Fn(DVec2) -> f64) -> Vec<u8> {
    let response = Response::srgb();
    let code = |i: u32| {
        let middle = DVec2::new(f64::from(i % width), f64::from(i / width));
        let sample = |k: u32| middle + DVec2::new((k % 3).into(), (k / 3).into()) / 3.0 - 1.0 / 3.0;
        let mean = (0..9).map(|k| light(sample(k))).sum::<f64>() / 9.0;
        (response.encoded_from_linear(mean as f32) * 255.0).round() as u8
    };
    let codes = (0..width * height).map(code);
    codes.flat_map(|c| [c, c, c]).collect()
}

/// Radiance of a sky with one bright window, and of a table below the horizon.
fn sky(ray: DVec3, window: DVec3) -> f64 {
    match ray {
        ray if ray.z < 0.0 => 0.3,
        ray if ray.dot(window) > 25_f64.to_radians().cos() => 0.85,
        _ => 0.06,
    }
}

fn table(place: DVec2) -> f64 {
    // The top of the marker points towards +Y of the world.
    let p = (place - TAG.truncate()) / TAG_SIZE * DVec2::new(1.0, -1.0) + 0.5;
    let n = f64::from(Family::Tag36h11.modules());
    let (x, y) = ((p.x * n).floor(), (p.y * n).floor());
    if x.min(y) < -1.0 || x.max(y) > n {
        return 0.3;
    }
    let border = x.min(y) < 0.0 || x.max(y) >= n;
    let white = border || Family::Tag36h11.is_white(3, x as u32, y as u32);
    if white { 0.7 } else { 0.03 }
}

fn seen(eye: DVec3, ray: DVec3, window: DVec3, has_sphere: bool) -> f64 {
    let from = eye - SPHERE;
    let along = -from.dot(ray);
    let distance_squared = from.length_squared() - along * along;
    if has_sphere && distance_squared < RADIUS * RADIUS {
        let hit = eye + ray * (along - (RADIUS * RADIUS - distance_squared).sqrt());
        let normal = (hit - SPHERE) / RADIUS;
        return 0.9 * sky(ray - 2.0 * ray.dot(normal) * normal, window);
    }
    if ray.z < 0.0 {
        return table((eye - ray * (eye.z / ray.z)).truncate());
    }
    sky(ray, window)
}

fn scene_camera() -> Pinhole {
    let eye = DVec3::new(0.0, -0.45, 0.42);
    looking((640, 480), 700.0, eye, DVec3::new(0.0, 0.03, 0.0))
}

/// Returns the rig.json that all set-ups have in common.
fn rig() -> Value {
    json!({
        "name": "synthetic",
        "scene_camera": scene_camera().json(),
        "ground_plane": {},
        "markers": [{
            "family": "tag36h11", "id": 3, "size_m": TAG_SIZE,
            "T_world_marker": { "matrix_row_major":
                [[1, 0, 0, TAG.x], [0, -1, 0, TAG.y], [0, 0, -1, 0], [0, 0, 0, 1]] },
        }],
    })
}

fn mirror_sphere() -> Value {
    json!({
        "center_world": [SPHERE.x, SPHERE.y, SPHERE.z], "radius": RADIUS,
        "reflectance_rgb": [0.9, 0.9, 0.9], "in_scene_camera_images": false,
    })
}

/// A rig, its environment camera's picture, and whether the scene camera sees the sphere.
type SetUp = (Value, Option<((u32, u32), Vec<u8>)>, bool);

fn one_camera(_: DVec3) -> SetUp {
    let mut rig = rig();
    rig["mirror_sphere"] = mirror_sphere();
    rig["mirror_sphere"]["in_scene_camera_images"] = true.into();
    (rig, None, true)
}

fn camera_and_sphere(window: DVec3) -> SetUp {
    let camera = looking((320, 320), 1300.0, DVec3::new(0.35, -0.2, 0.3), SPHERE);
    let mut rig = rig();
    rig["environment_camera"] = camera.json();
    rig["environment_camera"]["kind"] = "sphere".into();
    rig["environment_camera"]["mirror_sphere"] = mirror_sphere();
    let picture = camera.draw(window, true);
    (rig, Some((camera.size, picture)), false)
}

fn camera_and_fisheye(window: DVec3) -> SetUp {
    const SIZE: u32 = 320;
    const FOCAL: f64 = 100.0;
    let middle = 0.5 * f64::from(SIZE - 1);
    let half = std::f64::consts::FRAC_PI_2;
    let mut rig = rig();
    rig["environment_camera"] = json!({
        "kind": "fisheye", "image_size": [SIZE, SIZE],
        "T_world_cam": { "matrix_row_major":
            [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.06], [0, 0, 0, 1]] },
        "projection": {
            "model": "equidistant", "f": FOCAL, "cx": middle, "cy": middle, "max_theta_rad": half,
        },
    });
    let picture = render((SIZE, SIZE), |pixel| {
        let off = (pixel - middle) / FOCAL;
        let theta = off.length();
        let flat = off.normalize_or_zero() * theta.sin();
        if theta > half {
            return 0.0;
        }
        sky(flat.extend(theta.cos()), window)
    });
    (rig, Some(((SIZE, SIZE), picture)), false)
}

fn frame((width, height): (u32, u32), data: &[u8], sequence: u64) -> Frame {
    let at = MonotonicTime::from_nanos(1_000_000_000 + sequence as i64 * 100_000_000);
    Frame {
        data: data.to_vec().into(),
        format: PixelFormat::Rgb8,
        width,
        height,
        stride: 0,
        sequence,
        captured_at: at,
        arrived_at: at,
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

/// Returns the mean column of the shadow of a 5 cm box on the table, pixels from the picture's centre.
fn shadow(desk: &Desk, name: &str, window: DVec3, set_up: fn(DVec3) -> SetUp) -> f64 {
    let (rig, environment, sees_sphere) = set_up(window);
    let camera = scene_camera();
    let own = camera.draw(window, sees_sphere);
    let session = format!("{name}.mcap");
    let mut writer = SessionWriter::create(&desk.path(&session)).unwrap();
    writer
        .attach("rig.json", rig.to_string().as_bytes())
        .unwrap();
    for k in 0..4 {
        if let Some((size, picture)) = &environment {
            let picture = frame(*size, picture, k);
            writer.frame(Camera::Environment, &picture).unwrap();
        }
        writer
            .frame(Camera::Scene, &frame(camera.size, &own, k))
            .unwrap();
    }
    writer.finish().unwrap();
    let line = "--headless --speed max --listen 127.0.0.1:0 --scene box.toml --light-count 64";
    desk.works(&format!(
        "replay {session} {line} --frames-out {name} --report {name}.json"
    ));
    assert_eq!(
        desk.json(&format!("{name}.json"))["frames"]["without_pose"],
        0
    );
    let out = Picture::from_file_bytes(&desk.read(format!("{name}/00003.png"))).unwrap();
    let (mut sum, mut weight) = (0.0, 0.0);
    for (i, (after, before)) in out.rgba.chunks(4).zip(own.chunks(3)).enumerate() {
        let x = i as f64 % f64::from(camera.size.0) - camera.centre().0;
        let darker = f64::from(before[0]) - f64::from(after[0]);
        // Darker pixels belong to the shadow; the box itself is as bright as the table.
        if darker > 3.0 {
            sum += x * darker;
            weight += darker;
        }
    }
    assert!(weight > 1000.0, "{name}: there is no shadow");
    println!(
        "{name}: shadow {:.1} px from the middle, weight {weight}",
        sum / weight
    );
    sum / weight
}

fn assert_shadow_falls_away_from_the_window(name: &str, set_up: fn(DVec3) -> SetUp) {
    let desk = Desk::new();
    // The box is as bright as the table, so that only its shadow is darker.
    desk.put(
        "box.toml",
        "[[object]]\nshape = \"box\"\nsize_m = [0.05, 0.05, 0.05]\nposition_m = [0.0, -0.03, 0.0]\n",
    );
    let window = |x: f64| DVec3::new(x, 0.2, 0.75).normalize();
    let from_left = shadow(&desk, &format!("{name}-left"), window(-1.0), set_up);
    let from_right = shadow(&desk, &format!("{name}-right"), window(1.0), set_up);
    assert!(
        from_left > 15.0 && from_right < -15.0,
        "{name}: {from_left} {from_right}"
    );
}

#[test]
fn one_camera_with_a_sphere_next_to_a_marker() {
    assert_shadow_falls_away_from_the_window("one", one_camera);
}

#[test]
fn two_cameras_with_a_sphere() {
    assert_shadow_falls_away_from_the_window("sphere", camera_and_sphere);
}

#[test]
fn two_cameras_with_a_fisheye() {
    assert_shadow_falls_away_from_the_window("fisheye", camera_and_fisheye);
}
