//! Foreign bytes in a file of a training run.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play_on!(runs, data));
