//! A photograph with what its file says about the exposure, the lens and the colours.

use crate::error::PhotoError;
use exif::{Exif, In, Tag, Value};
use glam::DVec2;
use image::{ImageDecoder, ImageReader};
use moxcms::{ColorProfile, Layout, TransformOptions};
use penumbra_lighting::photograph::read_picture_file;
use penumbra_picture::Picture;
use std::io::Cursor;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

/// Diagonal of the 35 mm film that `FocalLengthIn35mmFilm` refers to, millimetres.
const FILM_DIAGONAL_MM: f64 = 43.267;

/// Longer side of a picture, focal lengths, of lenses that EXIF is believed: 5° to 140°, as `--fov`.
const LENSES: RangeInclusive<f64> = 0.0873..=5.495;

/// A photograph: upright, with the codes of sRGB.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// The file, for messages.
    pub path: PathBuf,
    /// The picture, turned as EXIF's orientation demands.
    pub picture: Picture,
    /// Exposure in stops: log2 of exposure time (s) × ISO / 100 / f-number². `None` without EXIF.
    pub exposure_ev: Option<f64>,
    /// Focal length, pixels of `picture`. `None` without EXIF, or where it is no lens's.
    pub focal: Option<f64>,
    /// Name of the colour profile that was converted to sRGB, if there was another one.
    pub profile: Option<String>,
}

impl Photograph {
    /// Reads a JPEG or PNG file.
    ///
    /// # Errors
    /// The file cannot be read, or is not a JPEG or PNG picture.
    pub fn read(path: &Path) -> Result<Self, PhotoError> {
        let (bytes, mut picture) = read_picture_file(path)?;
        let exif = exif::Reader::new()
            .read_from_container(&mut Cursor::new(&bytes))
            .ok();
        let embedded = icc_profile(&bytes).and_then(|icc| ColorProfile::new_from_slice(&icc).ok());
        let stated = || {
            exif.as_ref()
                .is_some_and(is_adobe_rgb)
                .then(ColorProfile::new_adobe_rgb)
        };
        let profile = embedded
            .or_else(stated)
            .and_then(|profile| to_srgb(&profile, &mut picture));
        let side = f64::from(picture.width.max(picture.height));
        let is_lens = |focal: &f64| LENSES.contains(&(side / focal));
        let focal = exif
            .as_ref()
            .and_then(|e| focal(e, &picture).filter(is_lens));
        if let Some(exif) = &exif {
            let orientation = number(exif, Tag::Orientation).unwrap_or(1.0);
            picture = upright(picture, orientation as u32);
        }
        Ok(Self {
            path: path.to_owned(),
            picture,
            exposure_ev: exif.as_ref().and_then(exposure_ev),
            focal,
            profile,
        })
    }

    /// Middle of the picture, pixels; (0, 0) is the centre of the top-left pixel.
    #[must_use]
    pub fn middle(&self) -> DVec2 {
        let size = DVec2::new(
            f64::from(self.picture.width),
            f64::from(self.picture.height),
        );
        (size - 1.0) / 2.0
    }

    /// Reduces the picture to at most `max_side` pixels along its longer side, by whole blocks. Returns the side of
    /// a block, pixels.
    pub fn reduce(&mut self, max_side: u32) -> u32 {
        let side = self.picture.width.max(self.picture.height);
        let factor = side.div_ceil(max_side.max(1)).max(1);
        if factor > 1 {
            self.picture = reduced(&self.picture, factor);
            self.focal = self.focal.map(|f| f / f64::from(factor));
        }
        factor
    }
}

/// Returns a picture whose pixels are the means of `factor` × `factor` codes.
pub(crate) fn reduced(picture: &Picture, factor: u32) -> Picture {
    let (width, height) = (picture.width / factor, picture.height / factor);
    let mut rgba = Vec::with_capacity(4 * width as usize * height as usize);
    let n = factor * factor;
    for y in 0..height {
        for x in 0..width {
            let mut sum = [0u32; 3];
            for i in 0..n {
                let rgb = picture.rgb(x * factor + i % factor, y * factor + i / factor);
                for (s, code) in sum.iter_mut().zip(rgb) {
                    *s += u32::from(code);
                }
            }
            rgba.extend(sum.map(|s| ((s + n / 2) / n) as u8));
            rgba.push(255);
        }
    }
    Picture {
        width,
        height,
        rgba,
    }
}

fn number(exif: &Exif, tag: Tag) -> Option<f64> {
    let field = exif.get_field(tag, In::PRIMARY)?;
    let value = match &field.value {
        Value::Rational(values) => values.first().map(exif::Rational::to_f64),
        Value::SRational(values) => values.first().map(exif::SRational::to_f64),
        Value::Float(values) => values.first().copied().map(f64::from),
        Value::Double(values) => values.first().copied(),
        value => value.get_uint(0).map(f64::from),
    };
    value.filter(|v| v.is_finite() && *v > 0.0)
}

