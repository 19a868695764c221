//! Renders boards through a known lens, for tests.

use super::{Board, Grey};
use crate::board_sheet::pattern;
use crate::sheet::Black;
use glam::{DQuat, DVec2, DVec3};
use penumbra_camera::Lens;
use penumbra_interface::RigidTransform;

pub(crate) use penumbra_numerics::Random;

/// Samples along each side of a pixel.
const SAMPLES: u32 = 3;

/// Renders boards through one lens; computes the rays once for all pictures.
pub(crate) struct BoardRenderer {
    width: u32,
    height: u32,
    rays: Vec<Option<DVec3>>,
    /// Angle between samples, radians.
    spacing: f64,
}

impl BoardRenderer {
    pub fn new(lens: &Lens) -> Self {
        let mut rays = Vec::new();
        for y in 0..lens.height * SAMPLES {
            for x in 0..lens.width * SAMPLES {
                let sample = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                rays.push(lens.unproject(sample / f64::from(SAMPLES) - 0.5));
            }
        }
        Self {
            width: lens.width,
            height: lens.height,
            rays,
            spacing: 1.0 / (lens.focal.x * f64::from(SAMPLES)),
        }
    }

    /// Renders the board on a grey wall, blurred by `blur` pixels, with noise of `noise` codes
    /// (standard deviations).
    pub fn render(&self, board: &Board, pose: RigidTransform, blur: f32, noise: f64) -> Grey {
        let board_from_camera = pose.inverse();
        let origin = board_from_camera.translation;
        let appearance = Appearance::from_board(board);
        let brightness = |ray: Option<DVec3>| {
            let Some(ray) = ray else { return 10.0 };
            let ray = board_from_camera.rotation * ray;
            let t = -origin.z / ray.z;
            if t.is_nan() || t <= 0.0 {
                return 90.0;
            }
            let width = t * self.spacing;
            appearance.at((origin + ray * t).truncate(), width)
        };
        let mut sharp = Grey::from_bytes(self.width as usize, self.height as usize, &[]);
        let wide = self.width * SAMPLES;
        for y in 0..self.height {
            for x in 0..self.width {
                let mut sum = 0.0;
                for j in 0..SAMPLES {
                    for i in 0..SAMPLES {
                        let at = (y * SAMPLES + j) * wide + x * SAMPLES + i;
                        sum += brightness(self.rays[at as usize]);
                    }
                }
                let at = (y * self.width + x) as usize;
                sharp.data[at] = (sum / f64::from(SAMPLES * SAMPLES)) as f32;
            }
        }
        let mut out = if blur > 0.0 {
            sharp.blurred(blur)
        } else {
            sharp
        };
        let mut random = Random::new(pose.translation.x.to_bits() ^ pose.translation.z.to_bits());
        for value in &mut out.data {
            let noisy = f64::from(*value) + noise * random.normal();
            *value = noisy.round().clamp(0.0, 255.0) as f32;
        }
        out
    }
}

/// Number of bins in a row and in a column of a board.
const BINS: f64 = 60.0;

/// Returns the indices of the rectangles in or next to each bin of a board.
fn bins(black: &[Black], size: DVec2) -> Vec<Vec<usize>> {
    let n = BINS as usize;
    let mut bins = vec![Vec::new(); n * n];
    for (i, b) in black.iter().enumerate() {
        let low = DVec2::new(b.x, b.y) / size * BINS - 1.0;
        let high = DVec2::new(b.x + b.width, b.y + b.height) / size * BINS + 1.0;
        let last = DVec2::splat(BINS - 1.0);
        let (low, high) = (low.clamp(DVec2::ZERO, last), high.clamp(DVec2::ZERO, last));
        for y in low.y as usize..=high.y as usize {
            for x in low.x as usize..=high.x as usize {
                bins[y * n + x].push(i);
            }
        }
    }
    bins
}

