#![allow(clippy::unwrap_used)]

use super::*;
use crate::radiometric::drawn::Drawn;
use glam::DVec3;
use penumbra_camera::Response;

const UPRIGHT: [(f64, f64); 4] = [
    (120.0, 90.0),
    (370.0, 110.0),
    (360.0, 240.0),
    (130.0, 230.0),
];

/// How far the middles of the four corner patches are from where they were drawn, in pitches.
fn off(chart: &FoundChart, drawn: &Drawn) -> f64 {
    let corners = [0, 5, 23, 18].map(|i| chart.middle(i));
    let distance = |(a, b): (DVec2, DVec2)| a.distance(b) / chart.pitch();
    corners
        .into_iter()
        .zip(drawn.corners)
        .map(distance)
        .fold(0.0, f64::max)
}

#[test]
fn it_is_found_however_it_lies() {
    let mut corners = UPRIGHT;
    for turn in 0..4 {
        let drawn = Drawn::new((640, 480), corners);
        let charts = find_charts(&drawn.picture());
        assert_eq!(charts.len(), 1, "{turn}: {charts:?}");
        assert!(!charts[0].mirrored);
        assert!(off(&charts[0], &drawn) < 0.08, "{turn}: {charts:?}");
        // The same place, the chart lying otherwise.
        corners.rotate_left(1);
    }
    corners.swap(0, 1);
    corners.swap(2, 3);
    let drawn = Drawn::new((640, 480), corners);
    let charts = find_charts(&drawn.picture());
    assert!(charts[0].mirrored && off(&charts[0], &drawn) < 0.08);
}

#[test]
fn light_white_balance_and_curve_do_not_matter() {
    for (gains, response, noise) in [
        (DVec3::new(0.2, 0.22, 0.3), Response::srgb(), 0.0015),
        (DVec3::new(0.9, 0.5, 0.35), Response::gamma(2.4), 0.004),
        (DVec3::new(0.5, 0.9, 0.4), Response::linear(), 0.002),
        (DVec3::splat(1.5), Response::srgb(), 0.003),
    ] {
        let mut drawn = Drawn::new((640, 480), UPRIGHT);
        (drawn.gains, drawn.response, drawn.noise) = (gains, response, noise);
        let charts = find_charts(&drawn.picture());
        assert_eq!(charts.len(), 1, "{gains}");
        assert!(off(&charts[0], &drawn) < 0.1, "{gains}: {charts:?}");
    }
}

#[test]
fn a_shadow_across_does_not_hide_it() {
    let mut drawn = Drawn::new((640, 480), UPRIGHT);
    drawn.light = |p| DVec3::splat(if p.x + p.y > 5.2 { 0.45 } else { 1.0 });
    let charts = find_charts(&drawn.picture());
    assert_eq!(charts.len(), 1);
    assert!(off(&charts[0], &drawn) < 0.1, "{charts:?}");
}

#[test]
fn two_are_two_and_none_is_none() {
    let mut drawn = Drawn::new((800, 600), UPRIGHT);
    let mut picture = drawn.picture();
    let shift = DVec2::new(60.0, 260.0);
    drawn.corners = drawn.corners.map(|c| c + shift);
    drawn.draw_over(&mut picture);
    assert_eq!(find_charts(&picture).len(), 2);
    let nothing = Drawn::new(
        (640, 480),
        [(-900.0, 0.0), (-800.0, 0.0), (-800.0, 60.0), (-900.0, 60.0)],
    );
    assert_eq!(find_charts(&nothing.picture()), []);
    assert_eq!(find_charts(&Picture::default()), []);
}

#[test]
fn a_board_of_other_colours_is_no_chart() {
    // A grid of greys, then one of random colours, of the same shape.
    for colourful in [false, true] {
        let mut picture = Drawn::new((640, 480), UPRIGHT).picture();
        for y in 0..480u32 {
            for x in 0..640u32 {
                let (u, v) = ((f64::from(x) - 60.0) / 50.0, (f64::from(y) - 60.0) / 50.0);
                let on = u.fract() < 0.8 && v.fract() < 0.8;
                let k = (u as u32) * 7 + (v as u32) * 13;
                let i = 4 * (y * 640 + x) as usize;
                for c in 0..3u32 {
                    let step = if colourful { k * (c + 3) } else { k };
                    let code = 60 + (step * 37) % 190;
                    picture.rgba[i + c as usize] = if on { code as u8 } else { 20 };
                }
            }
        }
        assert_eq!(find_charts(&picture), [], "{colourful}");
    }
}
