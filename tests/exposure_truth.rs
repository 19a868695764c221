//! Compares clipped pixels after a virtual shortening of the exposure with shorter exposures: the
//! merged bracketed pictures of the path-traced environments.
//!
//! `cargo test --test exposure_truth -- --nocapture` prints the table.

#![expect(clippy::unwrap_used)]
#![allow(missing_docs)]

use glam::DVec3;
use penumbra_camera::Response;
use penumbra_compositor::reference::exposure::exposed;
use penumbra_picture::Picture;
use penumbra_scene::Highlights;
use std::path::{Path, PathBuf};

/// Sessions and the stops of their brackets.
const SESSIONS: [(&str, &[i32]); 4] = [
    ("desk", &[-4, -8]),
    ("desk-sphere", &[-3]),
    ("courtyard", &[-5, -10, -15]),
    ("desk-lamp", &[-4, -8]),
];

/// Minimum code of a clipped channel.
const CLIPPED: u8 = 250;

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/truth")
}

fn read(path: &Path) -> Picture {
    Picture::from_file_bytes(&std::fs::read(path).unwrap()).unwrap()
}

/// Linear light of each pixel: from the longest unclipped exposure, blended over codes 225 to 248.
fn merged(session: &str, brackets: &[i32], base: &Picture, response: &Response) -> Vec<DVec3> {
    let linear =
        |p: &[u8]| DVec3::from(response.linear_from_rgb([p[0], p[1], p[2]]).map(f64::from));
    let mut light: Vec<DVec3> = base.rgba.chunks_exact(4).map(linear).collect();
    let mut longer = base.clone();
    for ev in brackets {
        let file = format!("{session}/env/00000_ev{ev}.jpg");
        let shorter = read(&folder().join(file));
        let pixels = longer
            .rgba
            .chunks_exact(4)
            .zip(shorter.rgba.chunks_exact(4));
        for (light, (longer, shorter)) in light.iter_mut().zip(pixels) {
            let own = linear(shorter) / f64::from(*ev).exp2();
            let clipped = |c: u8| ((f64::from(c) - 225.0) / 23.0).clamp(0.0, 1.0);
            let w = DVec3::new(clipped(longer[0]), clipped(longer[1]), clipped(longer[2]));
            *light += w * (own - *light);
        }
        longer = shorter;
    }
    light
}

/// Root mean square difference of codes.
fn error(light: &[DVec3], truth: &[DVec3], pixels: &[bool]) -> f64 {
    let code = |v: f64| 255.0 * f64::from(Response::srgb().encoded_from_linear(v as f32));
    let differences = light.iter().zip(truth).zip(pixels).filter(|(_, p)| **p);
    let (mut sum, mut count) = (0.0, 0.0);
    for ((light, truth), _) in differences {
        for k in 0..3 {
            sum += (code(light[k]) - code(truth[k])).powi(2);
            count += 1.0;
        }
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}

#[test]
fn clipped_pixels_have_less_error_than_by_scaling() {
    if !folder().is_dir() {
        eprintln!("SKIPPED exposure_truth: ../shared is missing");
        return;
    }
    let response = Response::srgb();
    println!(
        "| session | stops | fully clipped: scaled | paper | ours | partly: scaled | paper | ours |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let (mut scaled_all, mut ours_all) = ([0.0; 2], [0.0; 2]);
    for (session, brackets) in SESSIONS {
        let base = read(&folder().join(format!("{session}/env/00000.jpg")));
        let truth = merged(session, brackets, &base, &response);
        let clipped = |p: &[u8]| p[..3].iter().filter(|c| **c >= CLIPPED).count();
        let pixels = base.rgba.chunks_exact(4);
        let fully: Vec<bool> = pixels.clone().map(|p| clipped(p) == 3).collect();
        let partly: Vec<bool> = pixels
            .clone()
            .map(|p| (1..3).contains(&clipped(p)))
            .collect();
        for stops in [-1.0_f32, -2.0, -3.0, -4.0] {
            let factor = stops.exp2();
            let shorter: Vec<DVec3> = truth.iter().map(|l| *l * f64::from(factor)).collect();
            let ours = exposed(&base, &response, factor, Highlights::Estimated);
            let linear = |p: &[u8]| response.linear_from_rgb([p[0], p[1], p[2]]);
            let scaled = |p: &[u8]| DVec3::from(linear(p).map(f64::from)) * f64::from(factor);
            let scaled: Vec<DVec3> = pixels.clone().map(scaled).collect();
            let paper = exposed(&base, &response, factor, Highlights::Paper);
            let row = [&fully, &partly]
                .map(|which| [&scaled, &paper, &ours].map(|light| error(light, &shorter, which)));
            let [[a, b, c], [d, e, f]] = row;
            println!(
                "| {session} | {stops} | {a:.0} | {b:.0} | {c:.0} | {d:.0} | {e:.0} | {f:.0} |"
            );
            for k in 0..2 {
                scaled_all[k] += row[k][0];
                ours_all[k] += row[k][2];
            }
        }
    }
    assert!(
        ours_all[0] < 0.5 * scaled_all[0],
        "{ours_all:?} {scaled_all:?}"
    );
    assert!(
        ours_all[1] < 0.8 * scaled_all[1],
        "{ours_all:?} {scaled_all:?}"
    );
}
