#![no_main]

use semcal::point_cloud::{Format, decode};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let _ = decode(Format::Pcd, bytes);
});
