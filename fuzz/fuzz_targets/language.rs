#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    support::harness::language::run(data);
});
