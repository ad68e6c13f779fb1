#![no_main]

use semcal::point_cloud::lzf::decompress;

libfuzzer_sys::fuzz_target!(|input: (u32, &[u8])| {
    let (size, stream) = input;
    let unpacked = decompress(stream, size as usize);
    assert!(unpacked.is_err() || unpacked.is_ok_and(|bytes| bytes.len() == size as usize));
});
