//! Report of a lens calibration: HTML with embedded plots, without external resources.

use super::board::View;
use super::coverage::CELLS;
use super::estimate::ViewEstimate;
use super::pose::{board_pose, residual};
use super::view_collector::{AssessedLens, Outcome};
use crate::report::{Page, Plot};
use crate::step::Finished;
use glam::DVec2;
use penumbra_camera::{Lens, LensModel};
use penumbra_numerics::root_mean_square;
use std::fmt::Write;

/// Maximum magnification of the error vectors.
const MAX_MAGNIFICATION: f64 = 40.0;

/// Builds the report. `title` names the camera, `facts` are lines of its header (date, source,
/// board); `views` are the input of the estimate.
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
    if let Some(assessed) = &outcome.result {
        parameters(&mut page, assessed);
        coverage(&mut page, assessed);
        before_and_after(&mut page, assessed, views);
        scatter(&mut page, assessed);
        by_view(&mut page, assessed);
    }
    page.finish()
}

/// Returns the lens with its uncertainty as lines of text.
#[must_use]
pub fn lines(assessed: &AssessedLens) -> Vec<String> {
    let (estimate, sigma) = (&assessed.estimate, &assessed.estimate.sigma);
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
            "corners in {:.0} % of the picture; standard deviation of a projected direction: median {:.2} px, maximum {:.2} px",
            100.0 * assessed.coverage.share,
            assessed.uncertainty.median,
            assessed.uncertainty.worst
        ),
    ];
    lines.extend(assessed.rim.map(|rim| {
        format!(
            "corners up to {:.1}° from the axis, the lens is determined to {:.1}°",
            rim.seen.to_degrees(),
            rim.known.to_degrees()
        )
    }));
    lines
}

fn parameters(page: &mut Page, assessed: &AssessedLens) {
    let lens = &assessed.estimate.lens;
    page.heading("Lens");
    let row = |cells: [String; 3]| cells.to_vec();
    let mut rows = vec![row([lens.model.name(), "value", "1σ"].map(str::to_owned))];
    let names = ["fx", "fy", "cx", "cy"];
    let names = names.iter().chain(lens.model.coefficients());
    for ((name, value), sigma) in names.zip(lens.parameters()).zip(assessed.estimate.sigma) {
        let name = (*name).to_owned();
        rows.push(row([name, format!("{value:.6}"), format!("{sigma:.6}")]));
    }
    page.table(&rows);
}

/// Opens an SVG in the picture's pixels.
fn open_svg(lens: &Lens) -> String {
    format!("<svg viewBox=\"0 0 {} {}\">", lens.width, lens.height)
}

fn coverage(page: &mut Page, assessed: &AssessedLens) {
    let lens = &assessed.estimate.lens;
    page.heading("Coverage");
    let mut svg = open_svg(lens);
    let (columns, rows) = CELLS;
    let cell = DVec2::new(
        f64::from(lens.width) / columns as f64,
        f64::from(lens.height) / rows as f64,
    );
    for (i, sigma) in assessed.uncertainty.by_cell.iter().enumerate() {
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
    for view in assessed.estimate.views.iter().filter(|v| v.used) {
        for p in view.points.iter().filter(|p| p.used) {
            dot(&mut svg, p.pixel, lens, "#246");
        }
    }
    svg.push_str("</svg>");
    let caption = format!(
        "Corners used, in {:.0} % of the picture. Colours and numbers: standard deviation of a direction's \
         pixel, pixels. The board faced left by {:.0}°, right {:.0}°, up {:.0}°, down {:.0}°.",
        100.0 * assessed.coverage.share,
        assessed.tilt.left.to_degrees(),
        assessed.tilt.right.to_degrees(),
        assessed.tilt.up.to_degrees(),
        assessed.tilt.down.to_degrees()
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

/// Draws the errors of the lens without distortion and of the lens found.
fn before_and_after(page: &mut Page, assessed: &AssessedLens, views: &[View]) {
    let lens = &assessed.estimate.lens;
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
    let used = assessed
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

/// Returns a drawing of error vectors and its caption.
fn errors(lens: &Lens, errors: &[(DVec2, DVec2)], caption: &str) -> (String, String) {
    let rms = root_mean_square(errors.iter().map(|(_, e)| e.length()));
    // Large errors are magnified less, so that the vectors remain legible.
    let times = MAX_MAGNIFICATION
        .min(0.06 * f64::from(lens.width) / rms.max(1e-6))
        .max(1.0);
    let mut svg = open_svg(lens);
    let stroke = f64::from(lens.width) / 700.0;
    for (p, e) in errors {
        let q = *p + *e * times;
        let _ = write!(
            svg,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#b42318\" stroke-width=\"{stroke:.2}\"/>",
            p.x, p.y, q.x, q.y
        );
    }
    svg.push_str("</svg>");
    let caption = format!("{caption}: {rms:.3} px RMS; error vectors magnified {times:.0} times.");
    (svg, caption)
}

/// Draws the errors around the origin; without systematic errors the cloud is round.
fn scatter(page: &mut Page, assessed: &AssessedLens) {
    let rms = assessed.estimate.rms.max(1e-6);
    let reach = 4.0 * rms;
    let mut svg = String::from(
        "<svg viewBox=\"-100 -100 200 200\" style=\"max-width:24em\">\
         <path d=\"M-100 0H100M0 -100V100\" stroke=\"#aaa\" stroke-width=\".5\"/>\
         <circle r=\"25\" fill=\"none\" stroke=\"#888\" stroke-width=\".5\"/>",
    );
    let views = assessed.estimate.views.iter().filter(|v| v.used);
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
    let caption =
        format!("Error of each corner; the circle is the RMS of {rms:.3} px, outliers are red.");
    page.figure(&svg, &caption);
}

fn by_view(page: &mut Page, assessed: &AssessedLens) {
    let views = &assessed.estimate.views;
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
            ("rejected".to_owned(), points(false), false),
        ],
    };
    page.plot(&plot, "Reprojection error by view.");
    let head = ["view", "corners used", "of", "RMS px", ""].map(str::to_owned);
    let rows = std::iter::once(head.to_vec()).chain(views.iter().map(row));
    page.table(&rows.collect::<Vec<_>>());
}

fn row(view: &ViewEstimate) -> Vec<String> {
    let used = view.points.iter().filter(|p| p.used).count();
    let note = if view.used { "" } else { "rejected" };
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
