//! Small spots in the scene camera's picture that are too bright for it: lamps, and what looks like them.

use crate::light::view::SceneView;
use glam::{DVec2, DVec3};
use penumbra_interface::RigidTransform;
use penumbra_picture::Picture;

/// Code from which a pixel may be clipped.
const CLIPPED: u8 = 250;
/// Columns that are looked at, at most.
const COLUMNS: u32 = 640;
/// Least number of pixels of a spot, and largest share of the picture.
const SIZE: (usize, f64) = (6, 0.02);
/// Least share of its bounding box that a spot fills, and largest ratio of the box's sides.
const ROUND: (f64, f64) = (0.5, 2.0);
/// Most spots in a picture.
const SPOTS: usize = 16;

/// A spot, as the camera sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BrightSpot {
    /// Unit vector to its middle, world.
    pub direction: DVec3,
    /// Half angle of a cone with its size, radians.
    pub radius: f64,
}

/// Finds the spots.
#[derive(Debug, Default)]
pub(super) struct BrightSpots {
    /// The pixels that are looked at, row by row: whether they are clipped and not counted yet.
    bright: Vec<bool>,
    stack: Vec<(u32, u32)>,
    pub found: Vec<BrightSpot>,
}

/// The extent of a connected region.
struct Region {
    count: usize,
    sum: DVec2,
    low: (u32, u32),
    high: (u32, u32),
}

impl BrightSpots {
    /// Finds the spots in a picture that was taken from `pose`, in the order of its rows.
    pub fn find(&mut self, scene: &SceneView<'_>, pose: RigidTransform) {
        let picture = scene.picture;
        let step = picture.width.div_ceil(COLUMNS).max(1);
        let (width, height) = (picture.width / step, picture.height / step);
        self.mark(picture, (width, height), step);
        self.found.clear();
        for y in 0..height {
            for x in 0..width {
                if self.bright[(y * width + x) as usize] && self.found.len() < SPOTS {
                    let region = self.take((x, y), (width, height));
                    let spot = region.spot((width, height), |at| {
                        pose.rotation * scene.camera.unproject(at * f64::from(step))
                    });
                    self.found.extend(spot);
                }
            }
        }
    }

    fn mark(&mut self, picture: &Picture, (width, height): (u32, u32), step: u32) {
        self.bright.clear();
        for y in 0..height {
            let row = (0..width).map(|x| picture.rgb(x * step, y * step));
            self.bright
                .extend(row.map(|rgb| rgb.iter().all(|code| *code >= CLIPPED)));
        }
    }

    /// Takes out the region that a pixel belongs to.
    fn take(&mut self, first: (u32, u32), (width, height): (u32, u32)) -> Region {
        let mut region = Region {
            count: 0,
            sum: DVec2::ZERO,
            low: first,
            high: first,
        };
        self.stack.push(first);
        self.bright[(first.1 * width + first.0) as usize] = false;
        while let Some((x, y)) = self.stack.pop() {
            region.count += 1;
            region.sum += DVec2::new(f64::from(x), f64::from(y));
            region.low = (region.low.0.min(x), region.low.1.min(y));
            region.high = (region.high.0.max(x), region.high.1.max(y));
            for v in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                for u in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                    if std::mem::take(&mut self.bright[(v * width + u) as usize]) {
                        self.stack.push((u, v));
                    }
                }
            }
        }
        region
    }
}

impl Region {
    /// The spot that it is; `None` if it is too small, too large, not round, or not all of it is in the picture.
    fn spot(
        &self,
        (width, height): (u32, u32),
        direction: impl Fn(DVec2) -> DVec3,
    ) -> Option<BrightSpot> {
        let is_inside =
            self.low.0 > 0 && self.low.1 > 0 && self.high.0 + 1 < width && self.high.1 + 1 < height;
        let sides = [self.high.0 - self.low.0, self.high.1 - self.low.1];
        let [a, b] = sides.map(|side| f64::from(side + 1));
        let count = self.count as f64;
        let is_round = count > ROUND.0 * a * b && a.max(b) < ROUND.1 * a.min(b);
        let largest = SIZE.1 * f64::from(width) * f64::from(height);
        let is_right = self.count >= SIZE.0 && count < largest;
        (is_inside && is_round && is_right).then(|| {
            let middle = self.sum / count;
            let radius = (count / std::f64::consts::PI).sqrt();
            let towards = direction(middle).normalize();
            let edge = direction(middle + DVec2::X * radius).normalize();
            BrightSpot {
                direction: towards,
                radius: towards.angle_between(edge),
            }
        })
    }
}
