//! File and report of a check.

use super::{Measured, Off};
use crate::report::{Page, Plot};
use crate::step::{CalibrationProvenance, Finished};
use penumbra_rig_model::Header;
use serde::Serialize;

/// Contents of a check's file.
#[derive(Debug, Serialize)]
struct Record {
    #[serde(flatten)]
    header: Header,
    figures: Vec<String>,
    reprojection_px: Option<f64>,
    reprojection_sigma_px: Option<f64>,
    among_markers_px: Option<f64>,
    delta_e: Option<f64>,
    latency_ms: Option<f64>,
    latency_sigma_ms: Option<f64>,
}

/// Returns the file, JSON.
pub(super) fn file(
    made: &CalibrationProvenance,
    found: &Finished,
    measured: &Measured,
) -> Option<String> {
    let latency = measured.latency.as_ref().and_then(|l| l.as_ref().ok());
    let reprojection = if measured.has_tracker {
        measured.tracked
    } else {
        measured.among
    };
    let record = Record {
        header: found.header("verify", made),
        figures: found.lines.clone(),
        reprojection_px: reprojection.map(|r| r.rms),
        reprojection_sigma_px: reprojection.map(|r| r.sigma),
        among_markers_px: measured.among.map(|r| r.rms),
        delta_e: measured.colours.map(|c| c.delta_e),
        latency_ms: latency.map(|l| 1e3 * l.seconds),
        latency_sigma_ms: latency.map(|l| 1e3 * l.sigma),
    };
    serde_json::to_string_pretty(&record)
        .ok()
        .map(|text| text + "\n")
}

/// Returns the report, HTML.
pub(super) fn page(made: &CalibrationProvenance, found: &Finished, corners: &[Off]) -> String {
    let facts = [format!("{}, from {}", made.date, made.source)];
    let mut page = Page::new("Check of the rig", &facts);
    page.verdict(found);
    let plot = |x: &str, y: &str, points: Vec<(f64, f64)>| Plot {
        x: x.to_owned(),
        y: y.to_owned(),
        series: vec![("corners".to_owned(), points, false)],
    };
    if !corners.is_empty() {
        page.heading("Markers");
        let over_time = corners.iter().map(|o| (o.seconds, o.by.length()));
        page.plot(
            &plot("s", "px beside its place", over_time.collect()),
            "By time: what grows drifts, what follows motion is latency.",
        );
        let scatter = corners.iter().map(|o| (o.by.x, o.by.y));
        page.plot(
            &plot("px to the right", "px down", scatter.collect()),
            "Where corners were found, seen from where they should be.",
        );
        let over_radius = corners.iter().map(|o| (o.at.x, o.by.length()));
        page.plot(
            &plot(
                "px across the picture",
                "px beside its place",
                over_radius.collect(),
            ),
            "By place: what grows towards the edges is the lens.",
        );
    }
    page.finish()
}
