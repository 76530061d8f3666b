//! Foreign bytes in a file of the format `hdf5`.

#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| swm_fuzz::play("hdf5", data));
