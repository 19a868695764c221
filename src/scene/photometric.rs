//! Conversion between photometric units and scene camera units; colours of black bodies.

use crate::mesh::SceneTexture;
use glam::Vec3;
use penumbra_camera::linear_from_srgb;

/// Luminances of the Rec.709 primaries.
const LUMINANCE: Vec3 = Vec3::new(0.2126, 0.7152, 0.0722);
/// Luminance that a camera at EV 0 (ISO 100) shows as white, cd/m²: 78 / (100 · 0.65), the
/// saturation-based speed of ISO 12232 with a lens that loses 35 % (Lagarde and de Rousiers 2014).
const WHITE_AT_EV_0: f64 = 1.2;
/// Boltzmann's second radiation constant, nm · K.
const RADIATION: f64 = 1.438_777e7;

/// Luminance of a camera's white at exposure value `ev100` (ISO 100), cd/m².
#[must_use]
pub fn white_of_ev100(ev100: f64) -> f64 {
    WHITE_AT_EV_0 * ev100.exp2()
}

/// Relative luminance of a linear Rec.709 colour; white has 1.
#[must_use]
pub fn luminance(colour: Vec3) -> f32 {
    colour.dot(LUMINANCE)
}

/// Mean of an sRGB texture, linear Rec.709.
#[must_use]
pub fn mean_colour(texture: &SceneTexture) -> Vec3 {
    let linear: [f32; 256] = std::array::from_fn(|code| linear_from_srgb(code as f32 / 255.0));
    let to_linear = |texel: &[u8]| [0, 1, 2].map(|c| f64::from(linear[usize::from(texel[c])]));
    let sum: glam::DVec3 = texture
        .rgba
        .chunks_exact(4)
        .map(|t| glam::DVec3::from(to_linear(t)))
        .sum();
    (sum / (texture.rgba.len() / 4).max(1) as f64).as_vec3()
}

/// Scales a linear Rec.709 colour to a luminance of 1; black stays black.
#[must_use]
pub fn normalise_luminance(colour: Vec3) -> Vec3 {
    let luminance = colour.dot(LUMINANCE);
    if luminance > 0.0 {
        colour / luminance
    } else {
        Vec3::ZERO
    }
}

/// Colour of a black body of `kelvin`, linear Rec.709 (white point D65), at a luminance of 1;
/// channels outside the gamut are 0. Planck's law with the CIE 1931 observer in the fit of Wyman,
/// Sloan and Shirley (2013).
#[must_use]
pub fn black_body(kelvin: f64) -> Vec3 {
    let mut xyz = glam::DVec3::ZERO;
    for step in 0..=94 {
        let nm = 360.0 + 5.0 * f64::from(step);
        let radiance = nm.powi(-5) / ((RADIATION / (nm * kelvin)).exp() - 1.0);
        xyz += observer(nm) * radiance;
    }
    let rgb = glam::DMat3::from_cols_array_2d(&[
        [3.240_454_2, -0.969_266_0, 0.055_643_4],
        [-1.537_138_5, 1.876_010_8, -0.204_025_9],
        [-0.498_531_4, 0.041_556_0, 1.057_225_2],
    ]) * (xyz / xyz.y);
    normalise_luminance(rgb.as_vec3().max(Vec3::ZERO))
}

/// CIE 1931 colour-matching functions x̄, ȳ, z̄ at a wavelength, nanometres.
fn observer(nm: f64) -> glam::DVec3 {
    let lobe = |peak: f64, middle: f64, below: f64, above: f64| {
        let scale = if nm < middle { below } else { above };
        peak * (-0.5 * ((nm - middle) * scale).powi(2)).exp()
    };
    glam::DVec3::new(
        lobe(0.362, 442.0, 0.0624, 0.0374)
            + lobe(1.056, 599.8, 0.0264, 0.0323)
            + lobe(-0.065, 501.1, 0.0490, 0.0382),
        lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322),
        lobe(1.217, 437.0, 0.0845, 0.0278) + lobe(0.681, 459.0, 0.0385, 0.0725),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chromaticities of the Planckian locus (Wyszecki and Stiles 1982, table 1(3.11)).
    #[test]
    fn black_bodies_have_their_chromaticities() {
        for (kelvin, x, y) in [
            (2856.0, 0.4476, 0.4074),
            (4000.0, 0.3805, 0.3768),
            (6500.0, 0.3135, 0.3237),
        ] {
            let rgb = black_body(kelvin).as_dvec3();
            let xyz = glam::DMat3::from_cols_array_2d(&[
                [0.412_456_4, 0.212_672_9, 0.019_333_9],
                [0.357_576_1, 0.715_152_2, 0.119_192_0],
                [0.180_437_5, 0.072_175_0, 0.950_304_1],
            ]) * rgb;
            let sum = xyz.element_sum();
            let error = (xyz.x / sum - x).hypot(xyz.y / sum - y);
            assert!(error < 0.004, "{kelvin}: {} {}", xyz.x / sum, xyz.y / sum);
            assert!((xyz.y - 1.0).abs() < 1e-3);
        }
        assert!(black_body(1000.0).z == 0.0 && black_body(20_000.0).z > 1.0);
    }

    #[test]
    fn white_follows_the_exposure_value() {
        let ev = 8.0;
        assert!((white_of_ev100(ev) - 307.2).abs() < 1e-9);
        assert!((white_of_ev100(ev + 1.0) / white_of_ev100(ev) - 2.0).abs() < 1e-12);
    }
}
