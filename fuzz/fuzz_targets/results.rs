#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    support::harness::results::run(data);
});
