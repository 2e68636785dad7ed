//! Any bytes as an RPC file: an answer or an error, never a panic; what is read is written and read back the same.
#![no_main]

use libfuzzer_sys::fuzz_target;
use satgs::rpc::formats::{parse, to_json, to_rpb, to_text};
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let file = Path::new("fuzzed");
    let Ok(read) = parse(file, &String::from_utf8_lossy(bytes)) else { return };
    for text in [to_text(&read.rpc), to_rpb(&read.rpc), to_json(&read.rpc, &read.tags)] {
        assert_eq!(parse(file, &text).map(|f| f.rpc).ok(), Some(read.rpc.clone()));
    }
    let _ = read.rpc.localize(read.rpc.project(read.rpc.center()), read.rpc.center().height_m());
});
