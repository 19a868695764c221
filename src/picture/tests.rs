use super::*;
use bytes::Bytes;
use penumbra_interface::{BayerPattern, Frame, MonotonicTime, PixelFormat};
use proptest::prelude::*;
use std::collections::BTreeMap;

fn frame(format: PixelFormat, width: u32, height: u32, data: impl Into<Bytes>) -> Frame {
    Frame {
        data: data.into(),
        format,
        width,
        height,
        stride: 0,
        sequence: 0,
        captured_at: MonotonicTime::default(),
        arrived_at: MonotonicTime::default(),
        exposure: None,
        bracket_ev: 0.0,
        controls: None,
    }
}

fn encoding(matrix: YuvMatrix, range: YuvRange) -> YuvEncoding {
    YuvEncoding { matrix, range }
}

const ALL_ENCODINGS: [YuvEncoding; 4] = [
    YuvEncoding {
        matrix: YuvMatrix::Bt601,
        range: YuvRange::Limited,
    },
    YuvEncoding {
        matrix: YuvMatrix::Bt601,
        range: YuvRange::Full,
    },
    YuvEncoding {
        matrix: YuvMatrix::Bt709,
        range: YuvRange::Limited,
    },
    YuvEncoding {
        matrix: YuvMatrix::Bt709,
        range: YuvRange::Full,
    },
];

fn yuyv_pixel(y: u8, u: u8, v: u8, yuv: &YuvEncoding) -> [u8; 3] {
    let picture = Picture::decode(&frame(PixelFormat::Yuyv, 2, 1, vec![y, u, y, v]), yuv).unwrap();
    assert_eq!(picture.rgb(0, 0), picture.rgb(1, 0));
    picture.rgb(0, 0)
}

/// A small picture with every hue, as RGB bytes.
fn colourful(width: u32, height: u32) -> Vec<u8> {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels
        .flat_map(|(x, y)| [(x * 7) as u8, (y * 11) as u8, (x * 3 + y * 5) as u8])
        .collect()
}

fn jpeg(width: usize, height: usize, subsampling: turbojpeg::Subsamp) -> (Vec<u8>, Vec<u8>) {
    let pixels = colourful(width as u32, height as u32);
    let image = turbojpeg::Image {
        pixels: pixels.as_slice(),
        width,
        pitch: 3 * width,
        height,
        format: turbojpeg::PixelFormat::RGB,
    };
    let data = turbojpeg::compress(image, 95, subsampling).unwrap();
    (data.to_vec(), pixels)
}

fn png(width: u32, height: u32, colour: png::ColorType, samples: &[u8]) -> Vec<u8> {
    let mut data = Vec::new();
    let mut encoder = png::Encoder::new(&mut data, width, height);
    encoder.set_color(colour);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(samples).unwrap();
    drop(writer);
    data
}

#[test]
fn grey_ramp_keeps_its_steps_in_both_ranges() {
    for matrix in [YuvMatrix::Bt601, YuvMatrix::Bt709] {
        for y in 0..=255u8 {
            let full = yuyv_pixel(y, 128, 128, &encoding(matrix, YuvRange::Full));
            assert_eq!(full, [y; 3]);
            let limited = yuyv_pixel(y, 128, 128, &encoding(matrix, YuvRange::Limited));
            let expected = ((f64::from(y) - 16.0) * 255.0 / 219.0).round();
            assert_eq!(limited, [expected.clamp(0.0, 255.0) as u8; 3]);
        }
    }
}

