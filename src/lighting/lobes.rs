//! Lobes of glossy surfaces: direction, width and albedo.
//!
//! The reflection of distant light by a surface is an integral over the hemisphere Ω about its
//! normal n,
//!
//! ```text
//!   L_o(v) = ∫_Ω L(l) f(v, l) (n·l) dl  =  A · ∫ L(l) k(l) dl,    ∫ k = 1,
//! ```
//!
//! where A = ∫ f (n·l) dl is its directional albedo (split sum, Karis 2013) and k its lobe, which
//! also depends on n·v. It is replaced by a round lobe about some direction d, of the family for
//! which maps are prefiltered. The part of a lobe below the surface's horizon is cut off first. So
//! A is exact under constant light, and at n·v = 1, where the lobe is round, the reflection is
//! exact under any light.
//!
//! Phong's round lobe has the same mean direction vector ∫ l k(l) dl: the vector's direction gives
//! d, its length the width. Under light that changes linearly with direction (spherical harmonics
//! of degree 1) this is exact at every n·v.
//!
//! At grazing angles, GGX has its peak near the mirror direction, is longer than wide, and has a
//! tail that pulls the mean away from the peak. d lies eight tenths of the way from the mirror
//! direction to the mean direction, more for rougher surfaces, and at the mean for α = 1; the width
//! is the geometric mean of the width by the vector's length and the width by the lateral extent,
//! ∫ l_y² k(l) dl. Small sources, whose reflection shows the lobe's shape, are treated separately
//! ([`super::compact_source_specular`]).
//!
//! Wide lobes are well represented by that. Narrow GGX lobes are long: the slopes of half vectors are
//! distributed alike in all directions, so the lobe is n·v times as wide across the plane of incidence
//! as along it, which shows at the outlines of bright windows. A row of round lobes represents them
//! ([`LongLobe`]).
//!
//! | family | BRDF | round lobe of width w |
//! |---|---|---|
//! | [`Family::Ggx`] | D·F·G / (4 n·l n·v), GGX with height-correlated Smith masking (Heitz 2014), w = α = roughness² | that BRDF at v = n: D(h)·G₁(l), cosθ > 0 |
//! | [`Family::Phong`] | (e + 2) / 2π · cosᵉ∠(l, r), r the mirror direction (Lafortune & Willems 1994) | cos^m θ, m = 1/w² |

use glam::{DVec3, Vec3};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::LazyLock;

/// The family of a lobe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Family {
    /// Microfacets; parameter: perceptual roughness.
    Ggx,
    /// Modified Phong; parameter: [`phong_parameter`] of the exponent.
    Phong,
}

/// Maximum exponent of Phong's lobe: its highlight is then as wide as a texel of the unfiltered
/// map.
pub const MAX_EXPONENT: f32 = 10_000.0;
/// Doublings of exponent + 1 that the parameter 0..=1 spans.
const EXPONENT_DOUBLINGS: f32 = 14.0;
/// Minimum roughness of GGX; below it the surface is a mirror.
const MIN_ROUGHNESS: f32 = 0.03;

/// Maps an exponent to 0..=1, uniformly in the logarithm of the lobe's width: log₂(e + 1) / 14.
#[must_use]
pub fn phong_parameter(exponent: f32) -> f32 {
    ((exponent + 1.0).log2() / EXPONENT_DOUBLINGS).clamp(0.0, 1.0)
}

/// The inverse of [`phong_parameter`].
#[must_use]
pub fn phong_exponent(parameter: f32) -> f32 {
    (parameter * EXPONENT_DOUBLINGS).exp2() - 1.0
}

/// The reflection of a surface at one n·v.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Response {
    /// Directional albedo by F0 (GGX) or by the specular colour (Phong).
    pub scale: f32,
    /// Addition to the albedo that is independent of F0; GGX with F90 = 1 only.
    pub bias: f32,
    /// Position of d between the mirror direction (0) and the normal (1); beyond 1 past the normal.
    pub tilt: f32,
    /// Width of the round lobe.
    pub width: f32,
}

