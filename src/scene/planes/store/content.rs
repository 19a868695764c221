//! Unpacked content of a bake's file, and its checks.

use crate::planes::{
    Bake, BakeSettings, Basis, Image, Layer, Receiver, ReceiverImage, ShadowingPlane,
};
use glam::{DVec2, DVec3};

/// Maxima of a bake; nothing larger is allocated.
const MAX_PLANES: usize = 1000;
const MAX_RESOLUTION: u32 = 1024;
const MAX_FREQUENCY: u32 = 16;
const MAX_SAMPLES: u32 = 4096;
const MAX_PARTS: u32 = 100_000;
const CUT_SHORT: &str = "its content is cut short";

/// Number of faces of the dome's upper half.
fn lights(frequency: u32) -> usize {
    10 * (frequency * frequency) as usize
}

/// Checks that a bake is consistent.
///
/// # Errors
/// The inconsistency in words.
pub(super) fn check(bake: &Bake) -> Result<(), String> {
    check_settings(&bake.settings)?;
    let planes = bake.planes.len();
    if planes > MAX_PLANES {
        return Err(format!("it has {planes} planes, more than {MAX_PLANES}"));
    }
    if bake.receivers.len() != planes {
        return Err("it has not one receiver for each plane".into());
    }
    if bake.images.len() != planes * lights(bake.settings.frequency) {
        return Err("it has not one image for each plane and light".into());
    }
    if !bake.planes.iter().all(is_plane) {
        return Err("one of its planes is invalid".into());
    }
    let texels = (bake.settings.resolution * bake.settings.resolution) as usize;
    let fits = |r: &ReceiverImage| {
        r.normals.len() == r.depths.len() && (r.depths.is_empty() || r.depths.len() == texels)
    };
    if !bake.receivers.iter().all(fits) || !bake.texels.len().is_multiple_of(texels) {
        return Err("one of its images has the wrong size".into());
    }
    let stored = bake.texels.len() / texels;
    let known = |i: Image| !matches!(i, Image::Stored(n) if n as usize >= stored);
    if !bake
        .images
        .iter()
        .all(|b| known(b.past_all) && known(b.past_phantoms))
    {
        return Err("it refers to a missing image".into());
    }
    Ok(())
}

fn check_settings(settings: &BakeSettings) -> Result<(), String> {
    let BakeSettings {
        resolution,
        frequency,
        samples,
    } = *settings;
    if !(4..=MAX_RESOLUTION).contains(&resolution) || !resolution.is_multiple_of(4) {
        return Err(format!(
            "{resolution} texels along a side are no multiple of 4 up to {MAX_RESOLUTION}"
        ));
    }
    if !(1..=MAX_FREQUENCY).contains(&frequency) || !(1..=MAX_SAMPLES).contains(&samples) {
        return Err(format!(
            "a dome of frequency {frequency} with {samples} samples is not known"
        ));
    }
    Ok(())
}

fn is_plane(plane: &ShadowingPlane) -> bool {
    let unit = |v: DVec3| (v.length() - 1.0).abs() < 1e-6;
    plane.centre.is_finite()
        && unit(plane.right)
        && unit(plane.up)
        && plane.right.dot(plane.up).abs() < 1e-6
        && plane.half_size.is_finite()
        && plane.half_size.min_element() > 0.0
        && plane.depth.is_finite()
        && plane.depth > 0.0
}

/// Encodes the content.
pub(super) fn write(bake: &Bake) -> Vec<u8> {
    let mut out = Vec::with_capacity(bake.texels.len() + 4096);
    let count = |out: &mut Vec<u8>, n: usize| out.extend((n as u32).to_le_bytes());
    let BakeSettings {
        resolution,
        frequency,
        samples,
    } = bake.settings;
    for n in [resolution, frequency, samples] {
        out.extend(n.to_le_bytes());
    }
    count(&mut out, bake.planes.len());
    for plane in &bake.planes {
        write_plane(&mut out, plane);
    }
    for receiver in &bake.receivers {
        count(&mut out, receiver.depths.len());
        out.extend(
            receiver
                .normals
                .iter()
                .flatten()
                .flat_map(|n| n.to_le_bytes()),
        );
        out.extend(receiver.depths.iter().flat_map(|d| d.to_le_bytes()));
    }
    for image in bake
        .images
        .iter()
        .flat_map(|b| [b.past_all, b.past_phantoms])
    {
        // Two indices that no stored image has encode the images that are not stored.
        let code = match image {
            Image::Black => u32::MAX,
            Image::White => u32::MAX - 1,
            Image::Stored(n) => n,
        };
        out.extend(code.to_le_bytes());
    }
    out.extend((bake.texels.len() as u64).to_le_bytes());
    out.extend(&bake.texels);
    out
}

