//! Environment maps from files: equirectangular pictures of linear radiance, as Radiance HDR or
//! OpenEXR.

use super::cube::face_direction;
use super::equirect::Equirect;
use exr::prelude::{ReadChannels, ReadLayers};
use glam::Vec3;
use image::ImageDecoder;
use image::codecs::hdr::HdrDecoder;
use penumbra_picture::read_bounded;
use std::io::{self, Cursor};
use std::path::{Path, PathBuf};

/// Maximum size of a file, bytes.
const MAX_FILE_BYTES: u64 = 512 << 20;
/// Maximum height of a map, pixels: one of 16384 × 8192.
const MAX_ROWS: u32 = 8192;
/// Values beyond this are limited: a half-float file's largest is 65504, and the sun's disc is
/// written with up to about this much where white is 1.
const MAX_RADIANCE: f32 = 1e6;
/// Maximum samples along a texel's side.
const MAX_SAMPLES: u32 = 32;

/// Why a map cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum EnvironmentMapError {
    /// The file cannot be read.
    #[error("{path}: cannot be read ({source})", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// The file is neither a Radiance HDR nor an OpenEXR picture, or it is damaged.
    #[error(
        "{path}: no environment map ({reason}); name a Radiance HDR (.hdr) or OpenEXR (.exr) picture",
        path = path.display()
    )]
    Format {
        /// The file.
        path: PathBuf,
        /// The reader's message.
        reason: String,
    },
    /// The picture is not twice as wide as high, or too large.
    #[error(
        "{path}: {width}x{height} pixels; an equirectangular map is twice as wide as high, with 4 to {MAX_ROWS} \
         rows",
        path = path.display()
    )]
    Size {
        /// The file.
        path: PathBuf,
        /// Width, pixels.
        width: usize,
        /// Height, pixels.
        height: usize,
    },
}

/// Reads an equirectangular map: Radiance HDR, or the first layer of an OpenEXR file with the
/// channels R, G, B. Its middle column is +X, the column at a quarter of its width +Y, the top row
/// +Z. Negative values and values that are no number become 0.
///
/// # Errors
/// The file cannot be read, is larger than 512 MiB, is neither of the two, is damaged, or the
/// picture is not twice as wide as high with 4 to 8192 rows.
pub fn read_environment_map(path: &Path) -> Result<Equirect, EnvironmentMapError> {
    let bytes = read_bounded(path, MAX_FILE_BYTES).map_err(|source| EnvironmentMapError::Read {
        path: path.to_owned(),
        source,
    })?;
    let (width, height, texels) = if bytes.starts_with(&EXR_MAGIC) {
        read_exr(path, &bytes)?
    } else {
        read_hdr(path, &bytes)?
    };
    let limited = |t: Vec3| Vec3::from_array(t.to_array().map(limited));
    Ok(Equirect {
        width,
        height,
        texels: texels.into_iter().map(limited).collect(),
    })
}

const EXR_MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

type Pixels = (u32, u32, Vec<Vec3>);

fn limited(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else {
        value.clamp(0.0, MAX_RADIANCE)
    }
}

/// Checks a size before memory is taken for it.
fn checked_size(
    path: &Path,
    width: usize,
    height: usize,
) -> Result<(u32, u32), EnvironmentMapError> {
    let fits = width == 2 * height && (4..=MAX_ROWS as usize).contains(&height);
    if fits {
        return Ok((width as u32, height as u32));
    }
    Err(EnvironmentMapError::Size {
        path: path.to_owned(),
        width,
        height,
    })
}

fn format_error(path: &Path, reason: impl ToString) -> EnvironmentMapError {
    EnvironmentMapError::Format {
        path: path.to_owned(),
        reason: reason.to_string(),
    }
}

fn read_hdr(path: &Path, bytes: &[u8]) -> Result<Pixels, EnvironmentMapError> {
    let decoder = HdrDecoder::new(Cursor::new(bytes)).map_err(|e| format_error(path, e))?;
    let metadata = decoder.metadata();
    let (width, height) = checked_size(path, metadata.width as usize, metadata.height as usize)?;
    let mut samples = vec![0; usize::try_from(decoder.total_bytes()).unwrap_or(0)];
    decoder
        .read_image(&mut samples)
        .map_err(|e| format_error(path, e))?;
    let value = |b: &[u8]| f32::from_ne_bytes([b[0], b[1], b[2], b[3]]);
    let texels = samples
        .chunks_exact(12)
        .map(|t| Vec3::new(value(t), value(&t[4..]), value(&t[8..])))
        .collect();
    Ok((width, height, texels))
}

fn read_exr(path: &Path, bytes: &[u8]) -> Result<Pixels, EnvironmentMapError> {
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), true)
        .map_err(|e| format_error(path, e))?;
    let Some(header) = meta.headers.first() else {
        return Err(format_error(path, "it has no layer"));
    };
    let size = header.layer_size;
    let (width, height) = checked_size(path, size.width(), size.height())?;
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size.width(), vec![Vec3::ZERO; size.area()]),
            |(width, texels), at, (r, g, b): (f32, f32, f32)| {
                let texel = texels.get_mut(at.y() * *width + at.x());
                if let Some(texel) = texel {
                    *texel = Vec3::new(r, g, b);
                }
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|e| format_error(path, e))?;
    let (found, texels) = image.layer_data.channel_data.pixels;
    if (found, texels.len()) != (width as usize, width as usize * height as usize) {
        return Err(format_error(path, "its layers differ in size"));
    }
    Ok((width, height, texels))
}

