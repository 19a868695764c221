//! A plane's receiver image, from what its camera drew.

use penumbra_scene::planes::ReceiverImage;

/// How far surfaces are continued beyond their outlines, texels: bilinear look-ups beside an
/// outline must not mix with what is not there.
const CONTINUED: usize = 2;

/// `seen`: octahedral normal, depth and 1 (0 where nothing is), `side²` texels.
pub(super) fn receiver_image(seen: &[[f32; 4]], side: usize) -> ReceiverImage {
    let mut texels = seen.to_vec();
    for _ in 0..CONTINUED {
        texels = continued(&texels, side);
    }
    let signed = |v: f32| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16;
    let unsigned = |t: &[f32; 4]| {
        if t[3] == 0.0 {
            ReceiverImage::NOTHING
        } else {
            (t[2].clamp(0.0, 1.0) * DEEPEST).round() as u16
        }
    };
    ReceiverImage {
        normals: texels
            .iter()
            .map(|t| [signed(t[0]), signed(t[1])])
            .collect(),
        depths: texels.iter().map(unsigned).collect(),
    }
}

/// Code of the slab's full depth.
pub(super) const DEEPEST: f32 = 65534.0;

/// Empty texels beside others take after the first of them.
fn continued(texels: &[[f32; 4]], side: usize) -> Vec<[f32; 4]> {
    let beside = |i: usize| {
        let (x, y) = (i % side, i / side);
        [
            (x > 0).then(|| i - 1),
            (x + 1 < side).then(|| i + 1),
            (y > 0).then(|| i - side),
            (y + 1 < side).then(|| i + side),
        ]
    };
    let of = |i: usize| {
        if texels[i][3] != 0.0 {
            return texels[i];
        }
        let mut around = beside(i).into_iter().flatten().map(|k| texels[k]);
        around.find(|t| t[3] != 0.0).unwrap_or(texels[i])
    };
    (0..texels.len()).map(of).collect()
}

/// What the shaders read of it: normal as two signed 16 bits, depth.
pub(super) fn words(image: &ReceiverImage, side: usize) -> Vec<[u32; 2]> {
    if image.depths.len() != side * side || image.normals.len() != side * side {
        return vec![[0, 0]; side * side];
    }
    let word = |(n, d): (&[i16; 2], &u16)| {
        let [x, y] = n.map(|v| u32::from(v.cast_unsigned()));
        [x | (y << 16), u32::from(*d)]
    };
    image.normals.iter().zip(&image.depths).map(word).collect()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]
    use super::*;

    #[test]
    fn surfaces_go_on_beyond_their_outlines_and_no_further() {
        let mut seen = vec![[0.0; 4]; 64];
        seen[27] = [0.5, -0.25, 0.125, 1.0];
        let image = receiver_image(&seen, 8);
        let there = |x: usize, y: usize| image.depths[8 * y + x] != ReceiverImage::NOTHING;
        assert!(there(3, 3) && there(5, 3) && there(3, 1) && there(4, 4));
        assert!(!there(6, 3) && !there(5, 5));
        let [word, depth] = words(&image, 8)[27];
        assert_eq!(depth, (0.125 * DEEPEST).round() as u32);
        assert_eq!((word & 0xffff) as u16 as i16, 16384);
        assert_eq!((word >> 16) as u16 as i16, -8192);
    }
}
