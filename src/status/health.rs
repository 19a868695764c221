//! The health check.

use super::snapshot::{SessionState, Snapshot};

/// Maximum time without a new picture while a session runs, milliseconds.
const MAX_FRAME_AGE_MS: f64 = 5_000.0;
/// Usual time for starting (opening devices, compiling shaders), seconds.
const MAX_START_SECONDS: f64 = 60.0;

/// Describes a healthy rig in one sentence. It is healthy from its first picture on.
///
/// # Errors
/// The reason why the rig is not healthy.
pub fn health(snapshot: &Snapshot) -> Result<String, String> {
    let description = &snapshot.session.description;
    match (snapshot.session.state, snapshot.frames.last_age_ms) {
        (SessionState::Failed, _) => Err(format!("failed: {description}")),
        (_, None) => Err(starting(snapshot.program.uptime_seconds)),
        (SessionState::Paused | SessionState::Ended, _) => Ok(format!("idle: {description}")),
        (SessionState::Starting | SessionState::Live | SessionState::Replaying, Some(age)) => {
            flowing(snapshot, age)
        }
    }
}

fn starting(uptime_seconds: f64) -> String {
    if uptime_seconds <= MAX_START_SECONDS {
        return "starting: no picture yet".to_owned();
    }
    format!("no picture {uptime_seconds:.0} s after the start")
}

fn flowing(snapshot: &Snapshot, age: f64) -> Result<String, String> {
    if age <= MAX_FRAME_AGE_MS {
        return Ok(format!("{:.1} frames/s", snapshot.frames.per_second));
    }
    Err(format!("no new picture for {:.1} s", age / 1e3))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn snapshot(state: SessionState, uptime_seconds: f64, last_age_ms: Option<f64>) -> Snapshot {
        let mut s = Snapshot::default();
        s.session.enter(state);
        s.program.uptime_seconds = uptime_seconds;
        s.frames.last_age_ms = last_age_ms;
        s
    }

    #[test]
    fn new_frames_are_healthy_and_a_stopped_picture_is_not() {
        for state in [SessionState::Live, SessionState::Replaying] {
            assert!(health(&snapshot(state, 900.0, Some(40.0))).is_ok());
            let stuck = health(&snapshot(state, 900.0, Some(8_250.0)));
            assert_eq!(stuck.unwrap_err(), "no new picture for 8.2 s");
        }
    }

    #[test]
    fn old_picture_is_healthy_while_paused_or_ended() {
        for state in [SessionState::Paused, SessionState::Ended] {
            assert!(health(&snapshot(state, 900.0, Some(1e7))).is_ok());
        }
    }

    #[test]
    fn start_without_pictures_is_not_healthy() {
        for state in [
            SessionState::Starting,
            SessionState::Live,
            SessionState::Paused,
        ] {
            let start = health(&snapshot(state, 20.0, None));
            assert_eq!(start.unwrap_err(), "starting: no picture yet");
            let late = health(&snapshot(state, 61.0, None));
            assert_eq!(late.unwrap_err(), "no picture 61 s after the start");
        }
    }

    #[test]
    fn failure_is_reported_with_its_reason() {
        let mut s = Snapshot::default();
        s.session
            .enter_because(SessionState::Failed, "adapter lost");
        assert_eq!(health(&s).unwrap_err(), "failed: adapter lost");
    }
}