impl Equirect {
    /// Resamples the map, turned by `yaw` radians about +Z (counterclockwise from above) and
    /// multiplied by `factor`, to the texels of a cube of `size` texels along a side. Samples are
    /// at most half a pixel of the map apart, so that a source of one pixel keeps its energy.
    #[must_use]
    pub fn to_cube(&self, size: u32, yaw: f32, factor: f32) -> Vec<Vec3> {
        let turned = glam::Quat::from_rotation_z(-yaw);
        let n = (self.width.div_ceil(2 * size)).clamp(2, MAX_SAMPLES);
        let texel = |i: u32| {
            let (face, y, x) = ((i / (size * size)) as usize, i / size % size, i % size);
            let (mut sum, mut total) = (Vec3::ZERO, 0.0);
            for (b, a) in (0..n * n).map(|k| (k / n, k % n)) {
                let at = |p: u32, k: u32| {
                    (f64::from(p) + (f64::from(k) + 0.5) / f64::from(n)) / f64::from(size)
                };
                let direction = face_direction(face, at(x, a), at(y, b)).as_vec3();
                // The sample's share of the texel's solid angle.
                let weight = direction.abs().max_element().powi(3);
                sum += self.sample(turned * direction) * weight;
                total += weight;
            }
            sum * (factor / total)
        };
        (0..6 * size * size).map(texel).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cube::CubeGrid;

    /// 1 everywhere, and a lamp of three pixels in a row, near +Y.
    fn with_lamp() -> Equirect {
        let mut map = Equirect::from_fn(64, |_| Vec3::ONE);
        for x in 31..34 {
            map.texels[20 * 128 + x] = Vec3::new(300.0, 200.0, 100.0);
        }
        map
    }

    fn flux(texels: &[Vec3], size: u32) -> (Vec3, Vec3) {
        let grid = CubeGrid::new(size);
        let each = texels.iter().zip(&grid.solid_angles);
        let directed = each.zip(&grid.directions);
        directed.fold((Vec3::ZERO, Vec3::ZERO), |(sum, towards), ((l, w), d)| {
            (sum + *l * *w, towards + *d * (l.x * w))
        })
    }

    #[test]
    fn radiance_hdr_and_exr_give_the_same_map() {
        let folder = tempfile::tempdir().unwrap();
        let map = with_lamp();
        let (exr, hdr) = (folder.path().join("a.exr"), folder.path().join("a.hdr"));
        let texel = |x: usize, y: usize| map.texels[y * 128 + x].into();
        exr::prelude::write_rgb_file(&exr, 128, 64, texel).unwrap();
        let pixels: Vec<_> = map
            .texels
            .iter()
            .map(|t| image::Rgb(t.to_array()))
            .collect();
        image::codecs::hdr::HdrEncoder::new(std::fs::File::create(&hdr).unwrap())
            .encode(&pixels, 128, 64)
            .unwrap();
        assert_eq!(read_environment_map(&exr).unwrap(), map);
        let coarse = read_environment_map(&hdr).unwrap();
        let far = |(a, b): (&Vec3, &Vec3)| (*a - *b).abs().max_element() > 0.01 * a.max_element();
        assert!(!map.texels.iter().zip(&coarse.texels).any(far));
    }

    #[test]
    fn cube_keeps_energy_and_direction_and_turns() {
        let map = with_lamp();
        let (before, _) = flux(&map.to_cube(64, 0.0, 1.0), 64);
        let pixel = std::f32::consts::TAU / 128.0;
        let theta = std::f32::consts::PI * 20.5 / 64.0;
        let lamp = 3.0 * Vec3::new(299.0, 199.0, 99.0) * pixel * pixel * theta.sin();
        let expected = Vec3::splat(4.0 * std::f32::consts::PI) + lamp;
        assert!(
            (before / expected - Vec3::ONE).abs().max_element() < 0.01,
            "{before}"
        );
        let towards = |yaw: f32| flux(&map.to_cube(64, yaw, 2.0), 64).1.normalize();
        assert!(towards(0.0).y > 0.8 && towards(0.0).z > 0.4);
        assert!(
            towards(-std::f32::consts::FRAC_PI_2).x > 0.8,
            "clockwise from +Y to +X"
        );
    }

    #[test]
    fn files_that_are_no_maps_are_refused_without_their_size_in_memory() {
        let folder = tempfile::tempdir().unwrap();
        let refusal = |bytes: &[u8]| {
            let path = folder.path().join("map");
            std::fs::write(&path, bytes).unwrap();
            read_environment_map(&path).unwrap_err().to_string()
        };
        let huge = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1000000000 +X 2000000000\n";
        assert!(
            refusal(huge).contains("2000000000x1000000000"),
            "{}",
            refusal(huge)
        );
        let square = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 64\n";
        assert!(refusal(square).contains("twice as wide"));
        let cut = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 64 +X 128\n\x02\x02";
        assert!(refusal(cut).contains("no environment map"));
        assert!(refusal(&EXR_MAGIC).contains("no environment map"));
        assert!(refusal(b"\xff\xd8\xff").contains(".hdr"));
        let missing = read_environment_map(&folder.path().join("none.hdr"));
        assert!(missing.unwrap_err().to_string().contains("cannot be read"));
    }

    #[test]
    fn values_that_are_no_radiance_are_limited() {
        let found = [f32::NAN, -1.0, f32::INFINITY, 0.5].map(limited);
        assert_eq!(found, [0.0, 0.0, MAX_RADIANCE, 0.5]);
    }
}
