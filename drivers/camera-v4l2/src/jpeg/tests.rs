use super::*;
use proptest::prelude::*;

/// A small picture, encoded by libjpeg-turbo.
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
    Jpeg::parse(data).unwrap().write_complete(data, &mut out);
    out
}

/// Decodes a picture. Warnings are accepted: real cameras pad before restart markers.
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
fn a_complete_frame_is_not_changed() {
    let data = encoded();
    let found = Jpeg::parse(&data).unwrap();
    let whole = Jpeg {
        len: data.len(),
        has_end: true,
        tables_missing_at: None,
    };
    assert_eq!(found, whole);
    assert_eq!(written(&data), data);
}

#[test]
fn padding_after_the_end_is_cut_even_if_it_is_an_older_frame() {
    let data = encoded();
    for padding in [vec![0; 500], data[100..].to_vec(), vec![0xFF, 0xD9]] {
        let padded = [&data[..], &padding].concat();
        assert_eq!(written(&padded), data);
    }
}

#[test]
fn missing_tables_are_inserted() {
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
fn a_missing_end_is_reported_and_added() {
    let data = encoded();
    for padding in [0, 77] {
        let mut cut = data[..data.len() - 2].to_vec();
        cut.resize(cut.len() + padding, 0);
        assert!(!Jpeg::parse(&cut).unwrap().has_end);
        assert_eq!(decode(&written(&cut)), decode(&data));
    }
}

#[test]
fn a_frame_needs_a_start_and_a_scan() {
    assert_eq!(Jpeg::parse(b""), Err(JpegError::NoStart));
    assert_eq!(Jpeg::parse(b"GIF89a"), Err(JpegError::NoStart));
    assert_eq!(Jpeg::parse(&[0xFF, SOI]), Err(JpegError::NoScan));
    assert_eq!(Jpeg::parse(&[0xFF, SOI, 0xFF, EOI]), Err(JpegError::NoScan));
    assert_eq!(Jpeg::parse(&encoded()[..40]), Err(JpegError::NoScan));
}

#[test]
fn tables_are_inserted_into_a_frame_of_a_real_camera() {
    let data = include_bytes!("../../tests/pictures/mjpeg_without_tables.jpg");
    assert!(Jpeg::parse(data).unwrap().tables_missing_at.is_some());
    let completed = written(data);
    assert_eq!(Jpeg::parse(&completed).unwrap().tables_missing_at, None);
    assert_eq!(
        decode(&completed),
        decode(data),
        "libjpeg-turbo assumes the standard tables itself"
    );
}

proptest! {
    #[test]
    fn arbitrary_bytes_do_not_panic(data in proptest::collection::vec(any::<u8>(), 0..600)) {
        if let Ok(found) = Jpeg::parse(&data) {
            prop_assert!(found.len <= data.len());
        }
    }

    #[test]
    fn a_damaged_frame_is_written_within_bounds(
        cut in 0_usize..2000, at in 0_usize..2000, byte in any::<u8>()
    ) {
        let mut data = without_tables(&encoded());
        let at = at % data.len();
        data[at] = byte;
        data.truncate(data.len().saturating_sub(cut).max(2));
        if let Ok(found) = Jpeg::parse(&data) {
            prop_assert!(found.len <= data.len());
            let mut out = Vec::new();
            found.write_complete(&data, &mut out);
            prop_assert!(out.len() <= data.len() + 424);
            prop_assert!(out.ends_with(&[0xFF, EOI]));
        }
    }
}
