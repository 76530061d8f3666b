//! Foreign bytes in a file of the format `mcap`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play("mcap", data));
