//! Calibration reports: HTML pages with embedded plots, without external resources.

use super::step::Finished;
use penumbra_rig_model::Grade;
use std::fmt::Write;

/// Width and height of a plot, SVG user units.
const PLOT: (f64, f64) = (640.0, 300.0);
/// Margin for the axes' labels, SVG user units.
const EDGE: f64 = 48.0;
/// Colours of the series of a plot.
const COLOURS: [&str; 4] = ["#1d4ed8", "#c2410c", "#15803d", "#7e22ce"];

/// Escapes a text for HTML.
#[must_use]
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// An HTML page, built from top to bottom.
#[derive(Debug)]
pub struct Page(String);

impl Page {
    /// Creates a page with a heading and facts below it (date, source, board).
    #[must_use]
    pub fn new(title: &str, facts: &[String]) -> Self {
        let mut page = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{0}</title>\n\
             <style>body{{font:15px/1.4 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}}\
             svg,img{{width:100%;height:auto;background:#f4f4f4}}figure{{margin:1.5em 0}}\
             table{{border-collapse:collapse}}td,th{{padding:.15em .8em;text-align:right}}\
             .good{{color:#186a3b}}.usable{{color:#9a6700}}.refused{{color:#b42318}}\
             .two{{display:grid;grid-template-columns:1fr 1fr;gap:1em}}</style></head><body>\n<h1>{0}</h1>\n",
            escaped(title)
        );
        for fact in facts {
            let _ = writeln!(page, "<div>{}</div>", escaped(fact));
        }
        Self(page)
    }

    /// Appends the grade, findings, hints and figures of a result.
    pub fn verdict(&mut self, found: &Finished) {
        let grade = found.grade.name();
        let _ = writeln!(
            self.0,
            "<h2>Verdict: <span class=\"{grade}\">{grade}</span></h2><ul>"
        );
        for (grade, finding) in &found.findings {
            let (class, text) = (Grade::name(*grade), escaped(finding));
            let _ = writeln!(self.0, "<li class=\"{class}\">{text}</li>");
        }
        for hint in &found.hints {
            let _ = writeln!(self.0, "<li>Next: {}</li>", escaped(hint));
        }
        self.0.push_str("</ul>\n");
        for line in &found.lines {
            let _ = writeln!(self.0, "<p>{}</p>", escaped(line));
        }
    }

    /// Appends a heading.
    pub fn heading(&mut self, text: &str) {
        let _ = writeln!(self.0, "<h2>{}</h2>", escaped(text));
    }

    /// Appends a table; the first row is its header.
    pub fn table(&mut self, rows: &[Vec<String>]) {
        self.0.push_str("<table>");
        for (i, row) in rows.iter().enumerate() {
            let tag = if i == 0 { "th" } else { "td" };
            let cells: String = row
                .iter()
                .map(|cell| format!("<{tag}>{}</{tag}>", escaped(cell)))
                .collect();
            let _ = write!(self.0, "<tr>{cells}</tr>");
        }
        self.0.push_str("</table>\n");
    }

    /// Appends a figure with a caption: an `<svg>`, or an `<img>` with embedded data.
    pub fn figure(&mut self, drawing: &str, caption: &str) {
        let caption = escaped(caption);
        let _ = writeln!(
            self.0,
            "<figure>{drawing}<figcaption>{caption}</figcaption></figure>"
        );
    }

    /// Appends figures with their captions, two in a row.
    pub fn side_by_side(&mut self, figures: &[(String, String)]) {
        self.0.push_str("<div class=\"two\">\n");
        for (drawing, caption) in figures {
            self.figure(drawing, caption);
        }
        self.0.push_str("</div>\n");
    }

    /// Appends a plot with a caption.
    pub fn plot(&mut self, plot: &Plot, caption: &str) {
        self.figure(&plot.svg(), caption);
    }

    /// Returns the complete page.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.0.push_str("</body></html>\n");
        self.0
    }
}

/// A series: name, points, and whether a line joins them.
pub type Series = (String, Vec<(f64, f64)>, bool);

/// A plot of points or lines over two axes.
#[derive(Clone, Debug, Default)]
pub struct Plot {
    /// Name and unit of the horizontal axis.
    pub x: String,
    /// Name and unit of the vertical axis.
    pub y: String,
    /// The series.
    pub series: Vec<Series>,
}

impl Plot {
    /// Returns the plot as SVG, without points that are not finite.
    #[must_use]
    pub fn svg(&self) -> String {
        let all = || {
            let points = self.series.iter().flat_map(|s| &s.1);
            points.filter(|p| p.0.is_finite() && p.1.is_finite())
        };
        let ((left, right), (low, high)) = (span(all().map(|p| p.0)), span(all().map(|p| p.1)));
        let (width, height) = PLOT;
        let x = |v: f64| EDGE + (v - left) / (right - left) * (width - 2.0 * EDGE);
        let y = |v: f64| height - EDGE - (v - low) / (high - low) * (height - 2.0 * EDGE);
        let mut svg = format!(
            "<svg viewBox=\"0 0 {width} {height}\" font-size=\"11\"><path fill=\"none\" stroke=\"#888\" \
             d=\"M{EDGE} {EDGE}V{0}H{1}\"/>",
            height - EDGE,
            width - EDGE
        );
        let texts = [
            (EDGE, height - EDGE + 14.0, "middle", number(left)),
            (width - EDGE, height - EDGE + 14.0, "middle", number(right)),
            (0.5 * width, height - EDGE + 28.0, "middle", self.x.clone()),
            (EDGE - 4.0, height - EDGE, "end", number(low)),
            (EDGE - 4.0, EDGE + 4.0, "end", number(high)),
            (4.0, EDGE - 16.0, "start", self.y.clone()),
        ];
        for (x, y, anchor, text) in texts {
            let text = escaped(&text);
            let _ = write!(
                svg,
                "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>"
            );
        }
        for (i, (name, points, joined)) in self.series.iter().enumerate() {
            let colour = COLOURS[i % COLOURS.len()];
            let finite = points.iter().filter(|p| p.0.is_finite() && p.1.is_finite());
            let mut path = String::new();
            for (n, point) in finite.enumerate() {
                let (x, y) = (x(point.0), y(point.1));
                let _ = match (joined, n) {
                    (true, 0) => write!(path, "M{x:.1} {y:.1}"),
                    (true, _) => write!(path, "L{x:.1} {y:.1}"),
                    (false, _) => write!(path, "M{x:.1} {y:.1}h.01"),
                };
            }
            let thick = if *joined { 1.5 } else { 4.0 };
            let _ = write!(
                svg,
                "<path fill=\"none\" stroke=\"{colour}\" stroke-width=\"{thick}\" stroke-linecap=\"round\" \
                 d=\"{path}\"/><text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"end\" fill=\"{colour}\">{}</text>",
                width - 4.0,
                16.0 + 14.0 * i as f64,
                escaped(name)
            );
        }
        svg.push_str("</svg>");
        svg
    }
}

/// Returns minimum and maximum, widened by a margin; 0 and 1 without values.
fn span(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
    if low > high {
        return (0.0, 1.0);
    }
    let room = (0.04 * (high - low)).max(1e-9 * high.abs().max(1e-3));
    (low - room, high + room)
}

/// Formats a number with three significant digits.
fn number(value: f64) -> String {
    let digits = 2 - value.abs().max(1e-6).log10().floor() as i32;
    format!("{value:.*}", digits.clamp(0, 8) as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_contains_verdict_and_escapes_text() {
        let mut page = Page::new("A <b> & c", &["from x\"y".to_owned()]);
        let found = Finished {
            grade: Grade::Usable,
            lines: vec!["1 < 2".to_owned()],
            findings: vec![(Grade::Usable, "few".to_owned())],
            hints: vec!["more".to_owned()],
            report: String::new(),
            file: None,
        };
        page.verdict(&found);
        page.table(&[vec!["a".to_owned()], vec!["1".to_owned()]]);
        let page = page.finish();
        for part in [
            "A &lt;b&gt; &amp; c",
            "x&quot;y",
            "1 &lt; 2",
            "Next: more",
            "<td>1</td>",
            "class=\"usable\"",
        ] {
            assert!(page.contains(part), "{part}: {page}");
        }
    }

    #[test]
    fn plot_keeps_all_finite_points_within_its_frame() {
        let plot = Plot {
            x: "s".to_owned(),
            y: "px".to_owned(),
            series: vec![
                (
                    "a".to_owned(),
                    vec![(0.0, 1.0), (2.0, f64::NAN), (4.0, 3.0)],
                    true,
                ),
                ("b".to_owned(), vec![(1.0, 2.0)], false),
            ],
        };
        let svg = plot.svg();
        assert!(svg.contains("L") && !svg.contains("NaN"), "{svg}");
        assert!(Plot::default().svg().ends_with("</svg>"));
    }
}
