use super::*;
use crate::intrinsics::estimate::tests::{pinhole, poses, simulated_views};
use crate::intrinsics::{Board, Options, ViewCollector};
use penumbra_numerics::Random;

#[test]
fn report_shows_result_and_escapes_names() {
    let lens = pinhole();
    let mut collector = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap());
    let views = simulated_views(&lens, &poses(12, 0.4, 0.3, 5), 0.15, &mut Random::new(2));
    for view in views {
        collector.add_points("<a&b>", (640, 480), view.points);
    }
    let options = Options {
        model: LensModel::Brown,
        square_pixels: false,
    };
    let outcome = collector.finish(&options);
    let shown = |outcome: &Outcome, views: &[View]| {
        let found = Finished {
            grade: outcome.assessment.grade,
            lines: outcome.result.iter().flat_map(lines).collect(),
            findings: Vec::new(),
            hints: Vec::new(),
            report: String::new(),
            file: None,
        };
        page(
            &found,
            outcome,
            views,
            "scene camera",
            &["today".to_owned()],
        )
    };
    let none = ViewCollector::new(Board::parse("chess:9x6:0.025").unwrap()).finish(&options);
    assert!(shown(&none, &[]).contains("refused"));
    let page = shown(&outcome, collector.views());
    assert_eq!(page.matches("<svg").count(), page.matches("</svg>").count());
    assert_eq!(page.matches("<svg").count(), 5);
    assert!(page.contains("&lt;a&amp;b&gt;") && !page.contains("<a&b>"));
    assert!(page.contains("Verdict") && !page.contains("NaN") && !page.contains("inf"));
    // Without distortion the lens fits the views much worse.
    let rms = |caption: &str| -> f64 {
        let at = page.find(caption).unwrap();
        let text = &page[at..];
        let number = text
            .split(" px RMS")
            .next()
            .unwrap()
            .rsplit(' ')
            .next()
            .unwrap();
        number.parse().unwrap()
    };
    assert!(
        rms("Before:") > 5.0 * rms("After:"),
        "{} {}",
        rms("Before:"),
        rms("After:")
    );
}
