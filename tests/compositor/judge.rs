//! Comparing pictures.

use penumbra::compositor::reference::ReferencePicture;
use penumbra::picture::Picture;
use std::path::PathBuf;

/// Pixels within `reach` of (`x`, `y`), inside the picture.
fn around(size: (u32, u32), (x, y): (u32, u32), reach: u32) -> impl Iterator<Item = usize> {
    let rows = y.saturating_sub(reach)..=(y + reach).min(size.1 - 1);
    let last = (x + reach).min(size.0 - 1);
    rows.flat_map(move |v| (x.saturating_sub(reach)..=last).map(move |u| (v * size.0 + u) as usize))
}

/// For every pixel whether all pixels within `reach` of it are `alike`.
pub fn away_from_edges<T: PartialEq>(
    twin: &ReferencePicture,
    reach: u32,
    alike: impl Fn(usize) -> T,
) -> Vec<bool> {
    let size = (twin.picture.width, twin.picture.height);
    (0..size.0 * size.1)
        .map(|i| {
            let here = alike(i as usize);
            around(size, (i % size.0, i / size.0), reach).all(|j| alike(j) == here)
        })
        .collect()
}

/// Pixels around which nothing is virtual and no virtual shadow falls.
pub fn untouched(twin: &ReferencePicture, reach: u32) -> Vec<bool> {
    away_from_edges(twin, reach, |i| twin.pixels[i].untouched)
        .into_iter()
        .zip(&twin.pixels)
        .map(|(calm, pixel)| calm && pixel.untouched)
        .collect()
}

/// Codes are those of the twin, give or take `slack`, wherever there is no edge within
/// `reach`; near edges they are between the least and the greatest that the twin has there.
/// At least the share `calm` of the picture must be free of edges.
pub fn assert_like(name: &str, ours: &Picture, twin: &ReferencePicture, reach: u32, calm: f64) {
    const SLACK: u8 = 2;
    let size = (ours.width, ours.height);
    assert_eq!(size, (twin.picture.width, twin.picture.height));
    let still = away_from_edges(twin, reach, |i| twin.pixels[i].footprint);
    let share = still.iter().filter(|s| **s).count() as f64 / still.len() as f64;
    let mut wrong = Vec::new();
    for i in 0..size.0 * size.1 {
        let (at, k) = ((i % size.0, i / size.0), i as usize);
        let own = if still[k] { 0 } else { reach };
        for c in 0..3 {
            let codes = around(size, at, own).map(|j| twin.picture.rgba[4 * j + c]);
            let (low, high) = codes.fold((255, 0), |(l, h), v: u8| (l.min(v), h.max(v)));
            let code = ours.rgba[4 * k + c];
            if code < low.saturating_sub(SLACK) || code > high.saturating_add(SLACK) {
                wrong.push((at, c, code, low, high));
            }
        }
    }
    if wrong.is_empty() && share >= calm {
        return;
    }
    let kept = (
        keep(&format!("{name}-ours"), ours),
        keep(&format!("{name}-twin"), &twin.picture),
    );
    assert!(
        wrong.is_empty(),
        "{name}: {} codes are off, first (pixel, channel, code, least, greatest) {:?}\n{kept:?}",
        wrong.len(),
        &wrong[..wrong.len().min(8)]
    );
    panic!("{name}: only {share:.3} of the picture is free of edges, too little to judge by");
}

/// Where the flagged pixels' codes are not those of `expected`.
pub fn assert_same_where(name: &str, ours: &Picture, expected: &Picture, flags: &[bool]) {
    assert!(flags.iter().any(|f| *f), "{name}: no pixel to judge by");
    let wrong: Vec<_> = flags
        .iter()
        .zip(ours.rgba.chunks_exact(4).zip(expected.rgba.chunks_exact(4)))
        .enumerate()
        .filter(|(_, (flag, (a, b)))| **flag && a[..3] != b[..3])
        .map(|(i, (_, codes))| ((i as u32 % ours.width, i as u32 / ours.width), codes))
        .collect();
    if !wrong.is_empty() {
        let kept = keep(name, ours);
        panic!(
            "{name}: {} of the pixels differ: {:?}\n{kept:?}",
            wrong.len(),
            &wrong[..wrong.len().min(8)]
        );
    }
}

/// Greatest and mean difference of codes.
pub fn difference(a: &Picture, b: &Picture) -> (u8, f64) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let each = a.rgba.iter().zip(&b.rgba).map(|(a, b)| a.abs_diff(*b));
    let sum: u64 = each.clone().map(u64::from).sum();
    (each.max().unwrap_or(0), sum as f64 / a.rgba.len() as f64)
}

/// Writes a picture that failed to where it can be looked at.
pub fn keep(name: &str, picture: &Picture) -> PathBuf {
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("compositor");
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join(format!("{name}.png"));
    write(&path, picture);
    path
}

/// Writes a PNG without alpha.
pub fn write(path: &std::path::Path, picture: &Picture) {
    let rgb: Vec<u8> = picture
        .rgba
        .chunks_exact(4)
        .flat_map(|p| [p[0], p[1], p[2]])
        .collect();
    let file = std::fs::File::create(path).unwrap();
    let mut encoder = png::Encoder::new(file, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&rgb).unwrap();
}
