//! What the step has been shown: the environment camera's pictures laid one over the other, what is
//! bright in them, and what the scene camera saw from where.

use super::super::intrinsics::Grey;
use super::bright::Bright;
use penumbra_camera::Response;
use penumbra_fiducials::TagSeen;
use penumbra_interface::{MonotonicTime, RigidTransform};
use penumbra_picture::Picture;
use penumbra_sync::{HistoryConfig, PoseHistory};

/// Bright pixels are kept of so many pictures.
const MOST_BRIGHT: usize = 60;
/// What the scene camera saw is kept of so many pictures.
const MOST_VIEWS: usize = 400;

/// What a picture of the scene camera showed.
#[derive(Clone, Debug)]
pub struct SceneView {
    /// Middle of the exposure.
    pub at: MonotonicTime,
    /// Since the session's start.
    pub seconds: f64,
    /// Fiducials.
    pub tags: Vec<TagSeen>,
    /// What is bright.
    pub bright: Bright,
    /// `world_from_camera` by markers at known places.
    pub by_markers: Option<RigidTransform>,
}

/// Pictures of a camera that stands still, one over the other.
#[derive(Clone, Debug, Default)]
pub struct Layers {
    /// Width and height.
    pub size: (u32, u32),
    /// How many.
    pub count: u32,
    sum: Vec<f32>,
    brightest: Vec<u8>,
}

impl Layers {
    /// One more; false where its size is another.
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

    /// The mean, red, green and blue, codes.
    #[must_use]
    pub fn planes(&self) -> [Grey; 3] {
        let by = 1.0 / self.count.max(1) as f32;
        [0, 1, 2].map(|c| self.grey(self.sum.chunks_exact(3).map(|p| p[c] * by).collect()))
    }

    /// The mean's luma, codes.
    #[must_use]
    pub fn luma(&self) -> Grey {
        let by = 1.0 / self.count.max(1) as f32;
        let luma = |p: &[f32]| (0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]) * by;
        self.grey(self.sum.chunks_exact(3).map(luma).collect())
    }

    /// The brightest that each pixel ever was: as codes, and in linear light (0 to 255).
    #[must_use]
    pub fn brightest(&self, response: &Response) -> (Grey, Grey) {
        let linear = response.linear_from_code();
        let of = |f: &dyn Fn(u8) -> f32| self.grey(self.brightest.iter().map(|b| f(*b)).collect());
        (
            of(&f32::from),
            of(&|code| 255.0 * linear[usize::from(code)]),
        )
    }

    /// The mean as a picture.
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

/// All of it.
#[derive(Clone, Debug)]
pub struct Gathered {
    /// The environment camera's pictures.
    pub layers: Layers,
    /// What was bright in them, picture by picture.
    pub bright: Vec<Bright>,
    /// Pictures of another size.
    pub other_size: usize,
    /// The scene camera's pictures.
    pub views: Vec<SceneView>,
    /// The tracker's readings.
    pub poses: PoseHistory,
}

impl Default for Gathered {
    fn default() -> Self {
        Self {
            layers: Layers::default(),
            bright: Vec::new(),
            other_size: 0,
            views: Vec::new(),
            poses: PoseHistory::new(HistoryConfig {
                // Ten minutes of a tracker that reads 240 times a second.
                capacity: 150_000,
                ..HistoryConfig::default()
            }),
        }
    }
}

impl Gathered {
    /// A picture of the environment camera.
    pub fn environment(&mut self, picture: &Picture, response: &Response) {
        if !self.layers.add(picture) {
            self.other_size += 1;
        } else if self.bright.len() < MOST_BRIGHT {
            self.bright.push(Bright::of(picture, response));
        }
    }

    /// A picture of the scene camera.
    pub fn scene(&mut self, view: SceneView) {
        if self.views.len() < MOST_VIEWS {
            self.views.push(view);
        }
    }
}
