//! All formats of a FASTRAK's records.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| penumbra_fuzz::check(
    &[
        "fastrak",
        "fastrak-ascii-quaternion",
        "fastrak-ascii-extended-euler",
        "fastrak-ascii-extended-quaternion",
        "fastrak-binary-euler",
        "fastrak-binary-quaternion",
    ],
    data
));