/// Returns log2 of time × ISO / 100 / f-number²; without an f-number (phones of fixed aperture may
/// leave it out) or ISO, these are taken as equal in all pictures.
fn exposure_ev(exif: &Exif) -> Option<f64> {
    let time = number(exif, Tag::ExposureTime)?;
    let iso = number(exif, Tag::PhotographicSensitivity).unwrap_or(100.0);
    let aperture = number(exif, Tag::FNumber).unwrap_or(1.0);
    let ev = (time * iso / 100.0 / (aperture * aperture)).log2();
    ev.is_finite().then_some(ev)
}

/// Returns the focal length in pixels. The equivalent for 35 mm film relates to the diagonal
/// (CIPA DCG-001); otherwise the pitch of the sensor's pixels is needed.
fn focal(exif: &Exif, picture: &Picture) -> Option<f64> {
    let (w, h) = (f64::from(picture.width), f64::from(picture.height));
    if let Some(equivalent) = number(exif, Tag::FocalLengthIn35mmFilm) {
        return Some(equivalent / FILM_DIAGONAL_MM * w.hypot(h));
    }
    let millimetres = number(exif, Tag::FocalLength)?;
    let resolution = number(exif, Tag::FocalPlaneXResolution)?;
    // 2 is inches, 3 centimetres, 4 millimetres; inches without the tag.
    let unit = match number(exif, Tag::FocalPlaneResolutionUnit).map(|u| u as u32) {
        Some(3) => 10.0,
        Some(4) => 1.0,
        _ => 25.4,
    };
    // The resolution is that of the picture as it was taken.
    let taken = number(exif, Tag::PixelXDimension).unwrap_or(w);
    Some(millimetres * resolution / unit * w / taken)
}

/// Turns a picture as EXIF's orientation (1 to 8) demands.
fn upright(picture: Picture, orientation: u32) -> Picture {
    let (w, h) = (picture.width, picture.height);
    let is_turned = (5..=8).contains(&orientation);
    let (width, height) = if is_turned { (h, w) } else { (w, h) };
    let from = |x: u32, y: u32| match orientation {
        2 => (w - 1 - x, y),
        3 => (w - 1 - x, h - 1 - y),
        4 => (x, h - 1 - y),
        5 => (y, x),
        6 => (y, h - 1 - x),
        7 => (w - 1 - y, h - 1 - x),
        8 => (w - 1 - y, x),
        _ => (x, y),
    };
    if !(2..=8).contains(&orientation) {
        return picture;
    }
    let mut rgba = Vec::with_capacity(picture.rgba.len());
    for y in 0..height {
        for x in 0..width {
            let (u, v) = from(x, y);
            rgba.extend(picture.rgb(u, v));
            rgba.push(255);
        }
    }
    Picture {
        width,
        height,
        rgba,
    }
}

/// Returns the ICC profile of a JPEG or PNG file.
fn icc_profile(bytes: &[u8]) -> Option<Vec<u8>> {
    let reader = ImageReader::new(Cursor::new(bytes));
    let mut decoder = reader.with_guessed_format().ok()?.into_decoder().ok()?;
    decoder.icc_profile().ok()?
}

/// Whether the file's EXIF says Adobe RGB, as cameras do that add no profile: "uncalibrated", with the file name of
/// Adobe RGB's option of DCF 2.0 (CIPA DC-009-2010, section 4.8.2).
fn is_adobe_rgb(exif: &Exif) -> bool {
    let is_uncalibrated = number(exif, Tag::ColorSpace) == Some(65_535.0);
    let index = exif.get_field(Tag::InteroperabilityIndex, In::PRIMARY);
    let is_option = index.is_some_and(|field| match &field.value {
        Value::Ascii(texts) => texts.iter().any(|text| text.starts_with(b"R03")),
        _ => false,
    });
    is_uncalibrated && is_option
}

