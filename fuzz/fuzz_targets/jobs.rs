//! Foreign bytes in a file of a job.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play_on!(jobs, data));
