//! The result file and the report of a check.

use super::{CornerError, Measurements};
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

/// Returns the result file, JSON; `None` if a figure cannot be serialised.
pub(super) fn result_file(
    provenance: &CalibrationProvenance,
    found: &Finished,
    measured: &Measurements,
) -> Option<String> {
    let latency = measured.latency.as_ref().and_then(|l| l.as_ref().ok());
    let reprojection = if measured.has_tracker {
        measured.by_tracker
    } else {
        measured.leave_one_out
    };
    let record = Record {
        header: found.header("verify", provenance),
        figures: found.lines.clone(),
        reprojection_px: reprojection.map(|r| r.rms).filter(|v| v.is_finite()),
        reprojection_sigma_px: reprojection.map(|r| r.sigma).filter(|v| v.is_finite()),
        among_markers_px: measured
            .leave_one_out
            .map(|r| r.rms)
            .filter(|v| v.is_finite()),
        delta_e: measured.colours.map(|c| c.delta_e),
        latency_ms: latency.map(|l| 1e3 * l.seconds),
        latency_sigma_ms: latency.map(|l| 1e3 * l.sigma),
    };
    serde_json::to_string_pretty(&record)
        .ok()
        .map(|text| text + "\n")
}

/// Returns the report, HTML.
pub(super) fn report(
    provenance: &CalibrationProvenance,
    found: &Finished,
    corners: &[CornerError],
) -> String {
    let facts = [format!("{}, from {}", provenance.date, provenance.source)];
    let mut page = Page::new("Check of the rig", &facts);
    page.verdict(found);
    let plot = |x: &str, y: &str, points: Vec<(f64, f64)>| Plot {
        x: x.to_owned(),
        y: y.to_owned(),
        series: vec![("corners".to_owned(), points, false)],
    };
    if corners.iter().any(|c| c.error.is_some()) {
        page.heading("Markers");
        let seen = || corners.iter().filter_map(|c| Some((c, c.error?)));
        let over_time = seen().map(|(c, error)| (c.seconds, error.length()));
        page.plot(
            &plot("s", "reprojection error, px", over_time.collect()),
            "Error over time: growth indicates drift, correlation with motion indicates latency.",
        );
        let scatter = seen().map(|(_, error)| (error.x, error.y));
        page.plot(
            &plot("px to the right", "px down", scatter.collect()),
            "Error vectors: detected minus predicted corner positions.",
        );
        let over_columns = seen().map(|(c, error)| (c.pixel.x, error.length()));
        page.plot(
            &plot(
                "column, px",
                "reprojection error, px",
                over_columns.collect(),
            ),
            "Error over picture columns: growth towards the edges indicates a wrong lens calibration.",
        );
    }
    page.finish()
}
