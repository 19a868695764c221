//! Report of a lens calibration: HTML with embedded plots, without external resources.

use super::board::View;
use super::coverage::CELLS;
use super::estimate::ViewEstimate;
use super::gather::{Judged, Outcome};
use super::pose::{board_pose, residual};
use crate::report::{Page, Plot};
use crate::step::Finished;
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};
use penumbra_numerics::root_mean_square;
use std::fmt::Write;

/// Magnification of the error vectors.
const MAGNIFIED: f64 = 40.0;

/// The page. `title` names the camera, `facts` are for its head (date, source, board);
/// `views` are those that were given to the estimate.
#[must_use]
pub fn page(
    found: &Finished,
    outcome: &Outcome,
    views: &[View],
    title: &str,
    facts: &[String],
) -> String {
    let mut page = Page::new(title, facts);
    page.verdict(found);
    if let Some(judged) = &outcome.result {
        parameters(&mut page, judged);
        coverage(&mut page, judged);
        before_and_after(&mut page, judged, views);
        scatter(&mut page, judged);
        by_view(&mut page, judged);
    }
    page.finish()
}

/// Returns the figures with their uncertainty, one line each.
#[must_use]
pub fn lines(judged: &Judged) -> Vec<String> {
    let (estimate, sigma) = (&judged.estimate, &judged.estimate.sigma);
    let lens = &estimate.lens;
    let names = lens.model.coefficients();
    let coefficients: Vec<String> = names
        .iter()
        .zip(lens.coefficients)
        .zip(&sigma[4..])
        .map(|((name, value), sigma)| format!("{name} {value:.5} ± {sigma:.5}"))
        .collect();
    let mut lines = vec![
        format!(
            "reprojection {:.3} px RMS; f {:.2} ± {:.2}, {:.2} ± {:.2} px; centre {:.2} ± {:.2}, {:.2} ± {:.2} px",
            estimate.rms,
            lens.focal.x,
            sigma[0],
            lens.focal.y,
            sigma[1],
            lens.centre.x,
            sigma[2],
            lens.centre.y,
            sigma[3]
        ),
        coefficients.join(", "),
        format!(
            "corners in {:.0} % of the picture; a direction's picture is known to {:.2} px in the middle of all, {:.2} px at worst (1σ)",
            100.0 * judged.coverage.share,
            judged.uncertainty.median,
            judged.uncertainty.worst
        ),
    ];
    lines.extend(judged.rim.map(|rim| {
        format!(
            "corners seen up to {:.1}° from the axis, the lens is known to {:.1}°",
            rim.seen.to_degrees(),
            rim.known.to_degrees()
        )
    }));
    lines
}

fn parameters(page: &mut Page, judged: &Judged) {
    let lens = &judged.estimate.lens;
    page.heading("Lens");
    let row = |cells: [String; 3]| cells.to_vec();
    let mut rows = vec![row([lens.model.name(), "value", "1σ"].map(str::to_owned))];
    let names = ["fx", "fy", "cx", "cy"];
    let names = names.iter().chain(lens.model.coefficients());
    for ((name, value), sigma) in names.zip(lens.parameters()).zip(judged.estimate.sigma) {
        let name = (*name).to_owned();
        rows.push(row([name, format!("{value:.6}"), format!("{sigma:.6}")]));
    }
    page.table(&rows);
}

/// Opens a drawing in the picture's pixels.
fn open(lens: &Lens) -> String {
    format!("<svg viewBox=\"0 0 {} {}\">", lens.width, lens.height)
}

fn coverage(page: &mut Page, judged: &Judged) {
    let lens = &judged.estimate.lens;
    page.heading("Coverage");
    let mut svg = open(lens);
    let (columns, rows) = CELLS;
    let cell = DVec2::new(
        f64::from(lens.width) / columns as f64,
        f64::from(lens.height) / rows as f64,
    );
    for (i, sigma) in judged.uncertainty.by_cell.iter().enumerate() {
        let (x, y) = ((i % columns) as f64 * cell.x, (i / columns) as f64 * cell.y);
        let Some(sigma) = sigma else { continue };
        // Green below 0.2 px, red above 2.
        let hue = (120.0 - 120.0 * (sigma / 0.2).log10()).clamp(0.0, 120.0);
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"hsl({hue:.0} 60% 80%)\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" font-size=\"{:.1}\" fill=\"#555\">{sigma:.2}</text>",
            cell.x,
            cell.y,
            x + 0.06 * cell.x,
            y + 0.24 * cell.y,
            0.18 * cell.y
        );
    }
    for view in judged.estimate.views.iter().filter(|v| v.used) {
        for p in view.points.iter().filter(|p| p.used) {
            dot(&mut svg, p.pixel, lens, "#246");
        }
    }
    svg.push_str("</svg>");
    let caption = format!(
        "Corners that were used, in {:.0} % of the picture. Colour and figures: how far, 1σ in pixels, \
         the picture of a direction may be off there. The board faced left by {:.0}°, right {:.0}°, up {:.0}°, down {:.0}°.",
        100.0 * judged.coverage.share,
        judged.tilt.left.to_degrees(),
        judged.tilt.right.to_degrees(),
        judged.tilt.up.to_degrees(),
        judged.tilt.down.to_degrees()
    );
    page.figure(&svg, &caption);
}

