//! The pictures and poses that the step has received: mean, maximum and bright pixels of the
//! environment camera's pictures, and tags, bright pixels and poses of the scene camera's.

use super::super::intrinsics::Grey;
use super::bright_pixels::BrightPixels;
use penumbra_camera::Response;
use penumbra_fiducials::TagObservation;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_picture::Picture;
use penumbra_sync::{HistoryConfig, PoseHistory};

/// Maximum number of environment pictures whose bright pixels are kept.
const MAX_BRIGHT: usize = 60;
/// Maximum number of scene pictures.
const MAX_VIEWS: usize = 400;

/// Contents of a picture of the scene camera.
#[derive(Clone, Debug)]
pub struct SceneView {
    /// Middle of the exposure.
    pub at: MonotonicTime,
    /// Seconds since the session's start.
    pub seconds: f64,
    /// Fiducials.
    pub tags: Vec<TagObservation>,
    /// Bright pixels.
    pub bright: BrightPixels,
    /// `world_from_camera` from markers at known positions.
    pub by_markers: Option<RigidTransform>,
}

/// Mean and maximum of the pictures of a static camera.
#[derive(Clone, Debug, Default)]
pub struct MeanPicture {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Number of pictures.
    pub count: u32,
    sum: Vec<f32>,
    brightest: Vec<u8>,
}

impl MeanPicture {
    /// Adds a picture; returns false if its size differs.
    pub fn add(&mut self, picture: &Picture) -> bool {
        let size = (picture.width, picture.height);
        if self.count == 0 {
            self.size = size;
            self.sum = vec![0.0; 3 * picture.rgba.len() / 4];
            self.brightest = vec![0; picture.rgba.len() / 4];
        }
        if self.size != size || picture.rgba.len() / 4 != self.brightest.len() {
            return false;
        }
        self.count += 1;
        let pixels = picture.rgba.chunks_exact(4);
        let into = self.sum.chunks_exact_mut(3).zip(&mut self.brightest);
        for (p, (sum, most)) in pixels.zip(into) {
            for (slot, code) in sum.iter_mut().zip(p) {
                *slot += f32::from(*code);
            }
            let luma = (77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2])) >> 8;
            *most = (*most).max(luma as u8);
        }
        true
    }

    fn grey(&self, data: Vec<f32>) -> Grey {
        Grey {
            width: self.size.0 as usize,
            height: self.size.1 as usize,
            data,
        }
    }

    /// Returns the mean of red, green and blue, codes.
    #[must_use]
    pub fn planes(&self) -> [Grey; 3] {
        let by = 1.0 / self.count.max(1) as f32;
        [0, 1, 2].map(|c| self.grey(self.sum.chunks_exact(3).map(|p| p[c] * by).collect()))
    }

    /// Returns the luma of the mean, codes.
    #[must_use]
    pub fn luma(&self) -> Grey {
        let by = 1.0 / self.count.max(1) as f32;
        let luma = |p: &[f32]| (0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]) * by;
        self.grey(self.sum.chunks_exact(3).map(luma).collect())
    }

    /// Returns the maximum of each pixel: as codes, and in linear light (0 to 255).
    #[must_use]
    pub fn brightest(&self, response: &Response) -> (Grey, Grey) {
        let linear = response.linear_from_code();
        let map = |f: &dyn Fn(u8) -> f32| self.grey(self.brightest.iter().map(|b| f(*b)).collect());
        (
            map(&f32::from),
            map(&|code| 255.0 * linear[usize::from(code)]),
        )
    }

    /// Returns the mean as a picture.
    #[must_use]
    pub fn picture(&self) -> Picture {
        let by = 1.0 / self.count.max(1) as f32;
        let code = |v: f32| (v * by).round() as u8;
        let rgba = self
            .sum
            .chunks_exact(3)
            .flat_map(|p| [code(p[0]), code(p[1]), code(p[2]), 255])
            .collect();
        Picture {
            width: self.size.0,
            height: self.size.1,
            rgba,
        }
    }
}

/// Everything the step has received.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// Mean and maximum of the environment camera's pictures.
    pub mean: MeanPicture,
    /// Their bright pixels, picture by picture.
    pub bright: Vec<BrightPixels>,
    /// Number of environment pictures ignored for their differing size.
    pub other_size: usize,
    /// The scene camera's pictures.
    pub views: Vec<SceneView>,
    /// The tracker's readings.
    pub poses: PoseHistory,
}

impl Default for Gathered {
    fn default() -> Self {
        Self {
            mean: MeanPicture::default(),
            bright: Vec::new(),
            other_size: 0,
            views: Vec::new(),
            poses: PoseHistory::new(HistoryConfig {
                // Ten minutes of a tracker with 240 readings per second.
                capacity: 150_000,
                ..HistoryConfig::default()
            }),
        }
    }
}

impl Gathered {
    /// Adds a picture of the environment camera.
    pub fn add_environment_picture(&mut self, picture: &Picture, response: &Response) {
        if !self.mean.add(picture) {
            self.other_size += 1;
        } else if self.bright.len() < MAX_BRIGHT {
            self.bright.push(BrightPixels::new(picture, response));
        }
    }

    /// Adds the contents of a picture of the scene camera.
    pub fn add_scene_view(&mut self, view: SceneView) {
        if self.views.len() < MAX_VIEWS {
            self.views.push(view);
        }
    }
}