#[test]
fn decodes_published_colour_bars_to_primaries() {
    // 100 % colour bars in 8-bit codes: ITU-R BT.601 (limited) and BT.709 (limited).
    let bars601 = [
        ([235, 128, 128], [255, 255, 255]),
        ([210, 16, 146], [255, 255, 0]),
        ([170, 166, 16], [0, 255, 255]),
        ([145, 54, 34], [0, 255, 0]),
        ([106, 202, 222], [255, 0, 255]),
        ([81, 90, 240], [255, 0, 0]),
        ([41, 240, 110], [0, 0, 255]),
        ([16, 128, 128], [0, 0, 0]),
    ];
    let bars709 = [
        ([219, 16, 138], [255, 255, 0]),
        ([188, 154, 16], [0, 255, 255]),
        ([173, 42, 26], [0, 255, 0]),
        ([78, 214, 230], [255, 0, 255]),
        ([63, 102, 240], [255, 0, 0]),
        ([32, 240, 118], [0, 0, 255]),
    ];
    let check = |bars: &[([u8; 3], [u8; 3])], matrix| {
        for &([y, u, v], rgb) in bars {
            let got = yuyv_pixel(y, u, v, &encoding(matrix, YuvRange::Limited));
            for (a, b) in got.iter().zip(rgb) {
                // The published codes are themselves rounded: one code of chroma is two of blue.
                assert!(a.abs_diff(b) <= 2, "{y} {u} {v}: {got:?}, not {rgb:?}");
            }
        }
    };
    check(&bars601, YuvMatrix::Bt601);
    check(&bars709, YuvMatrix::Bt709);
    // JFIF (BT.601, full range): red, green, blue.
    let jfif = encoding(YuvMatrix::Bt601, YuvRange::Full);
    for ([y, u, v], rgb) in [
        ([76, 85, 255], [254, 0, 0]),
        ([150, 44, 21], [0, 255, 1]),
        ([29, 255, 107], [0, 0, 254]),
    ] {
        assert_eq!(yuyv_pixel(y, u, v, &jfif), rgb);
    }
}

#[test]
fn nv12_and_yuyv_are_equal_for_constant_chroma() {
    for yuv in &ALL_ENCODINGS {
        let luma: Vec<u8> = (0..16).map(|i| 20 + 13 * i).collect();
        let nv12: Vec<u8> = luma.iter().copied().chain([90, 170].repeat(4)).collect();
        let yuyv: Vec<u8> = luma
            .chunks_exact(2)
            .flat_map(|y| [y[0], 90, y[1], 170])
            .collect();
        let a = Picture::decode(&frame(PixelFormat::Nv12, 4, 4, nv12), yuv).unwrap();
        let b = Picture::decode(&frame(PixelFormat::Yuyv, 4, 4, yuyv), yuv).unwrap();
        assert_eq!(a, b);
    }
}

#[test]
fn stride_skips_padding() {
    let rows = vec![1, 2, 3, 4, 5, 6, 99, 99, 7, 8, 9, 10, 11, 12];
    let mut padded = frame(PixelFormat::Rgb8, 2, 2, rows);
    padded.stride = 8;
    let picture = Picture::decode(&padded, &YuvEncoding::default()).unwrap();
    assert_eq!(picture.rgb(1, 0), [4, 5, 6]);
    assert_eq!(picture.rgb(0, 1), [7, 8, 9]);
    assert_eq!(picture.rgb(1, 1), [10, 11, 12]);

    let planes = vec![16, 235, 0, 235, 16, 0, 128, 128];
    let mut padded = frame(PixelFormat::Nv12, 2, 2, planes);
    padded.stride = 3;
    let picture = Picture::decode(&padded, &YuvEncoding::default()).unwrap();
    assert_eq!(picture.rgb(1, 0), [255; 3]);
    assert_eq!(picture.rgb(1, 1), [0; 3]);
}

#[test]
fn jpeg_matches_libjpeg_turbo() {
    for subsampling in [turbojpeg::Subsamp::None, turbojpeg::Subsamp::Sub2x2] {
        let (data, _) = jpeg(33, 17, subsampling);
        let reference = turbojpeg::decompress(&data, turbojpeg::PixelFormat::RGBA).unwrap();
        let picture = Picture::decode(
            &frame(PixelFormat::Jpeg, 0, 0, data),
            &YuvEncoding::default(),
        )
        .unwrap();
        assert_eq!((picture.width, picture.height), (33, 17));
        assert_eq!(picture.rgba, reference.pixels);
    }
}

#[test]
fn rejects_truncated_jpeg_with_one_line() {
    let (data, _) = jpeg(64, 64, turbojpeg::Subsamp::None);
    for length in [1, 20, data.len() / 2, data.len() - 30] {
        let cut = frame(PixelFormat::Jpeg, 0, 0, data[..length].to_vec());
        let error = Picture::decode(&cut, &YuvEncoding::default()).unwrap_err();
        assert!(!error.to_string().contains('\n'));
    }
}

