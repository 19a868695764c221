//! Drawn pictures of tags, for tests: every pixel the mean over its square, in linear light.

use super::{Family, Tag};
use crate::calibration::{PinholeCamera, Response};
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;

/// A usual camera of 640×480.
pub fn camera() -> PinholeCamera {
    PinholeCamera {
        width: 640,
        height: 480,
        focal: DVec2::new(600.0, 605.0),
        centre: DVec2::new(318.0, 243.0),
        distortion: [0.0; 5],
    }
}

/// Reflectance at a place of a tag (−1 to 1 within the border); `None` past its white margin.
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
    let bit = (0..tag.family.bits()).find(|b| {
        let (bx, by) = tag.family.module(*b);
        (i64::from(bx), i64::from(by)) == (x, y)
    });
    let bits = tag.family.bits();
    let word = tag.family.words()[tag.id as usize];
    let white = bit.is_some_and(|b| (word >> (bits - 1 - b)) & 1 == 1);
    Some(if white { 0.8 } else { 0.05 })
}

/// Tags before a grey wall, with noise of so many codes.
pub fn picture(
    camera: &PinholeCamera,
    camera_from_map: RigidTransform,
    tags: &[Tag],
    noise: f64,
) -> Vec<u8> {
    const SUB: u32 = 6;
    let response = Response::srgb();
    let map_from_camera = camera_from_map.inverse();
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
    let light = |pixel: DVec2| {
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
    for (y, x) in (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (y, x))) {
        let mut sum = 0.0;
        for k in 0..SUB * SUB {
            let sub = DVec2::new(f64::from(k % SUB), f64::from(k / SUB));
            let at = (sub + 0.5) / f64::from(SUB) - 0.5;
            sum += light(DVec2::new(f64::from(x), f64::from(y)) + at);
        }
        let code =
            f64::from(response.encoded_from_linear((sum / f64::from(SUB * SUB)) as f32)) * 255.0;
        codes.push((code + noise * normal()).round().clamp(0.0, 255.0) as u8);
    }
    codes
}

/// A tag at a place of the map.
pub fn tag(id: u32, size: f64, place: DVec3) -> Tag {
    Tag {
        family: Family::Tag36h11,
        id,
        size,
        map_from_tag: RigidTransform::new(glam::DQuat::IDENTITY, place),
    }
}
