//! One page that shows a lens's calibration: HTML with drawings in it, nothing to load.

use super::board::View;
use super::coverage::CELLS;
use super::estimate::ViewEstimate;
use super::gather::{Judged, Outcome};
use super::lens::{Lens, LensModel};
use super::pose::{board_pose, residual};
use crate::calibration::numeric::root_mean_square;
use glam::DVec2;
use std::fmt::Write;

/// How much longer than the picture's errors the lines are that show them.
const MAGNIFIED: f64 = 40.0;

/// The page. `title` names the camera, `lines` are facts for its head (date, source, board);
/// `views` are those that were given to the estimate.
#[must_use]
pub fn html(outcome: &Outcome, views: &[View], title: &str, lines: &[String]) -> String {
    let mut page = format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\n\
         <style>body{{font:15px/1.4 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}\
         svg{{width:100%;height:auto;background:#f4f4f4}}figure{{margin:1.5em 0}}\
         table{{border-collapse:collapse}}td,th{{padding:.15em .8em;text-align:right}}\
         .good{{color:#186a3b}}.usable{{color:#9a6700}}.refused{{color:#b42318}}\
         .two{{display:grid;grid-template-columns:1fr 1fr;gap:1em}}</style></head><body>\n<h1>{0}</h1>\n",
        escaped(title)
    );
    for line in lines {
        let _ = writeln!(page, "<div>{}</div>", escaped(line));
    }
    verdict(&mut page, outcome);
    if let Some(judged) = &outcome.result {
        parameters(&mut page, judged);
        coverage(&mut page, judged);
        before_and_after(&mut page, judged, views);
        scatter(&mut page, judged);
        by_view(&mut page, judged);
    }
    page.push_str("</body></html>\n");
    page
}

fn verdict(page: &mut String, outcome: &Outcome) {
    let grade = outcome.verdict.grade.name();
    let _ = writeln!(
        page,
        "<h2>Verdict: <span class=\"{grade}\">{grade}</span></h2>"
    );
    let _ = writeln!(
        page,
        "<p>{} pictures, {} views kept.</p><ul>",
        outcome.pictures, outcome.views
    );
    for (grade, finding) in &outcome.verdict.findings {
        let text = escaped(&finding.to_string());
        let _ = writeln!(page, "<li class=\"{}\">{text}</li>", grade.name());
    }
    for hint in &outcome.verdict.hints {
        let _ = writeln!(page, "<li>Next: {}</li>", escaped(hint));
    }
    page.push_str("</ul>\n");
}

fn parameters(page: &mut String, judged: &Judged) {
    let estimate = &judged.estimate;
    let lens = &estimate.lens;
    let _ = writeln!(
        page,
        "<h2>Lens</h2><p>{}, {}×{}; reprojection error {:.3} px RMS.</p>\n<table><tr><th></th><th>value</th><th>1σ</th></tr>",
        lens.model.name(),
        lens.width,
        lens.height,
        estimate.rms
    );
    let names = ["fx", "fy", "cx", "cy"];
    let names = names.iter().chain(lens.model.coefficients());
    for ((name, value), sigma) in names.zip(lens.parameters()).zip(estimate.sigma) {
        let _ = writeln!(
            page,
            "<tr><td>{name}</td><td>{value:.6}</td><td>{sigma:.6}</td></tr>"
        );
    }
    page.push_str("</table>\n");
}

/// Opens a drawing in the picture's pixels.
fn open(page: &mut String, lens: &Lens) {
    let _ = writeln!(page, "<svg viewBox=\"0 0 {} {}\">", lens.width, lens.height);
}

fn coverage(page: &mut String, judged: &Judged) {
    let lens = &judged.estimate.lens;
    page.push_str("<h2>Coverage</h2><figure>");
    open(page, lens);
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
            page,
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
            dot(page, p.pixel, lens, "#246");
        }
    }
    let _ = writeln!(
        page,
        "</svg><figcaption>Corners that were used, in {:.0} % of the picture. Colour and figures: how far, 1σ in pixels, \
         the picture of a direction may be off there. The board faced left by {:.0}°, right {:.0}°, up {:.0}°, down {:.0}°.</figcaption></figure>",
        100.0 * judged.coverage.share,
        judged.tilt.left.to_degrees(),
        judged.tilt.right.to_degrees(),
        judged.tilt.up.to_degrees(),
        judged.tilt.down.to_degrees()
    );
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
fn before_and_after(page: &mut String, judged: &Judged, views: &[View]) {
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
    page.push_str("<h2>Before and after</h2><div class=\"two\">\n");
    let ideal = if lens.model == LensModel::KannalaBrandt {
        "an equidistant lens"
    } else {
        "a lens without distortion"
    };
    errors(
        page,
        lens,
        &before,
        &format!("Before: {ideal} with the same focal length"),
    );
    errors(page, lens, &after, "After: the lens found");
    page.push_str("</div>\n");
}

fn errors(page: &mut String, lens: &Lens, errors: &[(DVec2, DVec2)], caption: &str) {
    let rms = root_mean_square(errors.iter().map(|(_, e)| e.length()));
    // Large errors are shown less magnified: lines over the whole picture show nothing.
    let times = MAGNIFIED
        .min(0.06 * f64::from(lens.width) / rms.max(1e-6))
        .max(1.0);
    page.push_str("<figure>");
    open(page, lens);
    let thin = f64::from(lens.width) / 700.0;
    for (p, e) in errors {
        let q = *p + *e * times;
        let _ = write!(
            page,
            "<line x1=\"{:.1}\" y1=\"{:.1}\" x2=\"{:.1}\" y2=\"{:.1}\" stroke=\"#b42318\" stroke-width=\"{thin:.2}\"/>",
            p.x, p.y, q.x, q.y
        );
    }
    let _ = writeln!(
        page,
        "</svg><figcaption>{}: {rms:.3} px RMS; lines {times:.0} times as long.</figcaption></figure>",
        escaped(caption)
    );
}

/// Errors about their origin: round if nothing is systematic.
fn scatter(page: &mut String, judged: &Judged) {
    let rms = judged.estimate.rms.max(1e-6);
    let reach = 4.0 * rms;
    let _ = writeln!(
        page,
        "<h2>Residuals</h2><figure style=\"max-width:24em\"><svg viewBox=\"-100 -100 200 200\">\
         <path d=\"M-100 0H100M0 -100V100\" stroke=\"#aaa\" stroke-width=\".5\"/>\
         <circle r=\"25\" fill=\"none\" stroke=\"#888\" stroke-width=\".5\"/>"
    );
    for point in judged
        .estimate
        .views
        .iter()
        .filter(|v| v.used)
        .flat_map(|v| &v.points)
    {
        let p = (point.error / reach * 100.0).clamp(DVec2::splat(-99.0), DVec2::splat(99.0));
        let colour = if point.used { "#246" } else { "#b42318" };
        let _ = write!(
            page,
            "<circle cx=\"{:.1}\" cy=\"{:.1}\" r=\".9\" fill=\"{colour}\"/>",
            p.x, p.y
        );
    }
    let _ = writeln!(
        page,
        "</svg><figcaption>Each corner's error; the circle is the RMS of {rms:.3} px, red ones were left out.</figcaption></figure>"
    );
}

fn by_view(page: &mut String, judged: &Judged) {
    page.push_str("<h2>Views</h2><table><tr><th>view</th><th>corners used</th><th>RMS px</th><th></th></tr>\n");
    let most = judged
        .estimate
        .views
        .iter()
        .map(|v| v.rms)
        .fold(1e-6, f64::max);
    for view in &judged.estimate.views {
        view_row(page, view, most);
    }
    page.push_str("</table>\n");
}

fn view_row(page: &mut String, view: &ViewEstimate, most: f64) {
    let used = view.points.iter().filter(|p| p.used).count();
    let (colour, note) = if view.used {
        ("#246", "")
    } else {
        ("#b42318", " left out")
    };
    let _ = writeln!(
        page,
        "<tr><td>{}{note}</td><td>{used} / {}</td><td>{:.3}</td><td style=\"text-align:left\">\
         <svg viewBox=\"0 0 100 6\" style=\"width:14em\"><rect width=\"{:.1}\" height=\"6\" fill=\"{colour}\"/></svg></td></tr>",
        escaped(&view.name),
        view.points.len(),
        view.rms,
        100.0 * view.rms / most
    );
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
}

#[cfg(test)]
mod tests;
