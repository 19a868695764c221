//! The line protocol of home-made trackers.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| penumbra_fuzz::check(&["csv"], data));