fn dot(page: &mut String, p: DVec2, lens: &Lens, colour: &str) {
    let r = f64::from(lens.width) / 400.0;
    let _ = write!(
        page,
        "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"{r:.1}\" fill=\"{colour}\"/>",
        p.x, p.y
    );
}

/// The errors of the lens without distortion, and of the one found.
fn before_and_after(page: &mut Page, judged: &Judged, views: &[View]) {
    let lens = &judged.estimate.lens;
    let mut plain = lens.clone();
    plain.coefficients = [0.0; 8];
    let mut before: Vec<(DVec2, DVec2)> = Vec::new();
    for view in views {
        let Some(pose) = board_pose(&plain, &view.points) else {
            continue;
        };
        let errors = view.points.iter().filter_map(|c| {
            let (error, _) = residual(&plain, c, pose)?;
            Some((c.pixel, error))
        });
        before.extend(errors);
    }
    let used = judged
        .estimate
        .views
        .iter()
        .flat_map(|v| v.points.iter().filter(|p| p.used));
    let after: Vec<(DVec2, DVec2)> = used.map(|p| (p.pixel, p.error)).collect();
    let ideal = if lens.model == LensModel::KannalaBrandt {
        "an equidistant lens"
    } else {
        "a lens without distortion"
    };
    page.heading("Before and after");
    let before_caption = format!("Before: {ideal} with the same focal length");
    page.side_by_side(&[
        errors(lens, &before, &before_caption),
        errors(lens, &after, "After: the lens found"),
    ]);
}

/// A drawing of errors, and what is seen there.
fn errors(lens: &Lens, errors: &[(DVec2, DVec2)], caption: &str) -> (String, String) {
    let rms = root_mean_square(errors.iter().map(|(_, e)| e.length()));
    // Large errors are magnified less, so that the vectors remain legible.
    let times = MAGNIFIED
        .min(0.06 * f64::from(lens.width) / rms.max(1e-6))
        .max(1.0);
    let mut svg = open(lens);
    let thin = f64::from(lens.width) / 700.0;
    for (p, e) in errors {
        let q = *p + *e * times;
        let _ = write!(
            svg,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#b42318\" stroke-width=\"{thin:.2}\"/>",
            p.x, p.y, q.x, q.y
        );
    }
    svg.push_str("</svg>");
    let caption = format!("{caption}: {rms:.3} px RMS; lines {times:.0} times as long.");
    (svg, caption)
}

/// Draws the errors around the origin; without systematic errors the cloud is round.
fn scatter(page: &mut Page, judged: &Judged) {
    let rms = judged.estimate.rms.max(1e-6);
    let reach = 4.0 * rms;
    let mut svg = String::from(
        "<svg viewBox=\"-100 -100 200 200\" style=\"max-width:24em\">\
         <path d=\"M-100 0H100M0 -100V100\" stroke=\"#aaa\" stroke-width=\".5\"/>\
         <circle r=\"25\" fill=\"none\" stroke=\"#888\" stroke-width=\".5\"/>",
    );
    let views = judged.estimate.views.iter().filter(|v| v.used);
    for point in views.flat_map(|v| &v.points) {
        let p = (point.error / reach * 100.0).clamp(DVec2::splat(-99.0), DVec2::splat(99.0));
        let colour = if point.used { "#246" } else { "#b42318" };
        let _ = write!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\".9\" fill=\"{colour}\"/>",
            p.x, p.y
        );
    }
    svg.push_str("</svg>");
    page.heading("Residuals");
    let caption = format!(
        "Each corner's error; the circle is the RMS of {rms:.3} px, red ones were left out."
    );
    page.figure(&svg, &caption);
}

fn by_view(page: &mut Page, judged: &Judged) {
    let views = &judged.estimate.views;
    page.heading("Views");
    let points = |used: bool| -> Vec<(f64, f64)> {
        let all = views.iter().enumerate().filter(|(_, v)| v.used == used);
        all.map(|(i, v)| (i as f64 + 1.0, v.rms)).collect()
    };
    let plot = Plot {
        x: "view".to_owned(),
        y: "RMS, px".to_owned(),
        series: vec![
            ("used".to_owned(), points(true), false),
            ("left out".to_owned(), points(false), false),
        ],
    };
    page.plot(&plot, "Reprojection error by view.");
    let head = ["view", "corners used", "of", "RMS px", ""].map(str::to_owned);
    let rows = std::iter::once(head.to_vec()).chain(views.iter().map(row));
    page.table(&rows.collect::<Vec<_>>());
}

fn row(view: &ViewEstimate) -> Vec<String> {
    let used = view.points.iter().filter(|p| p.used).count();
    let note = if view.used { "" } else { "left out" };
    vec![
        view.name.clone(),
        used.to_string(),
        view.points.len().to_string(),
        format!("{:.3}", view.rms),
        note.to_owned(),
    ]
}

#[cfg(test)]
mod tests;
