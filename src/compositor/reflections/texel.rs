//! What the composite reads of each pixel of the picture of what glossy surfaces mirror.

use super::nearby::Nearby;
use glam::Vec3;
use half::f16;

/// A texel: light as three floats with a common exponent; open and seen as half floats; the place in
/// the picture in steps of 1 / 65,535; its third number and z, negative on a real mirror, as half
/// floats.
pub type Texel = [u32; 4];
/// No glossy surface.
pub const NOTHING: Texel = [0; 4];

/// Twin of WGSL `nearby_at`, which reads it.
pub fn packed(nearby: &Nearby) -> Texel {
    if nearby.z == 0.0 {
        return NOTHING;
    }
    let half = |x: f32| u32::from(f16::from_f32(x.clamp(-6e4, 6e4)).to_bits());
    let halves = |a: f32, b: f32| half(a) | half(b) << 16;
    let unit = |x: f32| (x.clamp(0.0, 1.0) * 65535.0).round() as u32;
    let Nearby {
        light,
        open,
        seen,
        place,
        z,
        ..
    } = *nearby;
    [
        with_common_exponent(light),
        halves(open, seen),
        unit(place.x) | unit(place.y) << 16,
        halves(place.z, z),
    ]
}

/// Bits of each number of [`with_common_exponent`].
const MANTISSA: i32 = 9;
/// Power of two by which its numbers are multiplied at the exponent 0.
const LEAST_EXPONENT: i32 = -24;

/// Three numbers of nine bits and an exponent of five (`RGB9_E5` of Vulkan).
fn with_common_exponent(light: Vec3) -> u32 {
    let largest = (1 << MANTISSA) - 1;
    let light = light.clamp(Vec3::ZERO, Vec3::splat(65408.0));
    // The power of two above the greatest number, which rounding may not reach.
    let power = (light.max_element() * (1.0 + 1.0 / 1024.0))
        .max(1e-9)
        .log2()
        .floor() as i32
        + 1;
    let exponent = (power - MANTISSA - LEAST_EXPONENT).clamp(0, 31);
    let scale = ((-exponent - LEAST_EXPONENT) as f32).exp2();
    let [r, g, b] = (light * scale)
        .round()
        .to_array()
        .map(|x| (x as u32).min(largest));
    r | g << 9 | b << 18 | (exponent as u32) << 27
}

/// Change of a picture's light, as a share, that is less than a code.
const VISIBLE: f32 = 1.0 / 512.0;

/// Whether a real mirror shows something else than the camera's picture.
pub fn is_changed(&[light, open_seen, _, z]: &Texel) -> bool {
    let low = |bits: u32| f16::from_bits(bits as u16);
    let is_lit = light & 0x07ff_ffff != 0;
    let open = low(open_seen).to_f32();
    low(z >> 16) < f16::ZERO && (is_lit || (open - 1.0).abs() > VISIBLE)
}

/// The light of [`with_common_exponent`]; twin of WGSL `light_of`.
fn light_of(bits: u32) -> Vec3 {
    let number = |shift: u32| (bits >> shift & 511) as f32;
    let exponent = (bits >> 27) as i32 + LEAST_EXPONENT;
    Vec3::new(number(0), number(9), number(18)) * (exponent as f32).exp2()
}

/// What [`packed`] kept.
pub fn unpacked(&[light, open_seen, place, z]: &Texel) -> Nearby {
    let low = |bits: u32| f16::from_bits(bits as u16).to_f32();
    let unit = |bits: u32| (bits & 0xffff) as f32 / 65535.0;
    Nearby {
        light: light_of(light),
        open: low(open_seen),
        seen: low(open_seen >> 16),
        place: Vec3::new(unit(place), unit(place >> 16), low(z)),
        z: low(z >> 16),
        ..Nearby::NOTHING
    }
}

/// Whether pixel `own` of rows of `across` mirrors something else than one beside it on the same virtual
/// surface.
pub fn is_uneven(texels: &[Texel], across: usize, own: usize) -> bool {
    if texels[own] == NOTHING {
        return false;
    }
    let nearby = unpacked(&texels[own]);
    if nearby.is_in_real_mirror() {
        return false;
    }
    let is_uneven = |other: usize| {
        let other = texels.get(other).map(unpacked);
        other.is_some_and(|other| nearby.is_as_far_as(&other) && nearby.is_unlike(&other))
    };
    let x = own % across;
    (x > 0 && is_uneven(own - 1))
        || (x + 1 < across && is_uneven(own + 1))
        || (own >= across && is_uneven(own - across))
        || is_uneven(own + across)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_is_kept_to_a_512th_of_the_brightest_channel() {
        let mut light = Vec3::new(0.3, 1.0, 0.07);
        for _ in 0..40 {
            let error = (light_of(with_common_exponent(light)) - light).abs();
            let brightest = light.max_element().max(1e-4);
            assert!(error.max_element() <= brightest / 511.0, "{light}");
            light *= if light.y > 5e4 { 1e-6 } else { 1.37 };
        }
        assert_eq!(light_of(with_common_exponent(Vec3::ZERO)), Vec3::ZERO);
        let most = light_of(with_common_exponent(Vec3::INFINITY));
        assert!(most.is_finite() && most.x > 6e4);
    }

    #[test]
    fn texel_keeps_what_a_pixel_mirrors() {
        let nearby = Nearby {
            light: Vec3::new(0.5, 0.25, 0.125),
            open: 0.25,
            seen: 0.5,
            place: Vec3::new(0.0, 1.0, 0.75),
            z: -1.5,
            ..Nearby::NOTHING
        };
        assert_eq!(unpacked(&packed(&nearby)), nearby);
    }
}
