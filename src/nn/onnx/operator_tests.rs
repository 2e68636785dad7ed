//! Operators against onnxruntime, whose results `scripts/check-onnx-operators` has written, and estimates of memory.

use super::made_graph::Graph;
use super::writer::{float_tensor, int64_tensor, ints, node};
use super::{OnnxError, OnnxModel, OnnxOutput};
use safetensors::SafeTensors;
use std::path::Path;

/// Largest difference, relative to values of 1 and more.
const TOLERANCE: f32 = 2e-5;

#[test]
fn operators_of_any_version_give_what_onnxruntime_gives() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/onnx_operators.safetensors");
    let bytes = std::fs::read(file).unwrap();
    let tensors = SafeTensors::deserialize(&bytes).unwrap();
    let floats = |name: &str| -> Vec<f32> {
        let data = tensors.tensor(name).unwrap().data().to_vec();
        data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    };
    let input = floats("input");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("operator.onnx");
    let (mut wrong, mut count) = (Vec::new(), 0);
    for name in tensors.names().into_iter().filter_map(|name| name.strip_suffix(".model")) {
        std::fs::write(&path, tensors.tensor(&format!("{name}.model")).unwrap().data()).unwrap();
        let expected_shape = tensors.tensor(&format!("{name}.output")).unwrap().shape().to_vec();
        let expected = floats(&format!("{name}.output"));
        count += 1;
        let found = match OnnxModel::load(&path).and_then(|model| model.evaluate([6, 8], input.clone())) {
            Ok(OnnxOutput::Tensor(tensor)) => tensor,
            Ok(OnnxOutput::Other(found)) => {
                wrong.push(format!("{name}: {found}"));
                continue;
            }
            Err(e) => {
                wrong.push(format!("{name}: {e}"));
                continue;
            }
        };
        let differs = |(a, b): (&f32, &f32)| (a - b).abs() > TOLERANCE * b.abs().max(1.0);
        if found.shape != expected_shape || found.values.iter().zip(&expected).any(differs) {
            wrong.push(format!("{name}: {:?}, expected {expected_shape:?}", found.shape));
        }
    }
    assert!(wrong.is_empty() && count > 40, "{} of {count}: {wrong:#?}", wrong.len());
}

#[test]
fn a_network_of_more_memory_than_the_machine_has_is_refused_before_it_is_evaluated() {
    // 28 x 28 pixels, 20,000 times as large in both directions: 3.8 terabytes.
    let resize = node("Resize", &["x", "", "scales"], &["large"], &[]);
    let small = node("MaxPool", &["large"], &["y"], &[ints("kernel_shape", &[2, 2])]);
    let graph = Graph {
        input: &[1, 3, 28, 28],
        nodes: vec![resize, small],
        constants: vec![float_tensor("scales", &[4], &[1.0, 1.0, 20_000.0, 20_000.0])],
        output: "y",
    };
    let (_folder, path) = graph.write();
    let model = OnnxModel::load(&path).unwrap();
    let error = model.evaluate([28, 28], vec![0.5; 3 * 28 * 28]).err().unwrap();
    assert!(
        matches!(&error, OnnxError::Memory { node, needed_mb, .. } if node == "large" && *needed_mb > 3e6)
    );
    assert!(error.to_string().contains("[1, 3, 560000, 560000]"), "{error}");
}

#[test]
fn operators_of_other_sizes_are_an_error_and_no_panic() {
    let gemm = node("Gemm", &["flat", "matrix"], &["product"], &[]);
    let flat = node("Flatten", &["x"], &["flat"], &[]);
    let scaled = node("BatchNormalization", &["x", "two", "two", "two", "two"], &["y"], &[]);
    let shaped = node("Reshape", &["product", "shape"], &["y"], &[]);
    let [two, matrix] = [float_tensor("two", &[2], &[1.0, 1.0]), float_tensor("matrix", &[5, 4], &[0.5; 20])];
    for (nodes, constants) in [
        (vec![scaled], vec![two]),
        (vec![flat, gemm, shaped], vec![matrix, int64_tensor("shape", &[1, 1, 2, 2])]),
    ] {
        let (_folder, path) = Graph { input: &[1, 3, 2, 2], nodes, constants, output: "y" }.write();
        let made = OnnxModel::load(&path).and_then(|model| model.evaluate([2, 2], vec![0.5; 12]));
        let error = made.err().unwrap();
        assert!(error.to_string().contains("graph.onnx"), "{error}");
    }
}
