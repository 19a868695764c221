//! Report of the step `map`.

use super::build::{MapEstimate, TagEstimate};
use super::initial_poses::tag_corners;
use super::step::MapStep;
use crate::report::{Page, Plot};
use crate::step::{CalibrationProvenance, Finished};

/// Columns of the table of tags.
const COLUMNS: [&str; 9] = [
    "tag",
    "size, mm",
    "x, mm",
    "y, mm",
    "z, mm",
    "± mm",
    "± degrees",
    "observations",
    "RMS, px",
];

/// Returns the cells of a tag's row.
fn row(t: &TagEstimate) -> Vec<String> {
    let p = t.pose.translation * 1e3;
    vec![
        t.tag.name(),
        format!("{:.1}", 1e3 * t.tag.size),
        format!("{:.2}", p.x),
        format!("{:.2}", p.y),
        format!("{:.2}", p.z),
        format!("{:.2}", 1e3 * t.sigma.1.max_element()),
        format!("{:.3}", t.sigma.0.max_element().to_degrees()),
        format!("{} of {}", t.used_observations, t.observations),
        format!("{:.2}", t.rms),
    ]
}

impl MapStep {
    pub(super) fn report(
        &self,
        provenance: &CalibrationProvenance,
        found: &Finished,
        estimate: Option<&MapEstimate>,
    ) -> String {
        let facts = [
            format!("{}, from {}", provenance.date, provenance.source),
            format!(
                "{} pictures, {} views of several tags",
                self.pictures,
                self.views.len()
            ),
        ];
        let mut page = Page::new("Map of tags", &facts);
        page.verdict(found);
        let Some(estimate) = estimate else {
            return page.finish();
        };
        let mut rows = vec![COLUMNS.map(str::to_owned).to_vec()];
        rows.extend(estimate.tags.iter().map(row));
        page.table(&rows);
        let outline = |t: &TagEstimate| {
            let corners = tag_corners(t.tag.size).map(|c| t.pose.transform_point(c));
            let closed = corners.into_iter().chain([corners[0]]);
            let points = closed.map(|c| (c.x, c.y)).collect();
            (t.tag.id.to_string(), points, true)
        };
        let plot = Plot {
            x: "x, m".to_owned(),
            y: "y, m".to_owned(),
            series: estimate.tags.iter().map(outline).collect(),
        };
        page.plot(&plot, "Map from above (the axes differ in scale)");
        let errors = estimate
            .view_rms
            .iter()
            .enumerate()
            .map(|(i, e)| (i as f64, *e));
        let plot = Plot {
            x: "view".to_owned(),
            y: "reprojection error, px RMS".to_owned(),
            series: vec![("views".to_owned(), errors.collect(), false)],
        };
        page.plot(&plot, "Reprojection error of each view");
        page.finish()
    }
}
