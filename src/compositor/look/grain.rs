//! A tile of noise with the correlation of the camera's, which repeats without a seam.
//!
//! White noise is filtered along rows and columns by the kernel whose power spectrum is that of the
//! measured correlation; luma and the colour differences are filtered separately and then mixed so
//! that they have the measured covariance.

use penumbra_camera::NoiseTexture;
use penumbra_camera::look::{NOISE_LAGS, OPPONENT_FROM_RGB};
use penumbra_numerics::Random;

/// Texels a side of the tile, a power of two.
pub const SIDE: usize = 256;
/// Standard deviations that the largest code of the tile's texture stands for.
pub const MAX_SIGMAS: f64 = 4.0;
/// Half the length of a filter.
const REACH: usize = 16;
/// Frequencies at which a spectrum is evaluated.
const FREQUENCIES: usize = 64;
/// Fixed seed: the same camera has the same grain in every run.
const SEED: u64 = 0x0067_7261_696e;

/// Returns the tile row by row: red, green and blue with unit variance.
#[must_use]
pub fn tile(texture: &NoiseTexture) -> Vec<[f64; 3]> {
    let mix = mixing(texture);
    let rgb_from_field = multiply(&inverse(&OPPONENT_FROM_RGB), &mix);
    let fields: [Vec<f64>; 3] = std::array::from_fn(|i| {
        let rows = unmixed(&mix, &texture.across, i);
        let columns = unmixed(&mix, &texture.down, i);
        field(&kernel(&rows), &kernel(&columns), SEED + i as u64)
    });
    (0..SIDE * SIDE)
        .map(|k| rgb_from_field.map(|row| (0..3).map(|i| row[i] * fields[i][k]).sum()))
        .collect()
}

/// Returns the lower triangular matrix that gives three independent fields the covariance of Y,
/// B − Y and R − Y (Cholesky); directions without variance are 0.
fn mixing(texture: &NoiseTexture) -> [[f64; 3]; 3] {
    let c = &texture.covariance;
    let mut l = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = if i == j {
                (c[i][i] - sum).max(0.0).sqrt()
            } else if l[j][j] > 1e-6 {
                (c[i][j] - sum) / l[j][j]
            } else {
                0.0
            };
        }
    }
    l
}

/// Returns the correlation of the independent field `i`: that of its colour difference, less the
/// part that comes from the fields before it.
fn unmixed(mix: &[[f64; 3]; 3], lags: &[[f64; NOISE_LAGS]; 3], i: usize) -> [f64; NOISE_LAGS] {
    let mut fields = [[0.0; NOISE_LAGS]; 3];
    for f in 0..=i {
        let own = mix[f][f] * mix[f][f];
        let variance: f64 = mix[f].iter().map(|m| m * m).sum();
        for lag in 0..NOISE_LAGS {
            let before: f64 = (0..f).map(|k| mix[f][k].powi(2) * fields[k][lag]).sum();
            fields[f][lag] = if own > 0.05 * variance {
                ((variance * lags[f][lag] - before) / own).clamp(-1.0, 1.0)
            } else {
                lags[f][lag]
            };
        }
    }
    fields[i]
}

/// Returns the symmetric kernel, from its centre outwards, that gives white noise the correlation
/// `lags` and unit variance. Noise in what was measured may make the spectrum negative: it is cut
/// there.
fn kernel(lags: &[f64; NOISE_LAGS]) -> [f64; REACH + 1] {
    let amplitude = |f: usize| {
        let w = std::f64::consts::TAU * f as f64 / FREQUENCIES as f64;
        let waves = lags
            .iter()
            .zip(1..)
            .map(|(r, k)| 2.0 * r * (w * f64::from(k)).cos());
        (1.0 + waves.sum::<f64>()).max(0.0).sqrt()
    };
    let amplitudes: [f64; FREQUENCIES] = std::array::from_fn(amplitude);
    let mut out: [f64; REACH + 1] = std::array::from_fn(|k| {
        let wave = |f: usize| (std::f64::consts::TAU * (f * k) as f64 / FREQUENCIES as f64).cos();
        let sum: f64 = amplitudes
            .iter()
            .enumerate()
            .map(|(f, a)| a * wave(f))
            .sum();
        sum / FREQUENCIES as f64
    });
    let energy = out[0] * out[0] + 2.0 * out[1..].iter().map(|v| v * v).sum::<f64>();
    out.iter_mut().for_each(|v| *v /= energy.sqrt());
    out
}

/// Returns white noise filtered along rows and columns, with unit variance.
fn field(rows: &[f64; REACH + 1], columns: &[f64; REACH + 1], seed: u64) -> Vec<f64> {
    let mut random = Random::new(seed);
    let white: Vec<f64> = (0..SIDE * SIDE).map(|_| random.normal()).collect();
    let across = filtered(&white, rows, |line, i| line * SIDE + i);
    let mut both = filtered(&across, columns, |line, i| i * SIDE + line);
    // The variance of a tile of correlated noise varies.
    let mean = both.iter().sum::<f64>() / both.len() as f64;
    let variance = both.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / both.len() as f64;
    let scale = 1.0 / variance.max(1e-12).sqrt();
    both.iter_mut().for_each(|v| *v = (*v - mean) * scale);
    both
}

