//! Networks that users bring.

use super::input;
use crate::common::{refused, satgs, text};
use satgs::io::NpyArray;
use std::path::{Path, PathBuf};

pub const FOLDERS: &[&str] = &["onnx-opset-and-scales"];

/// `satgs prior` of the scene with a network, and the folder that it writes to.
fn prior(input: &Path, network: &str) -> (Vec<String>, tempfile::TempDir) {
    let out = tempfile::tempdir().unwrap();
    let path = |path: PathBuf| path.to_str().unwrap().to_owned();
    let scene = path(input.join("scene"));
    let (folder, network) = (path(out.path().join("priors")), path(input.join(network)));
    (["prior", &scene, "-o", &folder, "--model", &network, "-q"].map(str::to_owned).into(), out)
}

#[test]
fn networks_give_what_onnxruntime_gives() {
    let Some(input) = input("onnx-opset-and-scales") else { return };
    // Smallest and largest value of the first map; those of `input.onnx` are the picture's, plus 5.
    for (network, expected) in [
        ("softmax-opset-11.onnx", Some([5.0002, 5.0007])),
        ("resize-scales.onnx", Some([5.048, 6.387])),
        ("input.onnx", None),
        ("conv-without-strides.onnx", None),
        ("initialisers-are-inputs.onnx", None),
    ] {
        let (args, out) = prior(&input, network);
        let output = satgs(&args.iter().map(String::as_str).collect::<Vec<_>>());
        assert!(output.status.success(), "{network}: {}", text(&output));
        let map = NpyArray::read(&out.path().join("priors/0001.npy")).unwrap();
        let range = [f32::min, f32::max].map(|f| map.values.iter().copied().reduce(f).unwrap());
        println!("{network}: {range:?}");
        for (found, expected) in range.iter().zip(expected.unwrap_or(range)) {
            assert!((found - expected).abs() < 1e-3, "{network}: {range:?}");
        }
    }
}

#[test]
fn networks_whose_tensors_do_not_fit_each_other_are_refused() {
    let Some(input) = input("onnx-opset-and-scales") else { return };
    let (args, _out) = prior(&input, "nhwc-open.onnx");
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    let error = refused(&args, 2, &["nhwc-open.onnx", "do not fit each other", "[1, 3, rows, columns]"]);
    assert!(!error.contains("panicked"), "{error}");
}
