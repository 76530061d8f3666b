//! Foreign bytes in a file of a Lance table, for the reader of every build.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play_on!(tables, data));
