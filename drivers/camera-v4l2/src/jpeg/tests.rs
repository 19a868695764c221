#![allow(clippy::unwrap_used, clippy::expect_used)]

use super::*;
use proptest::prelude::*;

/// A small picture, encoded by the library that decodes it.
fn encoded() -> Vec<u8> {
    let (width, height) = (48, 32);
    let pixels: Vec<u8> = (0..width * height * 3)
        .map(|i| (i * 7 % 251) as u8)
        .collect();
    let image = turbojpeg::Image {
        pixels: pixels.as_slice(),
        width,
        pitch: width * 3,
        height,
        format: turbojpeg::PixelFormat::RGB,
    };
    turbojpeg::compress(image, 90, turbojpeg::Subsamp::Sub2x1)
        .unwrap()
        .to_vec()
}

/// The same without its Huffman tables, as MJPEG cameras send it.
fn without_tables(data: &[u8]) -> Vec<u8> {
    let mut out = data[..2].to_vec();
    let mut at = 2;
    loop {
        let length = 2 + usize::from(u16::from_be_bytes([data[at + 2], data[at + 3]]));
        match data[at + 1] {
            SOS => return [&out, &data[at..]].concat(),
            DHT => {}
            _ => out.extend_from_slice(&data[at..at + length]),
        }
        at += length;
    }
}

fn written(data: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    Jpeg::find(data).unwrap().write(data, &mut out);
    out
}

/// The decoded picture, warnings or not: real cameras pad before restart markers.
fn decode(data: &[u8]) -> Vec<u8> {
    let mut decoder = turbojpeg::Decompressor::new().unwrap();
    let header = decoder.read_header(data).unwrap();
    let mut image = turbojpeg::Image {
        pixels: vec![0; header.width * header.height * 3],
        width: header.width,
        pitch: header.width * 3,
        height: header.height,
        format: turbojpeg::PixelFormat::RGB,
    };
    if let Err(error) = decoder.decompress(data, image.as_deref_mut()) {
        assert!(error.to_string().contains("extraneous bytes"), "{error}");
    }
    image.pixels
}

#[test]
fn a_whole_picture_is_passed_on_bit_for_bit() {
    let data = encoded();
    let found = Jpeg::find(&data).unwrap();
    let whole = Jpeg {
        len: data.len(),
        ended: true,
        tables_missing_at: None,
    };
    assert_eq!(found, whole);
    assert_eq!(written(&data), data);
}

#[test]
fn padding_behind_the_end_is_cut_even_if_it_is_an_older_picture() {
    let data = encoded();
    for padding in [vec![0; 500], data[100..].to_vec(), vec![0xFF, 0xD9]] {
        let padded = [&data[..], &padding].concat();
        assert_eq!(written(&padded), data);
    }
}

#[test]
fn tables_that_a_camera_leaves_out_are_put_in() {
    let data = encoded();
    let bare = without_tables(&data);
    assert_eq!(
        bare.len() + 420 + 12,
        data.len(),
        "one segment instead of four"
    );
    assert_eq!(decode(&written(&bare)), decode(&data));
}

#[test]
fn a_missing_end_is_told_and_mended() {
    let data = encoded();
    for padding in [0, 77] {
        let mut cut = data[..data.len() - 2].to_vec();
        cut.resize(cut.len() + padding, 0);
        assert!(!Jpeg::find(&cut).unwrap().ended);
        assert_eq!(decode(&written(&cut)), decode(&data));
    }
}

#[test]
fn what_has_no_scan_is_no_picture() {
    assert_eq!(Jpeg::find(b""), Err(Fault::NoStart));
    assert_eq!(Jpeg::find(b"GIF89a"), Err(Fault::NoStart));
    assert_eq!(Jpeg::find(&[0xFF, SOI]), Err(Fault::NoScan));
    assert_eq!(Jpeg::find(&[0xFF, SOI, 0xFF, EOI]), Err(Fault::NoScan));
    assert_eq!(Jpeg::find(&encoded()[..40]), Err(Fault::NoScan));
}

#[test]
fn a_real_frame_without_tables_becomes_decodable_everywhere() {
    let data = include_bytes!("../../tests/pictures/mjpeg_without_tables.jpg");
    assert!(Jpeg::find(data).unwrap().tables_missing_at.is_some());
    let mended = written(data);
    assert_eq!(Jpeg::find(&mended).unwrap().tables_missing_at, None);
    assert_eq!(
        decode(&mended),
        decode(data),
        "libjpeg-turbo knows the tables itself"
    );
}

proptest! {
    #[test]
    fn no_bytes_panic(data in proptest::collection::vec(any::<u8>(), 0..600)) {
        if let Ok(found) = Jpeg::find(&data) {
            prop_assert!(found.len <= data.len());
        }
    }

    #[test]
    fn a_damaged_picture_is_written_within_bounds(
        cut in 0_usize..2000, at in 0_usize..2000, byte in any::<u8>()
    ) {
        let mut data = without_tables(&encoded());
        let at = at % data.len();
        data[at] = byte;
        data.truncate(data.len().saturating_sub(cut).max(2));
        if let Ok(found) = Jpeg::find(&data) {
            prop_assert!(found.len <= data.len());
            let mut out = Vec::new();
            found.write(&data, &mut out);
            prop_assert!(out.len() <= data.len() + 424);
            prop_assert!(out.ends_with(&[0xFF, EOI]));
        }
    }
}
