#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| skyroost_tests::fuzz::given("manifest", bytes));
