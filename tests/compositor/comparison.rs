//! Comparison of pictures.

use penumbra_compositor::reference::{ReferencePicture, ReferencePixel, Seen};
use penumbra_picture::Picture;
use std::path::PathBuf;

/// Pixels within `reach` of (`x`, `y`), inside the picture.
fn around(size: (u32, u32), (x, y): (u32, u32), reach: u32) -> impl Iterator<Item = usize> {
    let rows = y.saturating_sub(reach)..=(y + reach).min(size.1 - 1);
    let last = (x + reach).min(size.0 - 1);
    rows.flat_map(move |v| (x.saturating_sub(reach)..=last).map(move |u| (v * size.0 + u) as usize))
}

/// For every pixel whether all pixels within `reach` of it are `same` as the pixel itself.
fn calm(
    twin: &ReferencePicture,
    reach: u32,
    same: impl Fn(&ReferencePixel, &ReferencePixel) -> bool,
) -> Vec<bool> {
    let size = (twin.picture.width, twin.picture.height);
    (0..size.0 * size.1)
        .map(|i| {
            let here = &twin.pixels[i as usize];
            around(size, (i % size.0, i / size.0), reach).all(|j| same(&twin.pixels[j], here))
        })
        .collect()
}

/// Pixels without an outline, a crease or a shadow's edge within `reach`.
pub fn away_from_edges(twin: &ReferencePicture, reach: u32) -> Vec<bool> {
    calm(twin, reach, |a, b| {
        a.footprint == b.footprint && (a.normal == b.normal || a.normal.dot(b.normal) > 0.8)
    })
}

/// Pixels without virtual surfaces and virtual shadows within `reach`.
pub fn untouched(twin: &ReferencePicture, reach: u32) -> Vec<bool> {
    calm(twin, reach, |a, b| a.untouched && b.untouched)
}

/// Pixels with only virtual surfaces within `reach`.
pub fn virtual_inside(twin: &ReferencePicture, reach: u32) -> Vec<bool> {
    calm(twin, reach, |a, b| {
        a.seen == Seen::Virtual && b.seen == Seen::Virtual
    })
}

/// Tolerances of a comparison with the twin.
#[derive(Clone, Copy)]
pub struct Rule {
    /// Maximum displacement of an edge from the twin's, pixels.
    pub reach: u32,
    /// Minimum fraction of the picture without edges.
    pub calm: f64,
    /// Maximum difference of codes.
    pub slack: u8,
    /// Whether to compare virtual surfaces, too: only without a ground, whose reflected light the
    /// twin does not have.
    pub on_virtual: bool,
}

impl Rule {
    /// Real surfaces only, edges within `reach` pixels.
    pub const fn within(reach: u32) -> Self {
        Self {
            reach,
            calm: 0.3,
            slack: 2,
            on_virtual: false,
        }
    }
}

/// Number of codes of real surfaces that are more than `slack` outside the range of the twin within
/// `reach` pixels.
pub fn strays(ours: &Picture, twin: &ReferencePicture, reach: u32, slack: u8) -> usize {
    let size = (ours.width, ours.height);
    let stray = |i: &u32| {
        let (pixel, c) = (i / 3, (i % 3) as usize);
        let near: Vec<_> = around(size, (pixel % size.0, pixel / size.0), reach).collect();
        if near.iter().any(|j| twin.pixels[*j].seen == Seen::Virtual) {
            return false;
        }
        let code = ours.rgba[4 * pixel as usize + c];
        let codes = near.iter().map(|j| twin.picture.rgba[4 * j + c]);
        let (low, high) = codes.fold((255, 0), |(l, h), v: u8| (l.min(v), h.max(v)));
        code < low.saturating_sub(slack) || code > high.saturating_add(slack)
    };
    (0..3 * size.0 * size.1).filter(stray).count()
}

