//! Vignetting: relative brightness over the picture.

use glam::DVec2;

/// Relative brightness 1 + k1 ρ² + k2 ρ⁴ + k3 ρ⁶ at the distance ρ · `radius` from `centre`
/// (Goldman, PAMI 32(12), 2010, eq. 2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Vignetting {
    /// Centre, pixels.
    pub centre: DVec2,
    /// Radius at which ρ is 1, pixels.
    pub radius: f64,
    /// k1, k2, k3.
    pub coefficients: [f64; 3],
    /// Standard errors of the coefficients.
    pub sigma: [f64; 3],
}

impl Vignetting {
    /// Returns the relative brightness of a pixel, 1 in the centre.
    #[must_use]
    pub fn at(&self, pixel: DVec2) -> f64 {
        polynomial(
            &self.coefficients,
            (pixel - self.centre).length_squared() / (self.radius * self.radius),
        )
    }

    /// Returns whether the relative brightness is within 0.02 and 2 over a picture of the given size.
    #[must_use]
    pub fn is_possible(&self, (width, height): (u32, u32)) -> bool {
        let corner = DVec2::new(f64::from(width), f64::from(height));
        let is_valid = self.radius > 0.0 && self.centre.is_finite();
        let farthest = [DVec2::ZERO, corner, corner * DVec2::X, corner * DVec2::Y]
            .map(|p| p.distance(self.centre))
            .into_iter()
            .fold(0.0, f64::max);
        let steps = (0..=64).map(|i| f64::from(i) / 64.0 * farthest / self.radius);
        is_valid
            && steps
                .map(|rho| polynomial(&self.coefficients, rho * rho))
                .all(|v| (0.02..2.0).contains(&v))
    }

    /// Returns the factor of each pixel's linear value that removes vignetting, row by row.
    #[must_use]
    pub fn corrections(&self, (width, height): (u32, u32)) -> Vec<f32> {
        let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        pixels
            .map(|(x, y)| (1.0 / self.at(DVec2::new(f64::from(x), f64::from(y)))) as f32)
            .collect()
    }
}

/// Default centre (the lens's axis, or the picture's centre) and radius (half a diagonal), pixels.
#[must_use]
pub fn default_frame((width, height): (u32, u32), centre: Option<DVec2>) -> (DVec2, f64) {
    let size = DVec2::new(f64::from(width), f64::from(height));
    (centre.unwrap_or(0.5 * (size - 1.0)), 0.5 * size.length())
}

/// Evaluates 1 + k1 q + k2 q² + k3 q³ at q = ρ².
#[must_use]
pub fn polynomial(k: &[f64; 3], q: f64) -> f64 {
    1.0 + q * (k[0] + q * (k[1] + q * k[2]))
}
