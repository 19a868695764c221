//! Helpers shared by the cases: a picture, a camera, times of passes.

use super::percentiles::Percentiles;
use super::report::PassTime;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::PinholeCamera;
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;

/// Warm-up frames: drivers compile and caches fill.
pub(super) const WARM_UP: u32 = 5;

/// Times of each pass over all frames, in the passes' order.
#[derive(Default)]
pub(super) struct Passes(Vec<(&'static str, Vec<f64>)>);

impl Passes {
    pub fn add(&mut self, times: &[(&'static str, f64)]) {
        for (name, ms) in times {
            match self.0.iter_mut().find(|(n, _)| n == name) {
                Some((_, values)) => values.push(*ms),
                None => self.0.push((name, vec![*ms])),
            }
        }
    }

    pub fn medians(&self) -> Vec<PassTime> {
        self.0
            .iter()
            .map(|(name, values)| PassTime {
                name,
                ms: Percentiles::from_values(values).p50,
            })
            .collect()
    }
}

/// Returns a picture that is textured everywhere, so that it costs as much as a real one.
pub(super) fn picture(width: u32, height: u32) -> Picture {
    let rgba = (0..width * height)
        .flat_map(|i| {
            let (x, y) = (i % width, i / width);
            let v = 96 + ((x * 7 + y * 13) % 64) as u8;
            [v, v.wrapping_add(10), v.wrapping_sub(12), 255]
        })
        .collect();
    Picture {
        width,
        height,
        rgba,
    }
}

pub(super) fn camera(width: u32, height: u32) -> PinholeCamera {
    let focal = f64::from(width) * 1.1;
    PinholeCamera {
        width,
        height,
        focal: DVec2::splat(focal),
        centre: DVec2::new(f64::from(width - 1), f64::from(height - 1)) / 2.0,
        distortion: [0.0; 5],
    }
}

/// Returns the upright pose at `eye` that looks towards `at`.
pub(super) fn look_at(eye: DVec3, at: DVec3) -> RigidTransform {
    let forward = (at - eye).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let down = forward.cross(right);
    let rotation = DQuat::from_mat3(&glam::DMat3::from_cols(right, down, forward));
    RigidTransform::new(rotation, eye)
}
