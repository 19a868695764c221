//! Publishes the tracker's latency in the status and the report.

use crate::frame::PreparedFrame;
use crate::latency_monitor::LatencyState;
use crate::report::LatencyReport;
use penumbra_status::Snapshot;

/// Minimum deviation of the measured from the active latency that is a contradiction, standard
/// deviations. [`MIN_DEVIATION_MS`] must be exceeded, too.
const MIN_DEVIATION_SIGMAS: f64 = 3.0;
/// Minimum deviation that is a contradiction, milliseconds.
const MIN_DEVIATION_MS: f64 = 4.0;
/// Warning of a contradiction.
const WARNING: &str = "the measured tracker latency (pairing.tracker_latency_measured_ms) \
    differs from the active one, so virtual objects lag or lead in motion; run `penumbra \
    calibrate latency`, or set [sync] follow_latency = \"apply\"";

/// Publishes the latency of a frame.
pub(super) fn publish(s: &mut Snapshot, prepared: &PreparedFrame) {
    let state = &prepared.counts.latency;
    let Some(measurement) = &state.measurement else {
        return;
    };
    let measured = measurement.offset;
    let now = prepared.frame.captured_at;
    let p = &mut s.pairing;
    p.tracker_latency_ms = Some(active_ms(state));
    p.tracker_latency_measured_ms = measured.map(|m| m.seconds * 1e3);
    p.tracker_latency_sigma_ms = measured.map(|m| m.sigma * 1e3);
    p.tracker_latency_by = measured.map(|m| m.method.name());
    p.tracker_latency_ago_s = measured.map(|m| now.seconds_since(m.estimated_at).max(0.0));
    // The text is formatted only when the refusal changes.
    match measurement.refusal {
        None => p.tracker_latency_note = None,
        Some(refusal) if !is_text_of(p.tracker_latency_note.as_deref(), &refusal) => {
            p.tracker_latency_note = Some(refusal.to_string());
        }
        Some(_) => (),
    }
    let warned = s.warnings.iter().any(|w| w.text == WARNING);
    match (contradicts(state), warned) {
        (true, false) => s.warn(WARNING),
        (false, true) => s.clear_warning(WARNING),
        _ => (),
    }
}

/// Returns the latency for the report; `None` if it was not measured.
pub(super) fn report(state: &LatencyState) -> Option<LatencyReport> {
    let measurement = state.measurement?;
    let measured = measurement.offset;
    Some(LatencyReport {
        used_ms: active_ms(state),
        measured_ms: measured.map(|m| m.seconds * 1e3),
        sigma_ms: measured.map(|m| m.sigma * 1e3),
        by: measured.map(|m| m.method.name()),
        note: measurement.refusal.map(|refusal| refusal.to_string()),
    })
}

fn active_ms(state: &LatencyState) -> f64 {
    state.active_nanos as f64 * 1e-6
}

fn contradicts(state: &LatencyState) -> bool {
    let measured = state.measurement.and_then(|f| f.offset);
    measured.is_some_and(|m| {
        let deviation = (m.seconds * 1e3 - active_ms(state)).abs();
        deviation > MIN_DEVIATION_MS && deviation > MIN_DEVIATION_SIGMAS * m.sigma * 1e3
    })
}

/// Returns whether `text` is equal to the formatted `what`, without allocating.
fn is_text_of(text: Option<&str>, what: &impl std::fmt::Display) -> bool {
    use std::fmt::Write;
    /// The part of the text that has not been matched yet.
    struct Rest<'a>(&'a str);
    impl Write for Rest<'_> {
        fn write_str(&mut self, part: &str) -> std::fmt::Result {
            self.0 = self.0.strip_prefix(part).ok_or(std::fmt::Error)?;
            Ok(())
        }
    }
    let mut rest = Rest(text.unwrap_or_default());
    text.is_some() && write!(rest, "{what}").is_ok() && rest.0.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_calibration::latency::offset_monitor::{FilteredOffset, OffsetState};
    use penumbra_calibration::latency::{LatencyError, OffsetMethod};
    use penumbra_interface::MonotonicTime;

    fn state(active_ms: i64, measured_ms: f64, sigma_ms: f64) -> LatencyState {
        LatencyState {
            active_nanos: active_ms * 1_000_000,
            measurement: Some(OffsetState {
                offset: Some(FilteredOffset {
                    seconds: measured_ms * 1e-3,
                    sigma: sigma_ms * 1e-3,
                    method: OffsetMethod::Poses,
                    estimated_at: MonotonicTime::default(),
                }),
                refusal: Some(LatencyError::AtRest),
            }),
        }
    }

    #[test]
    fn only_large_and_significant_deviations_contradict() {
        assert!(contradicts(&state(20, 35.0, 0.6)));
        assert!(contradicts(&state(35, 20.0, 0.6)));
        assert!(!contradicts(&state(20, 23.5, 0.1)));
        assert!(!contradicts(&state(20, 35.0, 6.0)));
        assert!(!contradicts(&LatencyState::default()));
    }

    #[test]
    fn report_contains_the_measured_latency() {
        let report = report(&state(20, 35.0, 0.6)).unwrap();
        assert_eq!(report.used_ms, 20.0);
        assert!((report.measured_ms.unwrap() - 35.0).abs() < 1e-9);
        assert!(report.note.unwrap().contains("at rest"));
        assert_eq!(super::report(&LatencyState::default()), None);
    }

    #[test]
    fn compares_text_with_its_formatted_value() {
        assert!(is_text_of(Some("a 1.5 b"), &format_args!("a {:.1} b", 1.5)));
        assert!(!is_text_of(Some("a 1.5 b"), &format_args!("a {:.1}", 1.5)));
        assert!(!is_text_of(Some("a"), &format_args!("a {:.1}", 1.5)));
        assert!(!is_text_of(None, &""));
    }
}