/// Asserts that codes equal the twin's where no edge is within reach, and that near edges they are
/// within the twin's range there. One pixel in a thousand may deviate: where several shadows' edges
/// cross, their sum may have no match nearby.
pub fn assert_like(name: &str, ours: &Picture, twin: &ReferencePicture, rule: Rule) {
    let (reach, slack) = (rule.reach, rule.slack);
    let size = (ours.width, ours.height);
    assert_eq!(size, (twin.picture.width, twin.picture.height));
    let still = away_from_edges(twin, reach);
    let share = still.iter().filter(|s| **s).count() as f64 / still.len() as f64;
    let is_virtual = |j: usize| twin.pixels[j].seen == Seen::Virtual;
    let (mut wrong, mut strays) = (Vec::new(), Vec::new());
    for i in 0..size.0 * size.1 {
        let (at, k) = ((i % size.0, i / size.0), i as usize);
        let own = if still[k] { 0 } else { reach };
        if !rule.on_virtual && around(size, at, reach).any(is_virtual) {
            continue;
        }
        for c in 0..3 {
            let codes = around(size, at, own).map(|j| twin.picture.rgba[4 * j + c]);
            let (low, high) = codes.fold((255, 0), |(l, h), v: u8| (l.min(v), h.max(v)));
            let code = ours.rgba[4 * k + c];
            if code < low.saturating_sub(slack) || code > high.saturating_add(slack) {
                let list = if still[k] { &mut wrong } else { &mut strays };
                list.push((at, c, code, low, high));
            }
        }
    }
    let few = strays.len() <= 3 * still.len() / 1000;
    if wrong.is_empty() && few && share >= rule.calm {
        return;
    }
    let kept = (
        keep(&format!("{name}-ours"), ours),
        keep(&format!("{name}-twin"), &twin.picture),
    );
    if !few {
        wrong.append(&mut strays);
    }
    assert!(
        wrong.is_empty(),
        "{name}: {} codes are off, first (pixel, channel, code, lowest, highest) {:?}\n{kept:?}",
        wrong.len(),
        &wrong[..wrong.len().min(8)]
    );
    panic!(
        "{name}: only {share:.3} of the picture is free of edges, too little for the comparison"
    );
}

/// Asserts that the flagged pixels have the codes of `expected`.
pub fn assert_same_where(name: &str, ours: &Picture, expected: &Picture, flags: &[bool]) {
    assert!(flags.iter().any(|f| *f), "{name}: no pixel to compare");
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

/// Maximum and mean difference of codes.
pub fn difference(a: &Picture, b: &Picture) -> (u8, f64) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    let each = a.rgba.iter().zip(&b.rgba).map(|(a, b)| a.abs_diff(*b));
    let sum: u64 = each.clone().map(u64::from).sum();
    (each.max().unwrap_or(0), sum as f64 / a.rgba.len() as f64)
}

/// Side of the squares over which differences are averaged, pixels: an edge may be displaced by a
/// fraction of a pixel between drivers.
const SQUARE: u32 = 8;

/// Corner of each square, and the difference of its means, maximum over the channels.
pub fn square_differences(a: &Picture, b: &Picture) -> Vec<((u32, u32), f64)> {
    let mean = |p: &Picture, x: u32, y: u32, c: usize| {
        let sum: u32 = (0..SQUARE * SQUARE)
            .map(|i| u32::from(p.rgb(x + i % SQUARE, y + i / SQUARE)[c]))
            .sum();
        f64::from(sum) / f64::from(SQUARE * SQUARE)
    };
    (0..a.height / SQUARE)
        .flat_map(|v| (0..a.width / SQUARE).map(move |u| (u * SQUARE, v * SQUARE)))
        .map(|(x, y)| {
            let off = |c| (mean(a, x, y, c) - mean(b, x, y, c)).abs();
            ((x, y), (0..3).map(off).fold(0.0, f64::max))
        })
        .collect()
}

/// Keeps the picture of a failed test for inspection.
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
