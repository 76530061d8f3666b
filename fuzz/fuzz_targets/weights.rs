//! Foreign bytes in a file of a published checkpoint: weights, configs, notes.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::weights::play(data));
