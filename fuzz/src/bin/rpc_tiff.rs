//! Any bytes as a TIFF with an RPC tag: an answer or an error, never a panic.
#![no_main]

use libfuzzer_sys::fuzz_target;
use satgs::rpc::formats::parse_tiff;
use std::io::Cursor;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let _ = parse_tiff(Path::new("fuzzed"), Cursor::new(bytes));
});