/// Encodes a plane, for files and keys.
pub(super) fn write_plane(out: &mut Vec<u8>, plane: &ShadowingPlane) {
    for v in [plane.centre, plane.right, plane.up] {
        out.extend(v.to_array().iter().flat_map(|x| x.to_le_bytes()));
    }
    for x in [plane.half_size.x, plane.half_size.y, plane.depth] {
        out.extend(x.to_le_bytes());
    }
    out.push(match plane.layer {
        Layer::Real => 0,
        Layer::Virtual => 1,
    });
    out.push(match plane.receiver {
        Receiver::Plane => 0,
        Receiver::Surface => 1,
    });
    out.extend((plane.parts.len() as u32).to_le_bytes());
    out.extend(plane.parts.iter().flat_map(|p| p.to_le_bytes()));
}

/// Decodes the content. The result must be checked by [`check`].
pub(super) fn read(raw: &[u8], key: [u8; 32]) -> Result<Bake, String> {
    let mut bytes = Bytes::new(raw);
    let settings = BakeSettings {
        resolution: bytes.u32()?,
        frequency: bytes.u32()?,
        samples: bytes.u32()?,
    };
    check_settings(&settings)?;
    let count = bytes.count(MAX_PLANES as u32, 1)?;
    let planes = (0..count)
        .map(|_| read_plane(&mut bytes))
        .collect::<Result<_, _>>()?;
    let receivers = (0..count)
        .map(|_| read_receiver(&mut bytes))
        .collect::<Result<_, _>>()?;
    let lights = lights(settings.frequency);
    let images = (0..count * lights)
        .map(|_| {
            Ok(Basis {
                past_all: read_image(&mut bytes)?,
                past_phantoms: read_image(&mut bytes)?,
            })
        })
        .collect::<Result<_, String>>()?;
    let length = usize::try_from(bytes.u64()?).map_err(|_| CUT_SHORT)?;
    let texels = bytes.take(length)?.to_vec();
    if !bytes.rest.is_empty() {
        return Err("its content is too long".into());
    }
    Ok(Bake {
        key,
        settings,
        planes,
        receivers,
        images,
        texels,
    })
}

fn read_plane(bytes: &mut Bytes) -> Result<ShadowingPlane, String> {
    let mut vector = || Ok::<_, String>(DVec3::new(bytes.f64()?, bytes.f64()?, bytes.f64()?));
    let (centre, right, up) = (vector()?, vector()?, vector()?);
    let half_size = DVec2::new(bytes.f64()?, bytes.f64()?);
    let depth = bytes.f64()?;
    let layer = match bytes.u8()? {
        0 => Layer::Real,
        1 => Layer::Virtual,
        other => return Err(format!("one of its planes has a layer {other}")),
    };
    let receiver = match bytes.u8()? {
        0 => Receiver::Plane,
        1 => Receiver::Surface,
        other => return Err(format!("one of its planes has a receiver {other}")),
    };
    let count = bytes.count(MAX_PARTS, 4)?;
    let parts = (0..count).map(|_| bytes.u32()).collect::<Result<_, _>>()?;
    Ok(ShadowingPlane {
        centre,
        right,
        up,
        half_size,
        depth,
        layer,
        receiver,
        parts,
    })
}

fn read_receiver(bytes: &mut Bytes) -> Result<ReceiverImage, String> {
    let count = bytes.count(MAX_RESOLUTION * MAX_RESOLUTION, 6)?;
    let pair = |b: &[u8; 4]| {
        [
            i16::from_le_bytes([b[0], b[1]]),
            i16::from_le_bytes([b[2], b[3]]),
        ]
    };
    let normals = bytes
        .take(4 * count)?
        .as_chunks()
        .0
        .iter()
        .map(pair)
        .collect();
    let depths = bytes
        .take(2 * count)?
        .as_chunks()
        .0
        .iter()
        .map(|b| u16::from_le_bytes(*b))
        .collect();
    Ok(ReceiverImage { normals, depths })
}

fn read_image(bytes: &mut Bytes) -> Result<Image, String> {
    Ok(match bytes.u32()? {
        u32::MAX => Image::Black,
        n if n == u32::MAX - 1 => Image::White,
        n => Image::Stored(n),
    })
}

/// Reader of bytes.
pub(super) struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    pub fn new(rest: &'a [u8]) -> Self {
        Self { rest }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.rest.split_at_checked(count).ok_or(CUT_SHORT)?;
        self.rest = rest;
        Ok(taken)
    }

    pub fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (taken, rest) = self.rest.split_first_chunk().ok_or(CUT_SHORT)?;
        self.rest = rest;
        Ok(*taken)
    }

    fn u8(&mut self) -> Result<u8, String> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    pub fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub fn u64(&mut self) -> Result<u64, String> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    fn f64(&mut self) -> Result<f64, String> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// Reads a count, at most `max`, of items of at least `size` bytes each that must follow.
    fn count(&mut self, max: u32, size: usize) -> Result<usize, String> {
        let count = self.u32()?;
        if count > max {
            return Err(format!("a count is {count}, more than {max}"));
        }
        if count as usize * size > self.rest.len() {
            return Err(CUT_SHORT.into());
        }
        Ok(count as usize)
    }
}