impl Family {
    /// Evaluates the round lobe of width `w` at the cosine of the angle to its axis: 1 on the axis.
    #[must_use]
    pub fn round(self, w: f32, cos: f32) -> f32 {
        self.at(f64::from(w), 1.0 - f64::from(cos)) as f32
    }

    /// The same as a function of 1 − cosine, which narrow lobes need for precision.
    pub(super) fn by_versine(self, w: f32, versine: f64) -> f64 {
        self.at(f64::from(w), versine)
    }

    fn at(self, w: f64, versine: f64) -> f64 {
        let cos = 1.0 - versine;
        if cos <= 0.0 {
            return 0.0;
        }
        let a2 = w * w;
        match self {
            Self::Phong => ((-versine).ln_1p() / a2).exp(),
            Self::Ggx => {
                // cos² of the half angle is 1 − versine / 2.
                let q = a2 + 0.5 * versine * (1.0 - a2);
                let shadow = 2.0 * cos / (cos + (cos * cos * (1.0 - a2) + a2).sqrt());
                a2 * a2 * shadow / (q * q)
            }
        }
    }

    /// Returns ∫ of [`Self::round`] over the sphere, and its mean cosine.
    #[must_use]
    pub fn moments(self, w: f32) -> (f64, f64) {
        let w = f64::from(w);
        let (mut sum, mut along) = (0.0, 0.0);
        radial(w, |versine, weight| {
            let k = self.at(w, versine) * weight;
            sum += k;
            along += k * versine;
        });
        (sum * TAU, 1.0 - along / sum)
    }

    /// Returns the response of this family at n·v for `parameter`.
    #[must_use]
    pub fn response(self, n_dot_v: f32, parameter: f32) -> Response {
        let n_dot_v = f64::from(n_dot_v.clamp(1e-3, 0.9999));
        let sums = match self {
            Self::Ggx => ggx_sums(n_dot_v, f64::from(parameter.max(MIN_ROUGHNESS))),
            Self::Phong => phong_sums(n_dot_v, f64::from(phong_exponent(parameter))),
        };
        let mirror = DVec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
        // In the plane of n (z) and the mirror direction; y cancels.
        let angle = |d: DVec3| d.x.atan2(d.z);
        let slant = angle(mirror);
        Response {
            scale: sums.scale as f32,
            bias: sums.bias as f32,
            tilt: (sums.share * (1.0 - angle(sums.mean) / slant)) as f32,
            width: self.width_of(&sums) as f32,
        }
    }

    fn width_of(self, sums: &Sums) -> f64 {
        let mean = sums.mean.length();
        match self {
            Self::Phong => {
                let m = (2.0 * mean - 1.0) / (1.0 - mean).max(1e-9);
                1.0 / m.max(1.0).sqrt()
            }
            Self::Ggx => {
                let by_mean = ggx_width(1.0 - mean, |extent| extent.0);
                let by_across = ggx_width(sums.across, |extent| extent.1);
                (by_mean * by_across).sqrt()
            }
        }
    }
}

/// Calls `each` with 1 − cosine of angles from the axis up to 90° and weights sinθ dθ, closely
/// spaced where a lobe of width `w` changes.
fn radial(w: f64, mut each: impl FnMut(f64, f64)) {
    const STEPS: usize = 192;
    // θ = w · sinh(u), up to a right angle.
    let top = (FRAC_PI_2 / w).asinh();
    for i in 0..STEPS {
        let u = top * (i as f64 + 0.5) / STEPS as f64;
        let theta = w * u.sinh();
        let step = w * u.cosh() * top / STEPS as f64;
        let half = (0.5 * theta).sin();
        each(2.0 * half * half, theta.sin() * step);
    }
}

