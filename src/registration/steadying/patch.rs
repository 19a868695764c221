//! Finds a small patch of one picture in another.
//!
//! Lucas & Kanade 1981 in the inverse compositional form (Baker & Matthews 2004, "Lucas–Kanade 20
//! years on"): the gradients are the template's, so that they are computed once.

use super::luminance::Luminance;
use glam::{DMat2, DVec2};

/// Half the patch's side without its centre, pixels.
pub(super) const RADIUS: usize = 7;
const SIDE: usize = 2 * RADIUS + 1;
const COUNT: usize = SIDE * SIDE;
/// Maximum distance from the predicted place, pixels.
const MAX_SHIFT: f64 = 3.0;
const MAX_ITERATIONS: usize = 12;
/// Shift with which an iteration ends, pixels.
const CONVERGED: f32 = 0.01;
/// Least correlation of the patch with what is found.
const MIN_CORRELATION: f32 = 0.8;
/// Least mean square of the derivative along a direction in which a patch is located, codes² per pixel².
pub(super) const MIN_TEXTURE: f32 = 0.25;
/// Least ratio of the mean squares along both directions, below which the weaker one is lost in the
/// errors of the stronger one.
const MIN_RATIO: f32 = 0.005;
/// Standard deviation of a place beside the picture's noise, pixels: by interpolation and by the
/// surface's shape.
const PLACE_SIGMA: f64 = 0.03;
/// Smallest noise of a value that is believed, codes.
const MIN_NOISE: f32 = 0.3;
/// Factor on the variance of a place because the noise of neighbouring values is correlated: smoothing
/// by (1, 2, 1)/4 in both directions, derivatives by differences.
const CORRELATION: f32 = 3.0;

/// A patch: what a picture shows around a pixel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    /// Luminance, without its mean.
    values: [f32; COUNT],
    /// Its derivatives along x and y.
    gradients: [[f32; 2]; COUNT],
    /// Unit vectors along which the patch can be located, with the sum of the squared derivatives along
    /// them; zero where it can't, as along an edge.
    directions: [([f32; 2], f32); 2],
    /// Square root of the sum of the squared values.
    norm: f32,
}

/// Where a patch is found.
#[derive(Clone, Copy, Debug)]
pub(super) struct Found {
    /// For each direction in which it can be located: a unit vector in the patch, the shift along it
    /// from the predicted place, and its standard deviation, pixels of the patch.
    pub shifts: [Option<(DVec2, f64, f64)>; 2],
}

impl Patch {
    /// Reads the patch around pixel (`x`, `y`); `None` at the picture's edge or without texture.
    pub fn read(picture: &Luminance, [x, y]: [usize; 2]) -> Option<Self> {
        let margin = RADIUS + 1;
        let fits = |at: usize, length: usize| at >= margin && at + margin < length;
        if !fits(x, picture.width) || !fits(y, picture.height) {
            return None;
        }
        let mut values = [0.0; COUNT];
        let mut gradients = [[0.0; 2]; COUNT];
        let mut moments = [0.0_f32; 3];
        for (i, (value, gradient)) in values.iter_mut().zip(&mut gradients).enumerate() {
            let (u, v) = (x + i % SIDE - RADIUS, y + i / SIDE - RADIUS);
            let dx = 0.5 * (picture.at(u + 1, v) - picture.at(u - 1, v));
            let dy = 0.5 * (picture.at(u, v + 1) - picture.at(u, v - 1));
            *value = picture.at(u, v);
            *gradient = [dx, dy];
            moments[0] += dx * dx;
            moments[1] += dx * dy;
            moments[2] += dy * dy;
        }
        let norm = remove_mean(&mut values);
        let [(strong, most), (weak, least)] = eigen(moments);
        let texture = MIN_TEXTURE * COUNT as f32;
        let is_corner = least >= texture.max(MIN_RATIO * most);
        (most >= texture).then_some(Self {
            values,
            gradients,
            directions: [(strong, most), (weak, if is_corner { least } else { 0.0 })],
            norm,
        })
    }

