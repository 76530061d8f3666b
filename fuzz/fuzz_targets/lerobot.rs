//! Foreign bytes in a file of the format `lerobot`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play("lerobot", data));
