//! The colours of a ColorChecker's patches, as published by X-Rite.

use glam::{DMat3, DVec3};

/// Edition of the chart: its colours changed in November 2014.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edition {
    /// GretagMacbeth, 2005 to October 2014.
    Gmb2005,
    /// X-Rite and Calibrite, from November 2014 on.
    #[default]
    Xrite2014,
}

/// Number of columns of the chart.
pub const COLUMNS: usize = 6;
/// Number of rows of the chart.
pub const ROWS: usize = 4;
/// Patches of the neutral row, white to black.
pub const GREYS: std::ops::Range<usize> = 18..24;

/// Names of the patches from the top left, row by row.
pub const NAMES: [&str; COLUMNS * ROWS] = [
    "dark skin",
    "light skin",
    "blue sky",
    "foliage",
    "blue flower",
    "bluish green",
    "orange",
    "purplish blue",
    "moderate red",
    "purple",
    "yellow green",
    "orange yellow",
    "blue",
    "green",
    "red",
    "yellow",
    "magenta",
    "cyan",
    "white 9.5",
    "neutral 8",
    "neutral 6.5",
    "neutral 5",
    "neutral 3.5",
    "black 2",
];

/// CIELAB under D50, 2° observer: "ColorChecker Classic, L*a*b* values", X-Rite support,
/// before and from November 2014.
#[rustfmt::skip]
const LAB_2005: [[f64; 3]; COLUMNS * ROWS] = [
    [37.986, 13.555, 14.059], [65.711, 18.130, 17.810], [49.927, -4.880, -21.925],
    [43.139, -13.095, 21.905], [55.112, 8.844, -25.399], [70.719, -33.397, -0.199],
    [62.661, 36.067, 57.096], [40.020, 10.410, -45.964], [51.124, 48.239, 16.248],
    [30.325, 22.976, -21.587], [72.532, -23.709, 57.255], [71.941, 19.363, 67.857],
    [28.778, 14.179, -50.297], [55.261, -38.342, 31.370], [42.101, 53.378, 28.190],
    [81.733, 4.039, 79.819], [51.935, 49.986, -14.574], [51.038, -28.631, -28.638],
    [96.539, -0.425, 1.186], [81.257, -0.638, -0.335], [66.766, -0.734, -0.504],
    [50.867, -0.153, -0.270], [35.656, -0.421, -1.231], [20.461, -0.079, -0.973],
];
#[rustfmt::skip]
const LAB_2014: [[f64; 3]; COLUMNS * ROWS] = [
    [37.54, 14.37, 14.92], [64.66, 19.27, 17.50], [49.32, -3.82, -22.54],
    [43.46, -12.74, 22.72], [54.94, 9.61, -24.79], [70.48, -32.26, -0.37],
    [62.73, 35.83, 56.50], [39.43, 10.75, -45.17], [50.57, 48.64, 16.67],
    [30.10, 22.54, -20.87], [71.77, -24.13, 58.19], [71.51, 18.24, 67.37],
    [28.37, 15.42, -49.80], [54.38, -39.72, 32.27], [42.43, 51.05, 28.62],
    [81.80, 2.67, 80.41], [50.63, 51.28, -14.12], [49.57, -29.71, -28.32],
    [95.19, -1.03, 2.93], [81.29, -0.57, 0.44], [66.89, -0.75, -0.06],
    [50.76, -0.13, 0.14], [35.63, -0.46, -0.48], [20.64, 0.07, -0.46],
];

impl Edition {
    /// Returns the reflectances as linear Rec.709 under D65, adapted from D50 by Bradford's
    /// transform; cyan lies outside of the gamut (its red is slightly negative).
    #[must_use]
    pub fn linear(self) -> [DVec3; COLUMNS * ROWS] {
        let lab = match self {
            Self::Gmb2005 => &LAB_2005,
            Self::Xrite2014 => &LAB_2014,
        };
        lab.map(|lab| LINEAR_FROM_XYZ * (D65_FROM_D50 * xyz_d50(DVec3::from_array(lab))))
    }