#[test]
fn accepts_padding_before_the_end_of_a_webcam_jpeg() {
    let (mut data, _) = jpeg(32, 32, turbojpeg::Subsamp::None);
    let clean = Picture::decode(
        &frame(PixelFormat::Jpeg, 0, 0, data.clone()),
        &YuvEncoding::default(),
    );
    let end = data.len() - 2;
    data.splice(end..end, [0u8; 8]);
    let padded = Picture::decode(
        &frame(PixelFormat::Jpeg, 0, 0, data),
        &YuvEncoding::default(),
    );
    assert_eq!(padded, clean);
    assert!(clean.is_ok());
}

#[test]
fn reads_every_png_colour_type() {
    let rgb = colourful(5, 3);
    let rgba: Vec<u8> = rgb
        .chunks_exact(3)
        .flat_map(|p| [p[0], p[1], p[2], 40])
        .collect();
    let grey: Vec<u8> = (0..15).map(|i| i * 16).collect();
    let grey_alpha: Vec<u8> = grey.iter().flat_map(|&g| [g, 7]).collect();
    let read = |colour, samples: &[u8]| {
        let data = png(5, 3, colour, samples);
        Picture::decode(
            &frame(PixelFormat::Png, 0, 0, data),
            &YuvEncoding::default(),
        )
        .unwrap()
    };
    let direct = Picture::decode(
        &frame(PixelFormat::Rgb8, 5, 3, rgb.clone()),
        &YuvEncoding::default(),
    );
    assert_eq!(read(png::ColorType::Rgb, &rgb), direct.clone().unwrap());
    assert_eq!(read(png::ColorType::Rgba, &rgba), direct.unwrap());
    let direct = Picture::decode(
        &frame(PixelFormat::Grey8, 5, 3, grey.clone()),
        &YuvEncoding::default(),
    );
    assert_eq!(
        read(png::ColorType::Grayscale, &grey),
        direct.clone().unwrap()
    );
    assert_eq!(
        read(png::ColorType::GrayscaleAlpha, &grey_alpha),
        direct.unwrap()
    );
}

#[test]
fn rejects_huge_picture_before_allocating() {
    let huge = frame(PixelFormat::Grey8, 1 << 20, 1 << 20, vec![0]);
    let error = Picture::decode(&huge, &YuvEncoding::default()).unwrap_err();
    assert!(matches!(error, PictureError::TooLarge { .. }), "{error}");
    // A PNG header alone that claims 2³⁰ × 2³⁰.
    let mut data = png(1, 1, png::ColorType::Grayscale, &[0]);
    data[16..24].copy_from_slice(&[0x40, 0, 0, 0, 0x40, 0, 0, 0]);
    let checksum = crc32(&data[12..29]);
    data[29..33].copy_from_slice(&checksum.to_be_bytes());
    let error = Picture::decode(
        &frame(PixelFormat::Png, 0, 0, data),
        &YuvEncoding::default(),
    );
    assert!(
        matches!(error, Err(PictureError::TooLarge { .. })),
        "{error:?}"
    );
}

/// ISO 3309, as PNG uses it.
fn crc32(data: &[u8]) -> u32 {
    !data.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |c, _| {
            (c >> 1) ^ (0xEDB8_8320 * (c & 1))
        })
    })
}

#[test]
fn rejects_invalid_raw_frames_with_the_reason() {
    let text = |frame: &Frame| {
        let error = Picture::decode(frame, &YuvEncoding::default()).unwrap_err();
        error.to_string()
    };
    assert!(text(&frame(PixelFormat::Yuyv, 3, 2, vec![0; 64])).contains("even width"));
    assert!(text(&frame(PixelFormat::Nv12, 3, 2, vec![0; 64])).contains("even width"));
    assert!(text(&frame(PixelFormat::Nv12, 2, 3, vec![0; 64])).contains("even height"));
    assert!(text(&frame(PixelFormat::Nv12, 4, 4, vec![0; 23])).contains("23 bytes, 24 needed"));
    assert!(text(&frame(PixelFormat::Rgb8, 0, 4, vec![0; 23])).contains("needs its size"));
    assert!(text(&frame(PixelFormat::Rgb8, 2, 4, vec![])).contains("no bytes"));
    let mut short = frame(PixelFormat::Rgb8, 4, 1, vec![0; 64]);
    short.stride = 11;
    assert!(text(&short).contains("stride of 11 bytes"));
}

