//! All formats of a Flock of Birds' records.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| penumbra_fuzz::check(
    &["flock", "flock-angles", "flock-group", "flock-angles-group"],
    data
));
