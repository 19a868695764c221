//! Baked data: receivers of the planes, and one basis image per plane and light.

use super::ShadowingPlane;

/// Settings of a bake.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeSettings {
    /// Texels along a side of a basis image; a multiple of 4 (128 in the papers).
    pub resolution: u32,
    /// Frequency of the geodesic dome; 2 gives the papers' 40 lights.
    pub frequency: u32,
    /// Directions per face of the dome; 1 is only its centre, as in the papers.
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

/// Surfaces that a plane's camera sees. Rows from the plane's upper edge downwards, columns to its
/// right; `resolution²` texels, or none if the receiver is the plane itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReceiverImage {
    /// World normals, octahedral (Cigolle et al. 2014), signed normalised 16 bits.
    pub normals: Vec<[i16; 2]>,
    /// Distance behind the plane as a share of [`ShadowingPlane::depth`], unsigned normalised 16 bits;
    /// [`ReceiverImage::NOTHING`] without a surface.
    pub depths: Vec<u16>,
}

impl ReceiverImage {
    /// Depth of a texel without a surface.
    pub const NOTHING: u16 = u16::MAX;
}

/// Light of one dome face of unit irradiance that does not arrive, per texel: a − Ib of the papers,
/// `cos θ · (1 − V)`. Summing the blocked light saves more images than summing the arriving light,
/// and unshadowed surfaces are lit exactly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Image {
    /// All light is blocked at every texel. Not stored; it follows from the cosine.
    Black,
    /// No light is blocked. Not stored and not summed.
    White,
    /// Index of the image in [`Bake::texels`].
    Stored(u32),
}

/// Images of one light on one plane. Both are black if no texel faces the light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Basis {
    /// Blocked by virtual objects and phantoms.
    pub past_all: Image,
    /// Blocked by phantoms only; unused and white on the virtual layer.
    pub past_phantoms: Image,
}

/// A complete bake.
#[derive(Clone, Debug, PartialEq)]
pub struct Bake {
    /// SHA-256 of the method's version, geometry, planes and settings.
    pub key: [u8; 32],
    /// Settings.
    pub settings: BakeSettings,
    /// The planes; those of the real layer come first.
    pub planes: Vec<ShadowingPlane>,
    /// Receiver of each plane.
    pub receivers: Vec<ReceiverImage>,
    /// Images of all lights for each plane, in the order of the dome's faces. An image in which no
    /// light arrives at any texel that faces it is [`Image::Black`].
    pub images: Vec<Basis>,
    /// The stored images: blocked light, 0 to 255, `resolution²` bytes each.
    pub texels: Vec<u8>,
}

impl Bake {
    /// Number of lights.
    #[must_use]
    pub fn lights(&self) -> usize {
        self.images.len() / self.planes.len().max(1)
    }

    /// Number of basis images in which light arrives, and of all images.
    #[must_use]
    pub fn counts(&self) -> (usize, usize) {
        let lit = |b: &&Basis| b.past_all != Image::Black;
        (self.images.iter().filter(lit).count(), self.images.len())
    }
}