#[test]
fn reuses_the_buffer() {
    let mut picture = Picture::default();
    let big = frame(PixelFormat::Grey8, 64, 64, vec![9; 4096]);
    decode_into(&big, &YuvEncoding::default(), &mut picture).unwrap();
    let address = picture.rgba.as_ptr();
    let small = frame(PixelFormat::Grey8, 2, 2, vec![1, 2, 3, 4]);
    decode_into(&small, &YuvEncoding::default(), &mut picture).unwrap();
    assert_eq!(picture.rgba.as_ptr(), address);
    assert_eq!(picture.rgba.len(), 16);
    assert_eq!(picture.rgb(1, 1), [4; 3]);
}

fn any_format() -> impl Strategy<Value = PixelFormat> {
    prop::sample::select(vec![
        PixelFormat::Jpeg,
        PixelFormat::Png,
        PixelFormat::Yuyv,
        PixelFormat::Nv12,
        PixelFormat::Rgb8,
        PixelFormat::Grey8,
    ])
}

proptest! {
    #[test]
    fn yuv_matches_the_standard_up_to_rounding(y: u8, u: u8, v: u8, which in 0usize..4) {
        let yuv = ALL_ENCODINGS[which];
        let (kr, kb) = match yuv.matrix {
            YuvMatrix::Bt601 => (0.299, 0.114),
            YuvMatrix::Bt709 => (0.2126, 0.0722),
        };
        let (luma, chroma) = match yuv.range {
            YuvRange::Limited => ((f64::from(y) - 16.0) / 219.0, 224.0),
            YuvRange::Full => (f64::from(y) / 255.0, 255.0),
        };
        let r = luma + (2.0 - 2.0 * kr) * (f64::from(v) - 128.0) / chroma;
        let b = luma + (2.0 - 2.0 * kb) * (f64::from(u) - 128.0) / chroma;
        let g = (luma - kr * r - kb * b) / (1.0 - kr - kb);
        let got = yuyv_pixel(y, u, v, &yuv);
        for (code, exact) in got.iter().zip([r, g, b]) {
            let exact = (255.0 * exact).clamp(0.0, 255.0);
            prop_assert!((f64::from(*code) - exact).abs() < 0.501);
        }
    }

    #[test]
    fn random_bytes_never_panic(
        format in any_format(),
        width in 0u32..40,
        height in 0u32..40,
        stride in 0u32..200,
        data in prop::collection::vec(any::<u8>(), 0..2000),
    ) {
        let mut noise = frame(format, width, height, data);
        noise.stride = stride;
        if let Ok(picture) = Picture::decode(&noise, &YuvEncoding::default()) {
            prop_assert_eq!(picture.rgba.len() as u64, 4 * u64::from(picture.width) * u64::from(picture.height));
        }
    }

    #[test]
    fn damaged_file_never_panics(
        jpeg_or_png: bool,
        flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
    ) {
        let (format, mut data) = if jpeg_or_png {
            (PixelFormat::Jpeg, jpeg(24, 24, turbojpeg::Subsamp::Sub2x2).0)
        } else {
            (PixelFormat::Png, png(24, 24, png::ColorType::Rgb, &colourful(24, 24)))
        };
        for (index, value) in flips {
            let i = index.index(data.len());
            data[i] = value;
        }
        let mut picture = Picture::default();
        let _ = decode_into(&frame(format, 0, 0, data), &YuvEncoding::default(), &mut picture);
        prop_assert_eq!(picture.rgba.len() as u64, 4 * u64::from(picture.width) * u64::from(picture.height));
    }
}

/// The mosaic that a sensor with this pattern measures of a picture.
fn mosaic(
    picture: &dyn Fn(u32, u32) -> [u8; 3],
    (width, height): (u32, u32),
    pattern: BayerPattern,
) -> Vec<u8> {
    let red = pattern.red();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels
        .map(|(x, y)| match ((x ^ red.0) & 1, (y ^ red.1) & 1) {
            (0, 0) => picture(x, y)[0],
            (1, 1) => picture(x, y)[2],
            _ => picture(x, y)[1],
        })
        .collect()
}

