//! What is baked ahead of time: the planes' receivers and one basis image per plane and light.

use super::ShadowingPlane;

/// How it is baked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeSettings {
    /// Texels along a side of a basis image; a multiple of 4. The papers: 128.
    pub resolution: u32,
    /// Frequency of the geodesic dome; 2 gives the papers' 40 lights.
    pub frequency: u32,
    /// Directions per face of the dome; 1 is its centre alone, as in the papers.
    pub samples: u32,
}

impl Default for BakeSettings {
    fn default() -> Self {
        Self {
            resolution: 128,
            frequency: 2,
            samples: 1,
        }
    }
}

/// What a plane's camera sees of what it covers. Rows from the plane's upper edge down,
/// columns to its right; `resolution²` texels, or none where the receiver is the plane
/// itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReceiverImage {
    /// World normals, octahedral (Cigolle et al. 2014), signed normalised 16 bits.
    pub normals: Vec<[i16; 2]>,
    /// Metres behind the plane over [`ShadowingPlane::depth`], unsigned normalised 16 bits;
    /// [`ReceiverImage::NOTHING`] where no surface is.
    pub depths: Vec<u16>,
}

impl ReceiverImage {
    /// Depth of a texel behind which no surface is.
    pub const NOTHING: u16 = u16::MAX;
}

/// What one light of unit irradiance loses on its way, texel by texel: a − Ib of the papers,
/// `cos θ · (1 − V)`. What is not lost is left out of every sum, which spares more than leaving
/// out what is dark, and a surface that everything reaches is lit exactly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// Nothing arrives anywhere: all is lost. Not stored; the cosine alone tells it.
    Black,
    /// All of it arrives everywhere: nothing is lost. Not stored, and not summed.
    White,
    /// Number of the image in [`Bake::texels`].
    Stored(u32),
}

/// Both images of one light on one plane. Both are black where no texel faces the light: then
/// there is nothing to lose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Basis {
    /// Past virtual objects and phantoms.
    pub past_all: Image,
    /// Past phantoms alone; on the virtual layer it is not wanted, and white.
    pub past_phantoms: Image,
}

/// Everything that is baked.
#[derive(Clone, Debug, PartialEq)]
pub struct Bake {
    /// SHA-256 over the version of the method, all geometry, planes and settings.
    pub key: [u8; 32],
    /// How it was baked.
    pub settings: BakeSettings,
    /// The planes; those of the real layer come first.
    pub planes: Vec<ShadowingPlane>,
    /// What each plane's camera sees.
    pub receivers: Vec<ReceiverImage>,
    /// For each plane all lights, in the order of the dome's faces. An image in which no light
    /// arrives at any texel that faces it is [`Image::Black`].
    pub images: Vec<Basis>,
    /// The stored images: what is lost, 0 to 255, `resolution²` bytes each.
    pub texels: Vec<u8>,
}

impl Bake {
    /// Number of lights.
    #[must_use]
    pub fn lights(&self) -> usize {
        self.images.len() / self.planes.len().max(1)
    }

    /// Basis images in which light arrives, and all there could be.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        let lit = |b: &&Basis| b.past_all != Image::Black;
        (self.images.iter().filter(lit).count(), self.images.len())
    }
}