/// Filters all lines; `at` is the index of pixel `i` of a line.
fn filtered(
    input: &[f64],
    kernel: &[f64; REACH + 1],
    at: impl Fn(usize, usize) -> usize,
) -> Vec<f64> {
    let mut out = vec![0.0; input.len()];
    let wrap = SIDE - 1;
    for line in 0..SIDE {
        for i in 0..SIDE {
            let pair =
                |k: usize| input[at(line, (i + k) & wrap)] + input[at(line, (i + SIDE - k) & wrap)];
            let beside: f64 = (1..=REACH).map(|k| kernel[k] * pair(k)).sum();
            out[at(line, i)] = kernel[0] * input[at(line, i)] + beside;
        }
    }
    out
}

fn multiply(a: &[[f64; 3]; 3], b: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn inverse(rows: &[[f64; 3]; 3]) -> [[f64; 3]; 3] {
    let columns = glam::DMat3::from_cols_array_2d(rows).inverse();
    columns.to_cols_array_2d()
}

/// Returns the codes of the tile's texture: four signed bytes a texel.
pub(super) fn codes(texture: &NoiseTexture) -> Vec<[i8; 4]> {
    let code = |v: f64| (v * 127.0 / MAX_SIGMAS).round().clamp(-127.0, 127.0) as i8;
    let texel = |rgb: [f64; 3]| {
        let [r, g, b] = rgb.map(code);
        [r, g, b, 0]
    };
    tile(texture).into_iter().map(texel).collect()
}

/// Returns where the tile begins in picture `number`: a displacement each way, texels.
#[must_use]
pub fn offset(number: u64) -> [u32; 2] {
    let mut random = Random::new(number);
    [0, 1].map(|_| (random.uniform() * SIDE as f64) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn correlation(tile: &[[f64; 3]], of: impl Fn(&[f64; 3]) -> f64, dx: usize, dy: usize) -> f64 {
        let at = |x: usize, y: usize| of(&tile[(y % SIDE) * SIDE + x % SIDE]);
        let pixels = (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x, y)));
        let (mut own, mut both) = (0.0, 0.0);
        for (x, y) in pixels {
            own += at(x, y).powi(2);
            both += at(x, y) * at(x + dx, y + dy);
        }
        both / own
    }

    #[test]
    fn white_noise_stays_white() {
        let tile = tile(&NoiseTexture::WHITE);
        for c in 0..3 {
            let variance = tile.iter().map(|t| t[c] * t[c]).sum::<f64>() / tile.len() as f64;
            assert!((variance - 1.0).abs() < 0.02, "{variance}");
            for (dx, dy) in [(1, 0), (0, 1), (2, 0), (1, 1)] {
                assert!(correlation(&tile, |t| t[c], dx, dy).abs() < 0.02);
            }
        }
        let between = tile.iter().map(|t| t[0] * t[1]).sum::<f64>() / tile.len() as f64;
        assert!(between.abs() < 0.02, "{between}");
    }

    #[test]
    fn tile_has_the_correlation_over_pixels_and_channels() {
        // Grey noise dominates, and the colour differences are smoother than luma.
        let mut texture = NoiseTexture::WHITE;
        texture.across = [[0.3; NOISE_LAGS], [0.8; NOISE_LAGS], [0.8; NOISE_LAGS]];
        for (i, share) in [0.3_f64, 0.8, 0.8].into_iter().enumerate() {
            texture.across[i] = std::array::from_fn(|k| share.powi(k as i32 + 1));
            texture.down[i] = std::array::from_fn(|k| (0.5 * share).powi(k as i32 + 1));
        }
        texture.covariance = [[0.8, -0.1, -0.05], [-0.1, 0.4, 0.02], [-0.05, 0.02, 0.35]];
        let tile = tile(&texture);
        let opponent = |i: usize| {
            move |t: &[f64; 3]| -> f64 { (0..3).map(|c| OPPONENT_FROM_RGB[i][c] * t[c]).sum() }
        };
        for i in 0..3 {
            for (lag, wanted) in texture.across[i].iter().take(3).enumerate() {
                let found = correlation(&tile, opponent(i), lag + 1, 0);
                assert!((found - wanted).abs() < 0.06, "{i} {lag}: {found} {wanted}");
            }
            let found = correlation(&tile, opponent(i), 0, 1);
            assert!((found - texture.down[i][0]).abs() < 0.06, "{i}: {found}");
            for j in 0..3 {
                let both = |t: &[f64; 3]| opponent(i)(t) * opponent(j)(t);
                let found = tile.iter().map(both).sum::<f64>() / tile.len() as f64;
                let wanted = texture.covariance[i][j];
                assert!((found - wanted).abs() < 0.03, "{i} {j}: {found} {wanted}");
            }
        }
    }

    #[test]
    fn offset_depends_on_the_number_of_the_picture_alone() {
        assert_eq!(offset(7), offset(7));
        assert_ne!(offset(7), offset(8));
        assert!((0..100).flat_map(offset).all(|o| o < SIDE as u32));
    }
}