fn demosaiced(
    picture: &dyn Fn(u32, u32) -> [u8; 3],
    size: (u32, u32),
    pattern: BayerPattern,
) -> Picture {
    let bytes = mosaic(picture, size, pattern);
    let frame = frame(PixelFormat::Bayer8(pattern), size.0, size.1, bytes);
    Picture::decode(&frame, &YuvEncoding::default()).unwrap()
}

#[test]
fn pattern_names_the_colours_of_the_first_four_pixels() {
    let red = |_, _| [200, 0, 0];
    for (pattern, place) in [
        (BayerPattern::Rggb, 0),
        (BayerPattern::Grbg, 1),
        (BayerPattern::Gbrg, 2),
        (BayerPattern::Bggr, 3),
    ] {
        let mut expected = [0; 4];
        expected[place] = 200;
        assert_eq!(mosaic(&red, (2, 2), pattern), expected, "{pattern:?}");
    }
}

#[test]
fn uniform_colour_keeps_its_codes_in_every_pattern_and_size() {
    let colour = |_, _| [180, 90, 33];
    for pattern in BayerPattern::ALL {
        for size in [(2, 2), (3, 2), (2, 5), (8, 6), (33, 17), (200, 9)] {
            let picture = demosaiced(&colour, size, pattern);
            for (x, y) in [(0, 0), (1, 0), (0, 1), (size.0 - 1, size.1 - 1)] {
                assert_eq!(
                    picture.rgb(x, y),
                    [180, 90, 33],
                    "{pattern:?} {size:?} {x},{y}"
                );
            }
        }
    }
}

/// The paper's filters preserve planes with equal slopes in all colours.
#[test]
fn preserves_slopes() {
    let slope = |x: u32, y: u32| {
        let rise = (x + 2 * y) as u8;
        [60 + rise, 30 + rise, 10 + rise]
    };
    for pattern in BayerPattern::ALL {
        let picture = demosaiced(&slope, (90, 24), pattern);
        for y in 2..22 {
            for x in 2..88 {
                assert_eq!(picture.rgb(x, y), slope(x, y), "{pattern:?} {x},{y}");
            }
        }
    }
}

/// Gradient correction against the plain mean of neighbours, on the fine detail for which it is
/// intended: at most half the squared error (3 dB).
#[test]
fn edges_are_sharper_than_with_the_mean_of_neighbours() {
    let detail = |x: u32, y: u32| {
        let wave =
            ((f64::from(x) * 0.9).sin() + (f64::from(y) * 0.7 + 0.3 * f64::from(x)).cos()) * 45.0;
        [140.0 + wave, 120.0 + wave, 100.0 + wave].map(|c| c.round() as u8)
    };
    let size = (64, 64);
    let picture = demosaiced(&detail, size, BayerPattern::Rggb);
    let codes = mosaic(&detail, size, BayerPattern::Rggb);
    let at = |x: u32, y: u32| f64::from(codes[(y * 64 + x) as usize]);
    let (mut ours, mut plain) = (0.0, 0.0);
    for y in (4..60).step_by(2) {
        for x in (4..60).step_by(2) {
            let truth = f64::from(detail(x, y)[1]);
            let mean = (at(x - 1, y) + at(x + 1, y) + at(x, y - 1) + at(x, y + 1)) / 4.0;
            ours += (f64::from(picture.rgb(x, y)[1]) - truth).powi(2);
            plain += (mean - truth).powi(2);
        }
    }
    assert!(ours * 2.0 < plain, "squared error {ours} against {plain}");
}

#[test]
fn reads_padded_bayer_rows_and_rejects_truncated_ones() {
    let colour = |x: u32, y: u32| [(x * 9) as u8, (y * 11) as u8, 77];
    let tight = demosaiced(&colour, (10, 6), BayerPattern::Gbrg);
    let bytes = mosaic(&colour, (10, 6), BayerPattern::Gbrg);
    let padded: Vec<u8> = bytes
        .chunks(10)
        .flat_map(|row| [row, &[0xAA; 3]].concat())
        .collect();
    let mut frame = frame(PixelFormat::Bayer8(BayerPattern::Gbrg), 10, 6, padded);
    frame.stride = 13;
    let decode = |frame: &Frame| Picture::decode(frame, &YuvEncoding::default());
    assert_eq!(decode(&frame).unwrap(), tight);
    frame.data = frame.data.slice(..5 * 13 + 9);
    assert!(matches!(decode(&frame), Err(PictureError::TooShort { .. })));
}

