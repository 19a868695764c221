//! Tells a matt disc in a picture from a mirrored sphere.

use super::circle::Circle;
use super::harmonics::polynomials;
use glam::{DVec2, DVec3};
use penumbra_camera::Response;
use penumbra_numerics::fixed_size::{Matrix, solve};
use penumbra_numerics::{median, median_absolute, root_mean_square};
use penumbra_picture::Picture;

/// Cells across a disc, whose means are judged: grain and noise do not count.
const CELLS: i32 = 32;
/// Share of the radius up to which a disc is judged; a blurred outline does not count.
const WITHIN: f64 = 0.9;
/// Smaller discs are not judged, pixels.
const MIN_RADIUS: f64 = 8.0;
/// A disc with fewer cells in the picture is not judged.
const MIN_CELLS: usize = 400;
/// Median difference from a matt shade, relative to the median: matt balls have 0.01, a mirror in a
/// room with bare walls 0.04, other mirrors 0.08 to 2.
const MAX_DIFFERENCE: f64 = 0.06;
/// Standard deviation of the logarithm: matt balls with a highlight have 0.3, mirrors whose
/// [`MAX_DIFFERENCE`] is as small as that of matt ones 0.6.
const MAX_LOG_DIFFERENCE: f64 = 0.4;
/// Least light of a cell in its logarithm; 1 is white.
const DARK: f64 = 0.003;

/// Whether a disc is shaded as a matt ball or plate is, and not as a mirrored sphere. What a matt
/// surface reflects depends on its normal by spherical harmonics of the second degree (Ramamoorthi and
/// Hanrahan 2001), whatever lights it; a mirror shows edges. Pictures have sRGB's tone curve here. `false` if the
/// disc is too small or too little of it is in the picture.
#[must_use]
pub fn is_matt(picture: &Picture, circle: Circle) -> bool {
    if circle.radius < MIN_RADIUS {
        return false;
    }
    let light = cells(picture, circle);
    if light.len() < MIN_CELLS {
        return false;
    }
    let log = light.iter().map(|(n, l)| (*n, l.max(DARK).ln()));
    let log: Vec<(DVec3, f64)> = log.collect();
    let found = (robust(&light), differences(&log, &vec![1.0; log.len()]));
    let (Some(from_shade), Some(from_log)) = found else {
        return false;
    };
    let middle = median(light.iter().map(|(_, l)| *l)).unwrap_or_default();
    median_absolute(from_shade) < MAX_DIFFERENCE * middle.max(DARK)
        && root_mean_square(from_log) < MAX_LOG_DIFFERENCE
}

/// Normals and mean luminance (linear, 1 is white) of the cells of a disc.
fn cells(picture: &Picture, circle: Circle) -> Vec<(DVec3, f64)> {
    let response = Response::srgb();
    let size = 2.0 * circle.radius / f64::from(CELLS);
    let cell = |i: i32| {
        let (column, row) = (i % CELLS - CELLS / 2, i / CELLS - CELLS / 2);
        let middle = DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5) * size;
        let at = middle / circle.radius;
        let z = 1.0 - at.length_squared();
        if at.length() > WITHIN {
            return None;
        }
        let low = (circle.centre + middle - 0.5 * size).round().as_ivec2();
        let high = (circle.centre + middle + 0.5 * size).round().as_ivec2();
        let high = high.max(low + 1);
        if low.min_element() < 0 || high.x > picture.width as i32 || high.y > picture.height as i32
        {
            return None;
        }
        let pixels = (low.y..high.y).flat_map(|y| (low.x..high.x).map(move |x| (x, y)));
        let (mut sum, mut n) = (0.0, 0.0);
        for (x, y) in pixels {
            let [r, g, b] = response.linear_from_rgb(picture.rgb(x as u32, y as u32));
            sum += f64::from(0.2126 * r + 0.7152 * g + 0.0722 * b);
            n += 1.0;
        }
        Some((at.extend(z.sqrt()), sum / n))
    };
    (0..CELLS * CELLS).filter_map(cell).collect()
}

/// Differences from the shade that most cells have, whatever the others (highlights, an imprint).
fn robust(cells: &[(DVec3, f64)]) -> Option<Vec<f64>> {
    let mut weights = vec![1.0; cells.len()];
    for _ in 0..10 {
        let found = differences(cells, &weights)?;
        let scale = 1.5 * median(found.iter().map(|d| d.abs()))? + 1e-4;
        weights = found
            .iter()
            .map(|d| 1.0 / (1.0 + (d / scale).powi(2)))
            .collect();
    }
    differences(cells, &weights)
}