/// Appearance of a board.
enum Appearance {
    Chess {
        squares: DVec2,
        square: f64,
    },
    Sheet {
        black: Vec<Black>,
        /// Indices of the rectangles near each bin, [`BINS`]² bins.
        bins: Vec<Vec<usize>>,
        size: DVec2,
        origin: DVec2,
    },
}

impl Appearance {
    fn from_board(board: &Board) -> Self {
        match *board {
            Board::Chess {
                columns,
                rows,
                square,
            } => Self::Chess {
                squares: DVec2::new(f64::from(columns) + 1.0, f64::from(rows) + 1.0),
                square,
            },
            _ => {
                let pattern = pattern::from_board(board);
                let size = DVec2::new(pattern.width, pattern.height);
                Self::Sheet {
                    bins: bins(&pattern.black, size),
                    black: pattern.black,
                    size,
                    origin: DVec2::splat(match *board {
                        Board::AprilGrid { tag, gap, .. } => tag * gap,
                        _ => 0.0,
                    }),
                }
            }
        }
    }

    /// Returns the brightness at a position on the board; `width` is that of a sample, metres.
    fn at(&self, p: DVec2, width: f64) -> f64 {
        match self {
            Self::Chess { squares, square } => {
                // Position in squares from the board's outer corner; the first square is dark.
                let p = p / square + 1.0;
                let outside = (p - *squares).max(-p).max_element();
                if outside > 0.7 {
                    90.0
                } else if outside > 0.0 {
                    215.0
                } else {
                    // Each sample averages over its width, so that edges lie between samples.
                    let width = width / square;
                    122.5 - 92.5 * square_wave(p.x, width) * square_wave(p.y, width)
                }
            }
            Self::Sheet {
                black,
                bins,
                size,
                origin,
            } => {
                let p = p + *origin;
                let outside = (p - *size).max(-p).max_element();
                if outside > 0.02 {
                    return 90.0;
                }
                let within = |v: f64, from: f64, wide: f64| {
                    ((v - from).min(from + wide - v) / width + 0.5).clamp(0.0, 1.0)
                };
                let bin = (p / *size * BINS).clamp(DVec2::ZERO, DVec2::splat(BINS - 1.0));
                let near = &bins[bin.y as usize * BINS as usize + bin.x as usize];
                let covered = near
                    .iter()
                    .map(|i| &black[*i])
                    .map(|b| within(p.x, b.x, b.width) * within(p.y, b.y, b.height));
                215.0 - 185.0 * covered.sum::<f64>().min(1.0)
            }
        }
    }
}

/// Returns 1 in even squares, −1 in odd ones, with ramps of `width` between them.
fn square_wave(x: f64, width: f64) -> f64 {
    let sign = if x.rem_euclid(2.0) < 1.0 { 1.0 } else { -1.0 };
    let from_edge = (x - x.round()).abs();
    sign * (2.0 * from_edge / width).min(1.0)
}

/// Returns the pose of a board with its middle at `centre` (camera frame, metres), rotated by
/// `tilt` about X and Y and by `roll` about Z, radians.
pub(crate) fn pose(board: &Board, centre: DVec3, tilt: DVec2, roll: f64) -> RigidTransform {
    let rotation = DQuat::from_rotation_x(tilt.x)
        * DQuat::from_rotation_y(tilt.y)
        * DQuat::from_rotation_z(roll);
    let middle = match *board {
        Board::Chess {
            columns,
            rows,
            square,
        } => DVec2::new(f64::from(columns) - 1.0, f64::from(rows) - 1.0) * 0.5 * square,
        Board::Charuco {
            columns,
            rows,
            square,
            ..
        } => DVec2::new(f64::from(columns), f64::from(rows)) * 0.5 * square,
        Board::AprilGrid {
            columns,
            rows,
            tag,
            gap,
            ..
        } => {
            let tags = DVec2::new(f64::from(columns), f64::from(rows));
            (tags * (1.0 + gap) - gap) * 0.5 * tag
        }
    };
    let middle = middle.extend(0.0);
    RigidTransform::new(rotation, centre - rotation * middle)
}
