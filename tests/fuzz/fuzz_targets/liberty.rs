//! Liberty and Patriot records.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| penumbra_fuzz::check(&["liberty", "liberty-euler"], data));