/// Looks up the width of a round GGX lobe by one of its extents: 1 − its mean cosine, or its mean
/// square across one axis.
fn ggx_width(wanted: f64, of: impl Fn(&(f64, f64)) -> f64) -> f64 {
    const STEPS: usize = 96;
    const NARROWEST: f64 = 5e-4;
    fn width(i: f64) -> f64 {
        NARROWEST.powf(1.0 - i / (STEPS - 1) as f64)
    }
    static EXTENTS: LazyLock<Vec<(f64, f64)>> = LazyLock::new(|| {
        let extents = |i| {
            let (mut sum, mut along, mut across) = (0.0, 0.0, 0.0);
            radial(width(i as f64), |versine, weight| {
                let k = Family::Ggx.at(width(i as f64), versine) * weight;
                sum += k;
                along += k * versine;
                across += k * 0.5 * versine * (2.0 - versine);
            });
            (along / sum, across / sum)
        };
        (0..STEPS).map(extents).collect()
    });
    match EXTENTS.partition_point(|e| of(e) < wanted) {
        0 => NARROWEST,
        STEPS => 1.0,
        above => {
            let (low, high) = (of(&EXTENTS[above - 1]), of(&EXTENTS[above]));
            width((above - 1) as f64 + (wanted - low) / (high - low).max(1e-15))
        }
    }
}

/// Sums over the lobe of a surface with normal +Z, with its mirror direction towards +X.
struct Sums {
    scale: f64,
    bias: f64,
    /// Mean direction vector; its length is the mean cosine about its own direction.
    mean: DVec3,
    /// Mean square of the directions' component perpendicular to the plane of view.
    across: f64,
    /// Position of the round lobe between the mirror direction and the mean direction.
    share: f64,
}

/// Number of sampled directions per lobe.
const SAMPLES: u32 = 1024;

/// Returns point `i` of a Hammersley sequence: a number from 0 to 1, and an angle.
fn hammersley(i: u32) -> (f64, f64) {
    let u = (f64::from(i) + 0.5) / f64::from(SAMPLES);
    (u, TAU * f64::from(i.reverse_bits()) / 4_294_967_296.0)
}

