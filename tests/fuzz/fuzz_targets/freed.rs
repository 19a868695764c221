//! FreeD D1.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|data: &[u8]| penumbra_fuzz::check(&["freed", "freed:-tilt,pan,roll,z,y,x"], data));
