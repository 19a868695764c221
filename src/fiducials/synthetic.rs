//! Renders pictures of tags, for tests and examples: each pixel is the mean of the linear light over
//! its square.

use crate::family::Family;
use crate::map::Tag;
use glam::{DVec2, DVec3};
use penumbra_camera::{PinholeCamera, Response};
use penumbra_interface::RigidTransform;

/// A typical camera of 640×480 pixels.
pub fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 640,
        height: 480,
        focal: DVec2::new(600.0, 605.0),
        centre: DVec2::new(318.0, 243.0),
        distortion: [0.0; 5],
    }
}

/// Reflectance at a position of a tag (−1 to 1 within the border); `None` beyond its white margin.
fn paint(tag: &Tag, p: DVec2) -> Option<f64> {
    let n = tag.family.modules();
    let module = |v: f64| ((v + 1.0) * 0.5 * f64::from(n)).floor() as i64;
    let (x, y) = (module(p.x), module(p.y));
    let last = i64::from(n) - 1;
    if x < -1 || y < -1 || x > last + 1 || y > last + 1 {
        return None;
    }
    if x < 0 || y < 0 || x > last || y > last {
        return Some(0.8);
    }
    let white = tag.family.is_white(tag.id, x as u32, y as u32);
    Some(if white { 0.8 } else { 0.05 })
}

/// Renders tags in front of a grey wall as grey codes, row by row, with Gaussian noise of `noise` codes.
pub fn render(
    camera: &PinholeCamera,
    camera_from_map: RigidTransform,
    tags: &[Tag],
    noise: f64,
) -> Vec<u8> {
    let map_from_camera = camera_from_map.inverse();
    render_rolling(camera, |_| map_from_camera, tags, noise)
}

/// As [`picture`], with a rolling shutter: `map_from_camera` is the pose when a row is read.
pub fn render_rolling(
    camera: &PinholeCamera,
    map_from_camera: impl Fn(f64) -> RigidTransform,
    tags: &[Tag],
    noise: f64,
) -> Vec<u8> {
    let response = Response::srgb();
    let mut random = 0x2545_f491_4f6c_dd1d_u64;
    let mut normal = || {
        let mut sum = 0.0;
        for _ in 0..12 {
            random ^= random << 13;
            random ^= random >> 7;
            random ^= random << 17;
            sum += (random >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum - 6.0
    };
    let light = |pixel: DVec2, map_from_camera: &RigidTransform| {
        let ray = map_from_camera.rotation * camera.unproject(pixel);
        let shown = tags.iter().find_map(|tag| {
            let tag_from_map = tag.map_from_tag.inverse();
            let eye = tag_from_map.transform_point(map_from_camera.translation);
            let ray: DVec3 = tag_from_map.rotation * ray;
            let t = -eye.z / ray.z;
            let hit = (eye + ray * t).truncate() * (2.0 / tag.size);
            if t > 0.0 { paint(tag, hit) } else { None }
        });
        shown.unwrap_or(0.35)
    };
    let mut codes = Vec::new();
    let mut pose = map_from_camera(0.0);
    for (y, x) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (y, x))) {
        let middle = DVec2::new(f64::from(x), f64::from(y));
        if x == 0 {
            pose = map_from_camera(middle.y);
        }
        let shown = mean_over_square(middle, &|pixel| light(pixel, &pose));
        let code = f64::from(response.encoded_from_linear(shown as f32)) * 255.0;
        codes.push((code + noise * normal()).round().clamp(0.0, 255.0) as u8);
    }
    codes
}

/// Mean over a pixel's square. It is uniform if its corners and centre have equal light.
fn mean_over_square(middle: DVec2, light: &impl Fn(DVec2) -> f64) -> f64 {
    const SUB: u32 = 6;
    let corners = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)];
    let flat = light(middle);
    if corners
        .iter()
        .all(|&c| light(middle + DVec2::from(c)) == flat)
    {
        return flat;
    }
    let sub = |k: u32| DVec2::new(f64::from(k % SUB), f64::from(k / SUB));
    let at = |k: u32| middle + (sub(k) + 0.5) / f64::from(SUB) - 0.5;
    let all = (0..SUB * SUB).map(|k| light(at(k)));
    all.sum::<f64>() / f64::from(SUB * SUB)
}

/// A tag of edge `size` (metres) at a position of the map, parallel to its axes.
pub fn tag(id: u32, size: f64, position: DVec3) -> Tag {
    Tag {
        family: Family::Tag36h11,
        id,
        size,
        map_from_tag: RigidTransform::new(glam::DQuat::IDENTITY, position),
    }
}