/// GGX by importance sampling of half vectors:
///
/// ```text
///   scale = Σ (1 − (1 − v·h)⁵) · G·v·h / (n·h n·v) / N,   bias = Σ (1 − v·h)⁵ · … / N
/// ```
fn ggx_sums(n_dot_v: f64, roughness: f64) -> Sums {
    let a = roughness * roughness;
    let v = DVec3::new(-(1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
    let (mut scale, mut bias, mut mean, mut across) = (0.0, 0.0, DVec3::ZERO, 0.0);
    for i in 0..SAMPLES {
        let (u, phi) = hammersley(i);
        let cos2 = (1.0 - u) / (1.0 + (a * a - 1.0) * u);
        let (n_dot_h, sin) = (cos2.sqrt(), (1.0 - cos2).max(0.0).sqrt());
        let h = DVec3::new(sin * phi.cos(), sin * phi.sin(), n_dot_h);
        let v_dot_h = v.dot(h).max(0.0);
        let l = 2.0 * v_dot_h * h - v;
        if l.z > 0.0 {
            let smith = |x: f64, y: f64| x * (y * y * (1.0 - a * a) + a * a).sqrt();
            let masking = 2.0 * l.z * n_dot_v / (smith(l.z, n_dot_v) + smith(n_dot_v, l.z));
            let weight = masking * v_dot_h / (n_dot_h * n_dot_v).max(1e-9);
            let fresnel = (1.0 - v_dot_h).powi(5);
            scale += (1.0 - fresnel) * weight;
            bias += fresnel * weight;
            mean += weight * DVec3::new(l.x, 0.0, l.z);
            across += weight * l.y * l.y;
        }
    }
    let count = f64::from(SAMPLES);
    let total: f64 = scale + bias;
    Sums {
        scale: scale / count,
        bias: bias / count,
        mean: mean / total.max(1e-12),
        across: across / total.max(1e-12),
        share: 0.8 + 0.2 * a,
    }
}

/// Phong by importance sampling of cosᵉ about the mirror direction, weighted with n·l.
fn phong_sums(n_dot_v: f64, exponent: f64) -> Sums {
    let sin_v = (1.0 - n_dot_v * n_dot_v).sqrt();
    let (mut sum, mut mean) = (0.0, DVec3::ZERO);
    for i in 0..SAMPLES {
        let (u, phi) = hammersley(i);
        let cos = u.powf(1.0 / (exponent + 1.0));
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let (x, up) = (sin * phi.cos(), cos);
        // Rotated from +Z to (sin_v, 0, n·v).
        let l = DVec3::new(x * n_dot_v + up * sin_v, 0.0, up * n_dot_v - x * sin_v);
        if l.z > 0.0 {
            sum += l.z;
            mean += l.z * l;
        }
    }
    Sums {
        scale: sum / f64::from(SAMPLES) * (exponent + 2.0) / (exponent + 1.0),
        bias: 0.0,
        mean: mean / sum.max(1e-12),
        // The mean direction determines the lobe.
        across: 0.0,
        share: 1.0,
    }
}

/// Returns the widths for which a map of `size` texels along a side is prefiltered, levels 1 to
/// `levels` − 1: in equal ratios up to 1, the narrowest about as wide as a texel of level 1.
pub fn widths(size: u32, levels: usize) -> impl ExactSizeIterator<Item = f32> {
    let lobes = levels.saturating_sub(1);
    let narrowest = (NARROWEST_TEXELS / size as f32).min(0.5);
    let step = move |k: usize| (lobes - k) as f32 / lobes.saturating_sub(1).max(1) as f32;
    (0..lobes).map(move |k| narrowest.powf(step(k + 1)))
}

/// Width of the narrowest lobe times the texels of a side, radians: 0.02 for 128.
const NARROWEST_TEXELS: f32 = 2.56;

/// The level of a prefiltered map, with a fraction, that represents a lobe.
///
/// Between two levels, of widths a < w < b, the mixture (1 − t) k_a + t k_b whose shares K(θ) of light
/// within an angle θ of the axis are nearest to those of k_w (least squares over ln θ):
///
/// ```text
///   t = ∫ (K_w − K_a)(K_b − K_a) d ln θ / ∫ (K_b − K_a)² d ln θ
/// ```
///
/// The least squares of the lobes themselves would fit their peaks and give a bright window too wide
/// a halo.
#[derive(Clone, Debug)]
pub struct Levels {
    family: Family,
    /// Widths of level 0, which holds the map itself, and of all others.
    widths: Vec<f32>,
}

impl Levels {
    /// Creates the table for a map of `size` texels along a side and `levels` levels.
    #[must_use]
    pub fn new(family: Family, size: u32, levels: usize) -> Self {
        // A texel's own blur by interpolation: a tent, √⅙ texels wide.
        let texel = (FRAC_PI_2 / f64::from(size) / 6.0_f64.sqrt()) as f32;
        let mut all = vec![texel];
        all.extend(widths(size, levels));
        Self {
            family,
            widths: all,
        }
    }

    /// Returns the level for a round lobe of width `w`; its fraction is the mixture's t.
    #[must_use]
    pub fn level(&self, w: f32) -> f32 {
        let above = self.widths.partition_point(|have| *have < w);
        if above == 0 {
            return 0.0;
        }
        if above == self.widths.len() {
            return (above - 1) as f32;
        }
        (above - 1) as f32 + self.mixture(self.widths[above - 1], self.widths[above], w)
    }

    fn mixture(&self, a: f32, b: f32, w: f32) -> f32 {
        let lobes = [a, b, w].map(|x| (f64::from(x), 1.0 / self.family.moments(x).0));
        let mut inside = [0.0; 3];
        let (mut up, mut down) = (0.0, 0.0);
        radial(f64::from(a), |versine, weight| {
            for (sum, (x, norm)) in inside.iter_mut().zip(lobes) {
                *sum += self.family.at(x, versine) * norm * weight * TAU;
            }
            let [ka, kb, kw] = inside;
            // sinθ dθ / (1 − cosθ) is 2 d ln θ where θ is small.
            let step = weight / versine.max(1e-12);
            up += (kw - ka) * (kb - ka) * step;
            down += (kb - ka) * (kb - ka) * step;
        });
        (up / down.max(1e-30)).clamp(0.0, 1.0) as f32
    }
}

/// Returns the solid angle of a round lobe of width `w`, its integral over its peak, steradians.
#[must_use]
pub fn solid_angle(family: Family, w: f32) -> f32 {
    family.moments(w).0 as f32
}

/// Returns the width of the lobe at n·v = 1.
#[must_use]
pub fn own_width(family: Family, parameter: f32) -> f32 {
    match family {
        Family::Ggx => parameter.max(MIN_ROUGHNESS).powi(2),
        Family::Phong => 1.0 / (phong_exponent(parameter) + 1.0).sqrt(),
    }
}

/// The parts of a long GGX lobe beside its middle, on both sides: slope of the half vector along the
/// plane of incidence, as a multiple of [`LongLobe::step`]; share where n·v is 0, which falls linearly to
/// 0 at n·v = 1, and which GGX's masking modifies; levels of the map above that of the middle, 0.7 for
/// lobes twice as wide. Twins in `composite.wgsl`.
///
/// Slopes and shares are least squares: of the error, relative to at least 3 %, of the share of light that
/// a lobe receives from beyond a straight edge, for edges in seven directions at 0.03 to 12 widths
/// from the middle, and n·v from 0.13 to 0.9; plus a tenth of the relative square of the lobe's own
/// error, without which the row would have gaps and a lamp would be mirrored several times.
pub const PARTS: [(f32, f32, f32); 3] = [
    (0.411, 0.229, 0.0),
    (0.931, 0.161, 0.0),
    (2.693, 0.0805, 0.7),
];
/// Width of a part at n·v = 0, as a share of α, chosen with `tests/materials`: a row of narrower ones would
/// show gaps.
pub const LEAST_ACROSS: f32 = 0.15;

/// A narrow GGX lobe as a row of round lobes along the plane of incidence ([`PARTS`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LongLobe {
    /// Width of each part.
    pub width: f32,
    /// Slope of half vectors that counts as 1 in [`PARTS`]: α, or less if the parts are wider than the lobe is
    /// across.
    pub step: f32,
    /// How far this lobe is to be used, and the round one of [`Family::response`] for the rest: 0 for
    /// wide lobes, whose shape differs, where n·v is nearly 1 and the lobe round, and for lobes that
    /// are narrower than any part may be.
    pub share: f32,
}

impl LongLobe {
    /// The lobe of width `alpha` at n·v, for a map whose narrowest lobes have the width `narrowest`. Parts
    /// are at least half as wide: narrower ones would show the texels of the unfiltered map.
    #[must_use]
    pub fn of(n_dot_v: f32, alpha: f32, narrowest: f32) -> Self {
        /// Widths of lobes between which round ones take over, and n·v.
        const WIDE: (f32, f32) = (0.3, 0.45);
        const ROUND: (f32, f32) = (0.94, 0.98);
        let falls =
            |x: f32, (from, to): (f32, f32)| 1.0 - ((x - from) / (to - from)).clamp(0.0, 1.0);
        let narrowest = 0.5 * narrowest;
        let across = LEAST_ACROSS.hypot(n_dot_v * (1.0 - LEAST_ACROSS.powi(2)).sqrt());
        let width = (alpha * across).max(narrowest);
        // What the parts lack along the plane.
        let spread = (1.0 - (width / alpha).powi(2)).max(0.0);
        let whole = (1.0 - across * across).max(1e-6);
        Self {
            width,
            step: alpha * (spread / whole).sqrt(),
            share: falls(alpha, WIDE) * falls(n_dot_v, ROUND) * f32::from(alpha > narrowest),
        }
    }

    /// Directions of the parts, their shares, 1 in all, and their levels above that of [`Self::width`],
    /// of a surface with the roughness `alpha` and the normal `n` towards a viewer in direction `v`,
    /// both unit vectors. Twin of `radiance_in_row` in `composite.wgsl`.
    #[must_use]
    pub fn parts(self, alpha: f32, n: Vec3, v: Vec3) -> [(Vec3, f32, f32); 2 * PARTS.len() + 1] {
        let n_dot_v = n.dot(v).max(0.02);
        let flat = v - n * n_dot_v;
        let along = flat * (self.step / flat.length().max(1e-4));
        let a2 = alpha * alpha;
        let root = |x: f32| (x * x * (1.0 - a2) + a2).sqrt();
        let beside = 1.0 - n_dot_v;
        let middle = 1.0 - 2.0 * beside * PARTS.iter().map(|part| part.1).sum::<f32>();
        let part = |k: usize| {
            let (slope, share, up) = match PARTS.get(k / 2) {
                Some((slope, share, up)) if k.is_multiple_of(2) => (*slope, share * beside, *up),
                Some((slope, share, up)) => (-slope, share * beside, *up),
                None => (0.0, middle, 0.0),
            };
            let h = (n + along * slope).normalize();
            let l = h * (2.0 * v.dot(h)) - v;
            let n_dot_l = n.dot(l).max(0.0);
            let masked = n_dot_l / (n_dot_l * root(n_dot_v) + n_dot_v * root(n_dot_l));
            (l, share * masked * v.dot(h).max(1e-3) / n.dot(h), up)
        };
        let parts = std::array::from_fn(part);
        let all: f32 = parts.iter().map(|p: &(Vec3, f32, f32)| p.1).sum();
        parts.map(|(l, share, up)| (l, share / all.max(1e-9), up))
    }
}

/// Returns a lobe's axis: `mirror` rotated by the share `tilt` of the angle to the normal `n`, all
/// unit vectors.
#[must_use]
pub fn tilted(mirror: Vec3, n: Vec3, tilt: f32) -> Vec3 {
    let cosine = n.dot(mirror);
    let across = n - mirror * cosine;
    let (sin, cos) = (tilt * cosine.clamp(-1.0, 1.0).acos()).sin_cos();
    (mirror * cos + across / across.length().max(1e-4) * sin).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPONENTS: [f32; 6] = [1.0, 5.0, 20.0, 100.0, 1000.0, MAX_EXPONENT];

    #[test]
    fn phong_albedo_falls_at_grazing_angles() {
        for e in EXPONENTS {
            let at = |n_dot_v| Family::Phong.response(n_dot_v, phong_parameter(e));
            assert!((at(1.0).scale - 1.0).abs() < 1e-3, "{e}: {:?}", at(1.0));
            assert!((-0.1..=1.1).contains(&at(1.0).tilt) && at(1.0).bias == 0.0);
            let falling = [1.0, 0.8, 0.5, 0.2, 0.05].map(|n_dot_v| at(n_dot_v).scale);
            assert!(falling.is_sorted_by(|a, b| a >= b), "{e}: {falling:?}");
        }
        // A narrow lobe is attenuated by the cosine alone.
        let narrow = Family::Phong.response(0.3, phong_parameter(1000.0));
        assert!((narrow.scale - 0.3).abs() < 1e-3, "{narrow:?}");
    }

    #[test]
    fn albedo_is_at_most_one() {
        for family in [Family::Ggx, Family::Phong] {
            for (p, n_dot_v) in (0..=20).flat_map(|p| (1..=20).map(move |v| (p, v))) {
                let (p, n_dot_v) = (p as f32 / 20.0, n_dot_v as f32 / 20.0);
                let r = family.response(n_dot_v, p);
                assert!(r.scale + r.bias <= 1.002, "{family:?} {p} {n_dot_v}: {r:?}");
                assert!(r.scale >= 0.0 && r.bias >= 0.0 && r.width > 0.0 && r.width <= 1.0);
            }
        }
        let smooth = Family::Ggx.response(0.9, 0.0);
        assert!(
            (smooth.scale + smooth.bias - 1.0).abs() < 0.01,
            "{smooth:?}"
        );
    }

    /// ∫ l k(l) dl of the round lobe equals that of the true lobe.
    #[test]
    fn round_phong_lobe_has_mean_direction_of_true_lobe() {
        let n = 256;
        for (e, n_dot_v) in [(1.0, 0.9), (1.0, 0.2), (20.0, 0.5), (100.0, 0.1)] {
            let mirror = DVec3::new((1.0_f64 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
            let (mut sum, mut total) = (DVec3::ZERO, 0.0);
            for (i, k) in (0..n).flat_map(|i| (0..2 * n).map(move |k| (i, k))) {
                let z = (f64::from(i) + 0.5) / f64::from(n);
                let phi = TAU * f64::from(k) / f64::from(2 * n);
                let r = (1.0 - z * z).sqrt();
                let l = DVec3::new(r * phi.cos(), r * phi.sin(), z);
                let weight = l.dot(mirror).max(0.0).powf(e) * z;
                (sum, total) = (sum + l * weight, total + weight);
            }
            let got = Family::Phong.response(n_dot_v as f32, phong_parameter(e as f32));
            let axis = tilted(mirror.as_vec3(), Vec3::Z, got.tilt);
            let mean = Family::Phong.moments(got.width).1 as f32;
            let off = axis * mean - (sum / total).as_vec3();
            assert!(off.length() < 5e-3, "{e} {n_dot_v}: {off}");
        }
    }

    #[test]
    fn moments_of_cosine_lobes_match_closed_form() {
        for w in [0.01_f32, 0.1, 0.5, 1.0] {
            let m = 1.0 / f64::from(w).powi(2);
            let (sum, mean) = Family::Phong.moments(w);
            assert!((sum * (m + 1.0) / TAU - 1.0).abs() < 1e-3, "{w}: {sum}");
            assert!(
                (mean - (m + 1.0) / (m + 2.0)).abs() < 1e-3 * (1.0 - mean),
                "{w}"
            );
        }
    }

    #[test]
    fn parameters_and_exponents_are_inverse() {
        for e in EXPONENTS {
            assert!((phong_exponent(phong_parameter(e)) / e - 1.0).abs() < 1e-4);
        }
        assert_eq!((phong_parameter(0.0), phong_exponent(0.0)), (0.0, 0.0));
    }

    #[test]
    fn levels_increase_with_width_and_match_their_own_lobes() {
        for family in [Family::Ggx, Family::Phong] {
            let levels = Levels::new(family, 128, 6);
            for (w, k) in widths(128, 6).zip(1..) {
                assert!((levels.level(w) - k as f32).abs() < 1e-3, "{family:?} {w}");
            }
            let all: Vec<f32> = (0..200)
                .map(|i| levels.level(1e-4_f32.powf(1.0 - i as f32 / 199.0)))
                .collect();
            assert!(all.is_sorted(), "{family:?} {all:?}");
            assert_eq!((all[0], all[199]), (0.0, 5.0));
        }
        // Maps too small for lobes, and an empty map.
        assert_eq!(Levels::new(Family::Ggx, 1, 1).level(0.5), 0.0);
    }
}
