//! Foreign bytes in a manifest, a result, a bundle, statistics, or settings of a policy.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play_on!(results, data));