/// Converts the codes of a picture to sRGB. Returns the profile's name unless it is sRGB itself, or
/// none that can be used.
fn to_srgb(profile: &ColorProfile, picture: &mut Picture) -> Option<String> {
    let name = match profile.description.as_ref()? {
        moxcms::ProfileText::PlainString(text) => text.clone(),
        moxcms::ProfileText::Localizable(texts) => texts.first()?.value.clone(),
        moxcms::ProfileText::Description(text) => text.ascii_string.clone(),
    };
    if name.contains("sRGB") {
        return None;
    }
    let srgb = ColorProfile::new_srgb();
    let options = TransformOptions::default();
    let transform = profile
        .create_transform_8bit(Layout::Rgba, &srgb, Layout::Rgba, options)
        .ok()?;
    let mut converted = vec![255; picture.rgba.len()];
    transform.transform(&picture.rgba, &mut converted).ok()?;
    picture.rgba = converted;
    let is_plain = |c: &char| !c.is_control();
    Some(name.chars().filter(is_plain).take(40).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use exif::Field;
    use exif::experimental::Writer;
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    fn numbered(width: u32, height: u32) -> Picture {
        let rgba = (0..width * height).flat_map(|i| [i as u8, 0, 0, 255]);
        Picture {
            width,
            height,
            rgba: rgba.collect(),
        }
    }

    #[test]
    fn orientation_6_shows_the_left_column_on_top() {
        let turned = upright(numbered(3, 2), 6);
        assert_eq!((turned.width, turned.height), (2, 3));
        let codes: Vec<u8> = turned.rgba.chunks(4).map(|p| p[0]).collect();
        assert_eq!(codes, [3, 0, 4, 1, 5, 2]);
        let back = upright(turned, 8);
        assert_eq!(back, numbered(3, 2));
    }

    #[test]
    fn every_orientation_keeps_all_pixels() {
        for orientation in 0..=9 {
            let mut codes: Vec<u8> = upright(numbered(5, 3), orientation)
                .rgba
                .chunks(4)
                .map(|p| p[0])
                .collect();
            codes.sort_unstable();
            assert_eq!(codes, (0..15).collect::<Vec<u8>>(), "{orientation}");
        }
    }

    #[test]
    fn wide_colours_are_converted_and_srgb_is_left_alone() {
        let red = Picture {
            width: 1,
            height: 1,
            rgba: vec![200, 90, 40, 255],
        };
        for (profile, known) in [
            (ColorProfile::new_display_p3(), "P3"),
            (ColorProfile::new_adobe_rgb(), "Adobe"),
        ] {
            let mut wide = red.clone();
            let name = to_srgb(&profile, &mut wide).unwrap();
            assert!(name.contains(known), "{name}");
            // The primaries are outside of sRGB: the same codes are a stronger colour.
            let [r, g, b] = wide.rgb(0, 0);
            assert!(r > 205 && g <= 90 && b < 40, "{r} {g} {b}");
        }
        let mut same = red.clone();
        assert_eq!(to_srgb(&ColorProfile::new_srgb(), &mut same), None);
        assert_eq!(same, red);
    }

    /// The files of both formats with the profile of Display P3.
    fn with_profile() -> [Vec<u8>; 2] {
        let profile = || ColorProfile::new_display_p3().encode().unwrap();
        let pixels = [200, 90, 40].repeat(64);
        let (mut png, mut jpeg) = (Vec::new(), Vec::new());
        let mut encoder = PngEncoder::new(&mut png);
        encoder.set_icc_profile(profile()).unwrap();
        let kind = ExtendedColorType::Rgb8;
        encoder.write_image(&pixels, 8, 8, kind).unwrap();
        let mut encoder = JpegEncoder::new_with_quality(&mut jpeg, 95);
        encoder.set_icc_profile(profile()).unwrap();
        encoder.write_image(&pixels, 8, 8, kind).unwrap();
        [png, jpeg]
    }

    #[test]
    fn profiles_of_both_formats_are_read_and_damage_is_no_panic() {
        let folder = tempfile::tempdir().unwrap();
        for (name, file) in ["wide.png", "wide.jpg"].iter().zip(with_profile()) {
            let path = folder.path().join(name);
            std::fs::write(&path, &file).unwrap();
            let photo = Photograph::read(&path).unwrap();
            assert!(photo.profile.unwrap().contains("P3"), "{name}");
            for end in 0..file.len() {
                let _ = icc_profile(&file[..end]);
            }
        }
        assert_eq!(icc_profile(b"abcdef"), None);
    }

    #[test]
    fn adobe_rgb_is_told_by_exif_without_a_profile() {
        let exif = |space: u16, option: &str| {
            let field = |tag, value| Field {
                tag,
                ifd_num: In::PRIMARY,
                value,
            };
            let all = [
                field(Tag::ColorSpace, Value::Short(vec![space])),
                field(
                    Tag::InteroperabilityIndex,
                    Value::Ascii(vec![option.as_bytes().to_vec()]),
                ),
            ];
            let mut writer = Writer::new();
            all.iter().for_each(|field| writer.push_field(field));
            let mut bytes = Cursor::new(Vec::new());
            writer.write(&mut bytes, false).unwrap();
            let reader = exif::Reader::new();
            reader.read_raw(bytes.into_inner()).unwrap()
        };
        assert!(is_adobe_rgb(&exif(65_535, "R03")));
        assert!(!is_adobe_rgb(&exif(65_535, "R98")));
        assert!(!is_adobe_rgb(&exif(1, "R03")));
    }
}
