//! Foreign bytes in a file of another program's dataset.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play_on!(foreign, data));