    /// Returns the edition's year.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Gmb2005 => "2005",
            Self::Xrite2014 => "2014",
        }
    }
}

/// XYZ of the ICC's D50.
const D50: DVec3 = DVec3::new(0.964_22, 1.0, 0.825_21);

/// Bradford's adaptation (values by B. Lindbloom).
const D65_FROM_D50: DMat3 = DMat3::from_cols(
    DVec3::new(0.955_576_6, -0.028_289_5, 0.012_298_2),
    DVec3::new(-0.023_039_3, 1.009_941_6, -0.020_483_0),
    DVec3::new(0.063_163_6, 0.021_007_7, 1.329_909_8),
);

/// Linear Rec.709 from XYZ (IEC 61966-2-1).
const LINEAR_FROM_XYZ: DMat3 = DMat3::from_cols(
    DVec3::new(3.240_454_2, -0.969_266_0, 0.055_643_4),
    DVec3::new(-1.537_138_5, 1.876_010_8, -0.204_025_9),
    DVec3::new(-0.498_531_4, 0.041_556_0, 1.057_225_2),
);

/// Returns XYZ of CIELAB relative to [`D50`] (CIE 15).
fn xyz_d50(lab: DVec3) -> DVec3 {
    const EPSILON: f64 = 216.0 / 24389.0;
    const KAPPA: f64 = 24389.0 / 27.0;
    let y = (lab.x + 16.0) / 116.0;
    let f = DVec3::new(y + lab.y / 500.0, y, y - lab.z / 200.0);
    let inverse = |f: f64| {
        if f * f * f > EPSILON {
            f * f * f
        } else {
            (116.0 * f - 16.0) / KAPPA
        }
    };
    D50 * DVec3::new(inverse(f.x), inverse(f.y), inverse(f.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_camera::srgb_from_linear;

    /// 8-bit sRGB of both editions as T. Kuyper's macduff (public domain) lists them:
    /// ColorChecker_2005.csv, xrite_post-2014.csv.
    #[rustfmt::skip]
    const SRGB: [[[u8; 3]; 24]; 2] = [
        [[116, 81, 67], [199, 147, 129], [91, 122, 156], [90, 108, 64], [130, 128, 176],
         [92, 190, 172], [224, 124, 47], [68, 91, 170], [198, 82, 97], [94, 58, 106],
         [159, 189, 63], [230, 162, 39], [35, 63, 147], [67, 149, 74], [180, 49, 57],
         [238, 198, 20], [193, 84, 151], [0, 136, 170], [245, 245, 243], [200, 202, 202],
         [161, 163, 163], [121, 121, 122], [82, 84, 86], [49, 49, 51]],
        [[116, 79, 65], [197, 144, 127], [91, 120, 155], [91, 108, 64], [131, 127, 175],
         [95, 189, 172], [224, 124, 48], [69, 90, 167], [197, 80, 95], [93, 58, 104],
         [156, 187, 58], [227, 161, 39], [40, 62, 145], [61, 147, 70], [178, 54, 57],
         [236, 199, 15], [191, 79, 146], [0, 133, 165], [241, 242, 235], [201, 202, 201],
         [161, 163, 163], [121, 121, 121], [83, 84, 85], [50, 50, 50]],
    ];

    #[test]
    fn colours_match_published_srgb_values() {
        for (edition, listed) in [Edition::Gmb2005, Edition::Xrite2014].into_iter().zip(SRGB) {
            for ((linear, listed), name) in edition.linear().into_iter().zip(listed).zip(NAMES) {
                for c in 0..3 {
                    let code = 255.0 * srgb_from_linear(linear[c] as f32);
                    let error = (code - f32::from(listed[c])).abs();
                    assert!(error < 2.6, "{edition:?} {name} {c}: {code} {listed:?}");
                }
            }
        }
    }
}
