#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| penumbra_fuzz::files::config(data));
