//! Reads any file as a session: it gives an error or events, without panic, hang or memory use
//! out of proportion to the file.
#![no_main]

use libfuzzer_sys::fuzz_target;
use penumbra_session::Session;
use std::io::Write;

fuzz_target!(|data: &[u8]| {
    let Ok(mut file) = tempfile::NamedTempFile::new() else {
        return;
    };
    if file.write_all(data).is_err() {
        return;
    }
    if let Ok(session) = Session::open(file.path()) {
        let events = session.events().take(10_000);
        for event in events {
            let _ = event.map(|event| event.arrived_at());
        }
        let _ = session.tracker_protocol();
    }
});
