//! Recorded sessions.

use penumbra_session::{Session, describe};
use std::io::Write;
use tempfile::NamedTempFile;

/// Reads any file as a session, with memory in proportion to the file.
pub fn session(data: &[u8]) {
    let Ok(mut file) = NamedTempFile::new() else {
        return;
    };
    if file.write_all(data).is_err() {
        return;
    }
    match Session::open(file.path()) {
        Ok(session) => {
            for event in session.events().take(10_000) {
                let _ = event.map(|event| event.arrived_at());
            }
            let _ = (session.tracker_protocol(), describe(&session));
        }
        Err(error) => assert_one_line(&error.to_string()),
    }
}

fn assert_one_line(message: &str) {
    assert!(!message.contains('\n'), "{message}");
}
