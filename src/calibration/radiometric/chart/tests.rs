use super::*;
use crate::radiometric::synthetic::SyntheticChart;
use glam::DVec3;
use penumbra_camera::Response;

const UPRIGHT: [(f64, f64); 4] = [
    (120.0, 90.0),
    (370.0, 110.0),
    (360.0, 240.0),
    (130.0, 230.0),
];

/// Returns the largest position error of the four corner patches, in pitches.
fn position_error(chart: &FoundChart, synthetic: &SyntheticChart) -> f64 {
    let corners = [0, 5, 23, 18].map(|i| chart.centre(i));
    let distance = |(a, b): (DVec2, DVec2)| a.distance(b) / chart.pitch();
    corners
        .into_iter()
        .zip(synthetic.corners)
        .map(distance)
        .fold(0.0, f64::max)
}

#[test]
fn finds_chart_in_every_orientation() {
    let mut corners = UPRIGHT;
    for orientation in 0..4 {
        let synthetic = SyntheticChart::new((640, 480), corners);
        let charts = find_charts(&synthetic.picture());
        assert_eq!(charts.len(), 1, "{orientation}: {charts:?}");
        assert!(!charts[0].mirrored);
        assert!(
            position_error(&charts[0], &synthetic) < 0.08,
            "{orientation}: {charts:?}"
        );
        // The same position in the next orientation.
        corners.rotate_left(1);
    }
    corners.swap(0, 1);
    corners.swap(2, 3);
    let synthetic = SyntheticChart::new((640, 480), corners);
    let charts = find_charts(&synthetic.picture());
    assert!(charts[0].mirrored && position_error(&charts[0], &synthetic) < 0.08);
}

#[test]
fn finds_chart_for_any_exposure_white_balance_and_tone_curve() {
    for (gains, response, noise) in [
        (DVec3::new(0.2, 0.22, 0.3), Response::srgb(), 0.0015),
        (DVec3::new(0.9, 0.5, 0.35), Response::gamma(2.4), 0.004),
        (DVec3::new(0.5, 0.9, 0.4), Response::linear(), 0.002),
        (DVec3::splat(1.5), Response::srgb(), 0.003),
    ] {
        let mut synthetic = SyntheticChart::new((640, 480), UPRIGHT);
        (synthetic.gains, synthetic.response, synthetic.noise) = (gains, response, noise);
        let charts = find_charts(&synthetic.picture());
        assert_eq!(charts.len(), 1, "{gains}");
        assert!(
            position_error(&charts[0], &synthetic) < 0.1,
            "{gains}: {charts:?}"
        );
    }
}

#[test]
fn finds_chart_with_shadow() {
    let mut synthetic = SyntheticChart::new((640, 480), UPRIGHT);
    synthetic.light = |p| DVec3::splat(if p.x + p.y > 5.2 { 0.45 } else { 1.0 });
    let charts = find_charts(&synthetic.picture());
    assert_eq!(charts.len(), 1);
    assert!(position_error(&charts[0], &synthetic) < 0.1, "{charts:?}");
}

#[test]
fn finds_two_charts_and_none() {
    let mut synthetic = SyntheticChart::new((800, 600), UPRIGHT);
    let mut picture = synthetic.picture();
    let shift = DVec2::new(60.0, 260.0);
    synthetic.corners = synthetic.corners.map(|c| c + shift);
    synthetic.draw_over(&mut picture);
    assert_eq!(find_charts(&picture).len(), 2);
    let nothing = SyntheticChart::new(
        (640, 480),
        [(-900.0, 0.0), (-800.0, 0.0), (-800.0, 60.0), (-900.0, 60.0)],
    );
    assert_eq!(find_charts(&nothing.picture()), []);
    assert_eq!(find_charts(&Picture::default()), []);
}

#[test]
fn rejects_grids_of_other_colours() {
    // A grid of greys, then one of random colours, of the same shape.
    for colourful in [false, true] {
        let mut picture = SyntheticChart::new((640, 480), UPRIGHT).picture();
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