fn harmonics(n: &DVec3) -> [f64; 9] {
    polynomials(n.as_vec3()).map(f64::from)
}

/// Differences from the weighted fit of spherical harmonics of the second degree.
fn differences(cells: &[(DVec3, f64)], weights: &[f64]) -> Option<Vec<f64>> {
    let (mut matrix, mut right): (Matrix<9>, [f64; 9]) = ([[0.0; 9]; 9], [0.0; 9]);
    for ((n, value), w) in cells.iter().zip(weights) {
        let basis = harmonics(n);
        for (i, a) in basis.iter().enumerate() {
            right[i] += w * a * value;
            for (j, b) in basis.iter().enumerate() {
                matrix[i][j] += w * a * b;
            }
        }
    }
    let shade = solve(&matrix, &right)?;
    let difference = |(n, value): &(DVec3, f64)| {
        let fitted: f64 = harmonics(n).iter().zip(shade).map(|(a, s)| a * s).sum();
        value - fitted
    };
    Some(cells.iter().map(difference).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_numerics::Random;

    const CIRCLE: Circle = Circle {
        centre: DVec2::new(159.0, 121.0),
        radius: 90.0,
    };

    /// A disc whose light depends on normal and place, on a white wall, with noise of the camera.
    fn picture(light: impl Fn(DVec3, DVec2) -> f64) -> Picture {
        let mut random = Random::new(7);
        let rgba = (0..320u32 * 240).flat_map(|i| {
            let p = DVec2::new(f64::from(i % 320), f64::from(i / 320));
            let at = (p - CIRCLE.centre) / CIRCLE.radius;
            let z = 1.0 - at.length_squared();
            let linear = if z > 0.0 {
                light(at.extend(-z.sqrt()), p)
            } else {
                0.8
            };
            let code = 255.0 * linear.clamp(0.0, 1.0).powf(1.0 / 2.2) + 2.0 * random.normal();
            let code = code.round().clamp(0.0, 255.0) as u8;
            [code, code, code, 255]
        });
        Picture {
            width: 320,
            height: 240,
            rgba: rgba.collect(),
        }
    }

    const LAMP: DVec3 = DVec3::new(-0.48, -0.6, -0.64);

    #[test]
    fn matt_balls_and_plates_are_matt() {
        let diffuse = |n: DVec3| 0.05 + 0.6 * n.dot(LAMP).max(0.0);
        let shiny = |n: DVec3| {
            let mirrored = 2.0 * n * n.z - DVec3::Z;
            diffuse(n) + 0.5 * mirrored.dot(LAMP).max(0.0).powi(60)
        };
        let grained =
            |n: DVec3, p: DVec2| diffuse(n) * (1.0 + 0.1 * (0.4 * p.x).sin() * (0.5 * p.y).cos());
        assert!(is_matt(&picture(|n, _| diffuse(n)), CIRCLE), "a ball");
        assert!(
            is_matt(&picture(|n, _| shiny(n)), CIRCLE),
            "a ball with a highlight"
        );
        assert!(is_matt(&picture(grained), CIRCLE), "a ball with grain");
        assert!(is_matt(&picture(|_, _| 0.5), CIRCLE), "a plate");
    }

    #[test]
    fn mirrors_are_not_matt() {
        let d = |n: DVec3| DVec3::Z - 2.0 * n * n.z;
        let room = |n: DVec3, _: DVec2| {
            let d = d(n);
            let window = d.x < -0.4 && d.x.abs() > d.z.abs() && d.y.abs() < 0.4;
            let wall = if d.x.abs() > d.z.abs() { 0.2 } else { 0.3 };
            match (window, d.y > 0.5) {
                (true, _) => 1.0,
                (false, true) => 0.08,
                (false, false) => wall,
            }
        };
        let meadow = |n: DVec3, _: DVec2| if d(n).y < 0.0 { 0.7 } else { 0.15 };
        assert!(!is_matt(&picture(room), CIRCLE), "a room");
        assert!(
            !is_matt(&picture(meadow), CIRCLE),
            "a meadow under a bright sky"
        );
    }

    #[test]
    fn small_or_absent_discs_are_not_judged() {
        let picture = picture(|_, _| 0.5);
        let outside = Circle {
            centre: DVec2::new(-400.0, 1e9),
            ..CIRCLE
        };
        let tiny = Circle {
            radius: 0.1,
            ..CIRCLE
        };
        assert!(!is_matt(&picture, outside));
        assert!(!is_matt(&picture, tiny));
    }
}