/// Malformed files found by other projects; see `tests/fixtures/jpeg/ORIGIN.md`.
#[test]
fn rejects_malformed_jpegs() {
    let folder = penumbra_test_data::fixture("jpeg");
    let mut sizes = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "jpg") {
            let data = std::fs::read(&path).unwrap();
            let picture = Picture::decode(
                &frame(PixelFormat::Jpeg, 0, 0, data),
                &YuvEncoding::default(),
            );
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            sizes.insert(name, picture.ok().map(|p| (p.width, p.height)));
        }
    }
    assert_eq!(sizes.len(), 14, "{sizes:?}");
    // Fill bytes before the end marker are allowed; the other files are invalid.
    assert_eq!(
        sizes.remove("multiple-0xff-before-eoi"),
        Some(Some((640, 480)))
    );
    assert!(sizes.values().all(Option::is_none), "{sizes:?}");
}

/// Damaged headers of small files that are within the limit of a picture.
#[test]
fn headers_that_state_more_than_the_file_holds_take_no_memory() {
    let mut png = png(1, 1, png::ColorType::Rgb, &[1, 2, 3]);
    png[16..24].copy_from_slice(&[0, 0, 0x20, 0, 0, 0, 0x20, 0]);
    let checksum = crc32(&png[12..29]);
    png[29..33].copy_from_slice(&checksum.to_be_bytes());
    let (mut jpeg, _) = jpeg(8, 8, turbojpeg::Subsamp::None);
    let start = jpeg.windows(2).position(|marker| marker == [0xFF, 0xC0]);
    let size = start.unwrap() + 5;
    jpeg[size..size + 4].copy_from_slice(&[0x20, 0, 0x20, 0]);
    for (format, data) in [(PixelFormat::Png, png), (PixelFormat::Jpeg, jpeg)] {
        let mut picture = Picture::default();
        let frame = frame(format, 0, 0, data);
        let error = decode_into(&frame, &YuvEncoding::default(), &mut picture);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("8192×8192"), "{error}");
        assert!(error.contains("cannot hold"), "{error}");
        assert_eq!(picture.rgba.capacity(), 0);
    }
}

/// Files of one colour have the most pixels per byte.
#[test]
fn uniform_pictures_are_no_damaged_ones() {
    let (width, height) = (4000, 3000);
    let grey = vec![128; width * height * 3];
    let image = turbojpeg::Image {
        pixels: grey.as_slice(),
        width,
        pitch: 3 * width,
        height,
        format: turbojpeg::PixelFormat::RGB,
    };
    let jpeg = turbojpeg::compress(image, 1, turbojpeg::Subsamp::Sub2x2).unwrap();
    let png = png(width as u32, height as u32, png::ColorType::Rgb, &grey);
    for bytes in [jpeg.as_ref(), &png] {
        let picture = Picture::from_file_bytes(bytes).unwrap();
        assert_eq!((picture.width, picture.height), (4000, 3000));
    }
}

/// A header claims 8192² pixels; the few bytes behind it would decode to gigabytes.
#[test]
fn large_pictures_are_refused_by_their_header() {
    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 8192, 8192);
    encoder.set_color(png::ColorType::Rgb);
    drop(encoder.write_header().unwrap());
    let mut picture = Picture::default();
    let large = frame(PixelFormat::Png, 0, 0, png);
    let error = decode_within(16 << 20, &large, &YuvEncoding::default(), &mut picture);
    assert!(
        matches!(error, Err(PictureError::TooLarge { width: 8192, .. })),
        "{error:?}"
    );
    assert_eq!(picture, Picture::default());
    let grey = frame(PixelFormat::Grey8, 8, 8, vec![0; 64]);
    decode_within(64, &grey, &YuvEncoding::default(), &mut picture).unwrap();
    assert!(decode_within(63, &grey, &YuvEncoding::default(), &mut picture).is_err());
}
