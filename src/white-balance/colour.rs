//! Perceptual colour differences: linear sRGB to CIELAB (D65), CIEDE2000.

use glam::{DMat3, DVec3};

/// CIE XYZ of linear Rec.709 RGB (IEC 61966-2-1), white (1, 1, 1) at Y = 1.
fn xyz_from_linear(rgb: DVec3) -> DVec3 {
    XYZ_FROM_LINEAR * rgb
}

const XYZ_FROM_LINEAR: DMat3 = DMat3::from_cols_array(&[
    0.412_456_4,
    0.212_672_9,
    0.019_333_9,
    0.357_576_1,
    0.715_152_2,
    0.119_192_0,
    0.180_437_5,
    0.072_175_0,
    0.950_304_1,
]);

/// CIELAB (CIE 15) of XYZ against the D65 white of [`xyz_from_linear`]: L*, a*, b*.
fn lab_from_xyz(xyz: DVec3) -> DVec3 {
    const EPSILON: f64 = 216.0 / 24389.0;
    const KAPPA: f64 = 24389.0 / 27.0;
    let f = |t: f64| {
        if t > EPSILON {
            t.cbrt()
        } else {
            (KAPPA * t + 16.0) / 116.0
        }
    };
    let t = xyz / (XYZ_FROM_LINEAR * DVec3::ONE);
    let (x, y, z) = (f(t.x), f(t.y), f(t.z));
    DVec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// CIELAB of linear Rec.709 RGB, where (1, 1, 1) is white.
fn lab_from_linear(rgb: DVec3) -> DVec3 {
    lab_from_xyz(xyz_from_linear(rgb))
}

/// CIEDE2000 between two CIELAB colours, with kL = kC = kH = 1.
///
/// G. Sharma, W. Wu, E. N. Dalal: The CIEDE2000 color-difference formula: implementation
/// notes, supplementary test data, and mathematical observations. Color Research and
/// Application 30(1), 2005. Equation numbers below are theirs.
fn delta_e_2000(first: DVec3, second: DVec3) -> f64 {
    let (c1, c2) = (chroma(first), chroma(second));
    let g = 0.5 * (1.0 - saturation(0.5 * (c1 + c2))); // (4)
    let (a1, a2) = ((1.0 + g) * first.y, (1.0 + g) * second.y); // (5)
    let (c1, c2) = (a1.hypot(first.z), a2.hypot(second.z)); // (6)
    let (h1, h2) = (hue(a1, first.z), hue(a2, second.z)); // (7)
    let (dh, mean_h) = hue_difference_and_mean(h1, h2, c1 * c2 == 0.0);
    let dl = second.x - first.x; // (8)
    let dc = c2 - c1; // (9)
    let dh = 2.0 * (c1 * c2).sqrt() * (0.5 * dh).to_radians().sin(); // (11)
    let (mean_l, mean_c) = (0.5 * (first.x + second.x), 0.5 * (c1 + c2));
    let l50 = (mean_l - 50.0).powi(2);
    let sl = 1.0 + 0.015 * l50 / (20.0 + l50).sqrt(); // (17)
    let sc = 1.0 + 0.045 * mean_c; // (18)
    let sh = 1.0 + 0.015 * mean_c * hue_weight(mean_h); // (19)
    let rt = -rotation(mean_h).sin() * 2.0 * saturation(mean_c); // (20), (21)
    let (l, c, h) = (dl / sl, dc / sc, dh / sh);
    (l * l + c * c + h * h + rt * c * h).max(0.0).sqrt() // (22)
}

/// CIEDE2000 between two linear Rec.709 colours, where (1, 1, 1) is white.
#[must_use]
pub fn delta_e_linear(first: DVec3, second: DVec3) -> f64 {
    delta_e_2000(lab_from_linear(first), lab_from_linear(second))
}

/// Visible effect of wrong gains: CIEDE2000 between a grey surface of linear value `grey`
/// (1 = white) and the same surface with its channels multiplied by `ratio`.
#[must_use]
pub fn delta_e_of_gain_error(ratio: DVec3, grey: f64) -> f64 {
    delta_e_linear(DVec3::splat(grey), grey * ratio)
}

fn chroma(lab: DVec3) -> f64 {
    lab.y.hypot(lab.z)
}

/// √(C⁷ / (C⁷ + 25⁷)).
fn saturation(chroma: f64) -> f64 {
    let c7 = chroma.powi(7);
    (c7 / (c7 + 25f64.powi(7))).sqrt()
}

/// Degrees in 0..360; 0 for a neutral colour.
fn hue(a: f64, b: f64) -> f64 {
    b.atan2(a).to_degrees().rem_euclid(360.0)
}

/// Δh' (10) and mean h' (14), degrees.
fn hue_difference_and_mean(h1: f64, h2: f64, neutral: bool) -> (f64, f64) {
    let (difference, sum) = (h2 - h1, h1 + h2);
    if neutral {
        return (0.0, sum);
    }
    if difference.abs() <= 180.0 {
        return (difference, 0.5 * sum);
    }
    let mean = if sum < 360.0 {
        0.5 * (sum + 360.0)
    } else {
        0.5 * (sum - 360.0)
    };
    (difference - 360.0 * difference.signum(), mean)
}

/// T (15).
fn hue_weight(h: f64) -> f64 {
    let cos = |degrees: f64| degrees.to_radians().cos();
    1.0 - 0.17 * cos(h - 30.0) + 0.24 * cos(2.0 * h) + 0.32 * cos(3.0 * h + 6.0)
        - 0.20 * cos(4.0 * h - 63.0)
}

/// 2 Δθ (16), radians.
fn rotation(h: f64) -> f64 {
    (60.0 * (-((h - 275.0) / 25.0).powi(2)).exp()).to_radians()
}

#[cfg(test)]
mod tests {

    use super::*;
    use proptest::prelude::*;

    /// Table 1 of Sharma et al. 2005: L*, a*, b* twice, ΔE00.
    #[rustfmt::skip]
    const SHARMA: [[f64; 7]; 34] = [
        [50.0, 2.6772, -79.7751, 50.0, 0.0, -82.7485, 2.0425],
        [50.0, 3.1571, -77.2803, 50.0, 0.0, -82.7485, 2.8615],
        [50.0, 2.8361, -74.0200, 50.0, 0.0, -82.7485, 3.4412],
        [50.0, -1.3802, -84.2814, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, -1.1848, -84.8006, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, -0.9009, -85.5211, 50.0, 0.0, -82.7485, 1.0000],
        [50.0, 0.0, 0.0, 50.0, -1.0, 2.0, 2.3669],
        [50.0, -1.0, 2.0, 50.0, 0.0, 0.0, 2.3669],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0009, 7.1792],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0010, 7.1792],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0011, 7.2195],
        [50.0, 2.4900, -0.0010, 50.0, -2.4900, 0.0012, 7.2195],
        [50.0, -0.0010, 2.4900, 50.0, 0.0009, -2.4900, 4.8045],
        [50.0, -0.0010, 2.4900, 50.0, 0.0010, -2.4900, 4.8045],
        [50.0, -0.0010, 2.4900, 50.0, 0.0011, -2.4900, 4.7461],
        [50.0, 2.5, 0.0, 50.0, 0.0, -2.5, 4.3065],
        [50.0, 2.5, 0.0, 73.0, 25.0, -18.0, 27.1492],
        [50.0, 2.5, 0.0, 61.0, -5.0, 29.0, 22.8977],
        [50.0, 2.5, 0.0, 56.0, -27.0, -3.0, 31.9030],
        [50.0, 2.5, 0.0, 58.0, 24.0, 15.0, 19.4535],
        [50.0, 2.5, 0.0, 50.0, 3.1736, 0.5854, 1.0000],
        [50.0, 2.5, 0.0, 50.0, 3.2972, 0.0, 1.0000],
        [50.0, 2.5, 0.0, 50.0, 1.8634, 0.5757, 1.0000],
        [50.0, 2.5, 0.0, 50.0, 3.2592, 0.3350, 1.0000],
        [60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644],
        [63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630],
        [61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731],
        [35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645],
        [22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373],
        [36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146],
        [90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441],
        [90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381],
        [6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377],
        [2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082],
    ];

    #[test]
    fn ciede2000_equals_the_published_values() {
        for [l1, a1, b1, l2, a2, b2, expected] in SHARMA {
            let (first, second) = (DVec3::new(l1, a1, b1), DVec3::new(l2, a2, b2));
            for got in [delta_e_2000(first, second), delta_e_2000(second, first)] {
                assert!((got - expected).abs() < 5.1e-5, "{first} {second}: {got}");
            }
        }
    }

    #[test]
    fn primaries_have_their_known_lab_values() {
        for (rgb, lab) in [
            (DVec3::ONE, DVec3::new(100.0, 0.0, 0.0)),
            (DVec3::ZERO, DVec3::ZERO),
            (DVec3::X, DVec3::new(53.2408, 80.0925, 67.2032)),
            (DVec3::Y, DVec3::new(87.7347, -86.1827, 83.1793)),
            (DVec3::Z, DVec3::new(32.2970, 79.1875, -107.8602)),
            (DVec3::splat(0.18), DVec3::new(49.4961, 0.0, 0.0)),
        ] {
            let got = lab_from_linear(rgb);
            assert!(got.distance(lab) < 0.01, "{rgb}: {got}");
        }
    }

    #[test]
    fn only_a_wrong_gain_makes_a_difference() {
        assert_eq!(delta_e_of_gain_error(DVec3::ONE, 0.5), 0.0);
        let warm = delta_e_of_gain_error(DVec3::new(1.1, 1.0, 0.9), 0.5);
        assert!((3.0..10.0).contains(&warm), "{warm}");
    }

    proptest! {
        #[test]
        fn ciede2000_is_symmetric_and_not_negative(
            l in prop::array::uniform2(0.0f64..100.0),
            ab in prop::array::uniform4(-120.0f64..120.0),
        ) {
            let first = DVec3::new(l[0], ab[0], ab[1]);
            let second = DVec3::new(l[1], ab[2], ab[3]);
            let forth = delta_e_2000(first, second);
            prop_assert!(forth >= 0.0 && forth.is_finite());
            prop_assert!((forth - delta_e_2000(second, first)).abs() < 1e-9);
            prop_assert_eq!(delta_e_2000(first, first), 0.0);
        }
    }
}
