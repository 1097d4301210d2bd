#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| simpliguard_fuzz::import(bytes));
