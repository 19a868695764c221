//! A plane's receiver image, from the picture that its camera rendered.

use penumbra_scene::planes::ReceiverImage;

/// Distance by which surfaces are extended beyond their outlines, texels: bilinear look-ups next to
/// an outline must not mix in empty texels.
const MARGIN_TEXELS: usize = 2;

/// Encodes a rendered picture of `side²` texels: octahedral normal, depth, and 1, or 0 in empty
/// texels.
pub(super) fn receiver_image(rendered: &[[f32; 4]], side: usize) -> ReceiverImage {
    let mut texels = rendered.to_vec();
    for _ in 0..MARGIN_TEXELS {
        texels = extended(&texels, side);
    }
    let signed = |v: f32| (v.clamp(-1.0, 1.0) * 32767.0).round() as i16;
    let unsigned = |t: &[f32; 4]| {
        if t[3] == 0.0 {
            ReceiverImage::NOTHING
        } else {
            (t[2].clamp(0.0, 1.0) * MAX_DEPTH_CODE).round() as u16
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
pub(super) const MAX_DEPTH_CODE: f32 = 65534.0;

/// Fills each empty texel with the first of its neighbours that is not empty.
fn extended(texels: &[[f32; 4]], side: usize) -> Vec<[f32; 4]> {
    let neighbours = |i: usize| {
        let (x, y) = (i % side, i / side);
        [
            (x > 0).then(|| i - 1),
            (x + 1 < side).then(|| i + 1),
            (y > 0).then(|| i - side),
            (y + 1 < side).then(|| i + side),
        ]
    };
    let fill = |i: usize| {
        if texels[i][3] != 0.0 {
            return texels[i];
        }
        let mut around = neighbours(i).into_iter().flatten().map(|k| texels[k]);
        around.find(|t| t[3] != 0.0).unwrap_or(texels[i])
    };
    (0..texels.len()).map(fill).collect()
}

/// Returns the image as the shaders read it: the normal as two signed 16-bit numbers, the depth.
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
    use super::*;

    #[test]
    fn extends_surfaces_beyond_their_outlines_by_the_margin() {
        let mut rendered = vec![[0.0; 4]; 64];
        rendered[27] = [0.5, -0.25, 0.125, 1.0];
        let image = receiver_image(&rendered, 8);
        let is_filled = |x: usize, y: usize| image.depths[8 * y + x] != ReceiverImage::NOTHING;
        assert!(is_filled(3, 3) && is_filled(5, 3) && is_filled(3, 1) && is_filled(4, 4));
        assert!(!is_filled(6, 3) && !is_filled(5, 5));
        let [word, depth] = words(&image, 8)[27];
        assert_eq!(depth, (0.125 * MAX_DEPTH_CODE).round() as u32);
        assert_eq!((word & 0xffff) as u16 as i16, 16384);
        assert_eq!((word >> 16) as u16 as i16, -8192);
    }
}