    /// Finds the patch near `predicted`. `axes`: what a pixel of the patch along x and y is in the
    /// picture. `None` if it isn't there. Its brightness and contrast may have changed.
    pub fn find(&self, picture: &Luminance, predicted: DVec2, axes: DMat2) -> Option<Found> {
        let reach = axes.x_axis.abs() + axes.y_axis.abs();
        let margin = reach.max_element() * RADIUS as f64 + 1.0;
        let mut shift = DVec2::ZERO;
        for _ in 0..MAX_ITERATIONS {
            let at = predicted + axes * shift;
            if at.distance(predicted) > MAX_SHIFT || !picture.contains(at, margin) {
                return None;
            }
            let compared = self.compare(picture, at, axes);
            let steps = self.directions.map(|([x, y], squares)| {
                let along = x * compared.along[0] + y * compared.along[1];
                if squares > 0.0 { along / squares } else { 0.0 }
            });
            for (([x, y], _), step) in self.directions.iter().zip(steps) {
                shift -= DVec2::new(f64::from(x * step), f64::from(y * step));
            }
            if steps.iter().all(|s| s.abs() < CONVERGED) {
                let is_seen = compared.correlation >= MIN_CORRELATION;
                return is_seen.then(|| self.found(shift, compared.squares));
            }
        }
        None
    }

    /// Compares the patch with what the picture shows at a place.
    fn compare(&self, picture: &Luminance, at: DVec2, axes: DMat2) -> Comparison {
        let (start, axes) = (at.as_vec2(), axes.as_mat2());
        let mut shown: [f32; COUNT] = std::array::from_fn(|i| {
            let u = (i % SIDE) as f32 - RADIUS as f32;
            let v = (i / SIDE) as f32 - RADIUS as f32;
            picture.sample((start + axes.x_axis * u + axes.y_axis * v).to_array())
        });
        let norm = remove_mean(&mut shown);
        let contrast = self.norm / norm.max(1e-3);
        let (mut along, mut product, mut squares) = ([0.0_f32; 2], 0.0, 0.0);
        for ((shown, value), gradient) in shown.iter().zip(&self.values).zip(&self.gradients) {
            let difference = contrast * shown - value;
            along[0] += gradient[0] * difference;
            along[1] += gradient[1] * difference;
            squares += difference * difference;
            product += shown * value;
        }
        Comparison {
            along,
            squares,
            correlation: product / (self.norm * norm).max(1e-6),
        }
    }

    /// The result for a shift at which `squares` remain of the differences.
    fn found(&self, shift: DVec2, squares: f32) -> Found {
        let noise = (squares / COUNT as f32).max(MIN_NOISE * MIN_NOISE) * CORRELATION;
        Found {
            shifts: self.directions.map(|([x, y], moment)| {
                let direction = DVec2::new(f64::from(x), f64::from(y));
                let variance = f64::from(noise / moment) + PLACE_SIGMA * PLACE_SIGMA;
                (moment > 0.0).then(|| (direction, direction.dot(shift), variance.sqrt()))
            }),
        }
    }
}

/// A patch compared with a picture.
struct Comparison {
    /// Sum of the differences times the derivatives along x and y.
    along: [f32; 2],
    /// Sum of the squared differences.
    squares: f32,
    correlation: f32,
}

/// Unit eigenvectors and eigenvalues of the symmetric matrix (xx, xy, yy), the larger first.
fn eigen([xx, xy, yy]: [f32; 3]) -> [([f32; 2], f32); 2] {
    let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
    let (sin, cos) = angle.sin_cos();
    let [most, least] = eigenvalues([xx, xy, yy]);
    [([cos, sin], most), ([-sin, cos], least)]
}

/// Eigenvalues of the symmetric matrix (xx, xy, yy), the larger first.
pub(super) fn eigenvalues([xx, xy, yy]: [f32; 3]) -> [f32; 2] {
    let (half, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    [half + spread, half - spread]
}

/// Subtracts the mean; returns the square root of the sum of the squares.
fn remove_mean(values: &mut [f32; COUNT]) -> f32 {
    let mean = values.iter().sum::<f32>() / COUNT as f32;
    let mut squares = 0.0;
    for value in values {
        *value -= mean;
        squares += *value * *value;
    }
    squares.sqrt()
}
