//! Tests of networks from files: the fixture of `scripts/make-tiny-features`, and graphs that are written here.

use super::{DenseFeatures, FeatureError, FeatureMap, OnnxFeatures};
use crate::io::Grid2;
use crate::nn::onnx::OnnxError;
use crate::nn::onnx::made_graph::{Graph, text};
use crate::nn::onnx::writer::{block, float_tensor, int, int64_tensor, ints, node};
use crate::random::CounterRng;
use std::path::{Path, PathBuf};

fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/tiny_features.onnx")
}

fn picture(width: usize, height: usize) -> [Grid2; 3] {
    [0, 1, 2].map(|c| {
        let mut draw = CounterRng::new(1, c, 0, 0);
        Grid2::from_fn(width, height, |_, _| draw.uniform() as f32)
    })
}

fn extract(side_px: usize, rgb: &[Grid2; 3]) -> FeatureMap {
    let mut features = OnnxFeatures::load_with_side(&fixture(), side_px).unwrap();
    assert_eq!((features.patch_px(), features.channels()), (14, 8));
    features.extract(rgb).unwrap()
}

#[test]
fn tiles_give_the_features_of_the_picture_in_one_piece() {
    // 10 x 9 patches, the last ones cut; tiles of 5 x 5 patches, and one of 10 x 10.
    let rgb = picture(135, 120);
    let (tiled, whole) = (extract(70, &rgb), extract(140, &rgb));
    assert_eq!((whole.width, whole.height, whole.data.len()), (10, 9, 720));
    let (mut worst, mut largest) = (0f32, 0f32);
    for (a, b) in tiled.data.iter().zip(&whole.data) {
        (worst, largest) = (worst.max((a - b).abs()), largest.max(a.abs()));
    }
    assert!(worst < 1e-5 && largest > 0.5, "{worst} {largest}");
}

#[test]
fn features_of_a_file_are_the_same_for_any_number_of_threads() {
    let of = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| extract(70, &picture(150, 99)))
    };
    assert_eq!(of(1), of(3));
}

#[test]
fn planes_and_tokens_after_a_class_token_hold_the_same_patches() {
    // A picture of four patches of 2 x 2 pixels, which maximum pooling makes of the red plane.
    let pool =
        node("MaxPool", &["x"], &["planes"], &[ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])]);
    let planes =
        Graph { input: &[1, 3, 4, 4], nodes: vec![pool.clone()], output: "planes", ..Graph::default() };
    let reshape = node("Reshape", &["planes", "shape"], &["rows"], &[]);
    let transpose = node("Transpose", &["rows"], &["patches"], &[ints("perm", &[0, 2, 1])]);
    let class = node("Concat", &["token", "patches"], &["tokens"], &[int("axis", 1)]);
    let tokens = Graph {
        input: &[1, 3, 4, 4],
        nodes: vec![pool, reshape, transpose, class],
        constants: vec![
            int64_tensor("shape", &[1, 3, -1]),
            float_tensor("token", &[1, 1, 3], &[7.0, 8.0, 9.0]),
        ],
        output: "tokens",
    };
    let rgb = picture(4, 4);
    let maps = [planes, tokens].map(|graph| {
        let (_folder, path) = graph.write();
        let mut features = OnnxFeatures::load(&path).unwrap();
        assert_eq!((features.patch_px(), features.channels()), (2, 3));
        features.extract(&rgb).unwrap()
    });
    assert_eq!(maps[0], maps[1]);
    let red = [rgb[0].at(2, 0), rgb[0].at(3, 0), rgb[0].at(2, 1), rgb[0].at(3, 1)];
    let expected = (red.into_iter().fold(0.0, f32::max) - 0.485) / 0.229;
    assert!((maps[0].at(1, 0)[0] - expected).abs() < 1e-6);
}

#[test]
fn a_cubic_resize_is_refused_also_within_a_branch() {
    let resize = |mode: &str| {
        let attributes = [text("mode", mode), text("coordinate_transformation_mode", "half_pixel")];
        node("Resize", &["x", "", "scales"], &["resized"], &attributes)
    };
    let scales = float_tensor("scales", &[4], &[1.0, 1.0, 0.5, 0.5]);
    let graph = |node| Graph {
        input: &[1, 3, 4, 4],
        nodes: vec![node],
        constants: vec![scales.clone()],
        output: "resized",
    };
    let (_folder, path) = graph(resize("linear")).write();
    assert!(OnnxFeatures::load(&path).is_ok());
    let branch = block(5, &[block(1, b"then_branch"), block(6, &block(1, &resize("cubic")))].concat());
    let inside = node("If", &["condition"], &["resized"], &[branch]);
    for node in [resize("cubic"), inside] {
        let (_folder, path) = graph(node).write();
        let error = OnnxFeatures::load(&path).err().unwrap();
        assert!(
            matches!(&error, FeatureError::Onnx(OnnxError::CubicResize { node, .. }) if node == "resize"),
            "{error}"
        );
    }
}

/// Checks that an output is refused and that the error names the file and what was found.
fn refused(graph: &Graph, found: &str) {
    let (_folder, path) = graph.write();
    let error = OnnxFeatures::load(&path).err().unwrap();
    let text = error.to_string();
    assert!(matches!(error, FeatureError::Output { .. }), "{text}");
    assert!(text.contains("graph.onnx") && text.contains(found), "{text}");
}

#[test]
fn graphs_that_take_or_give_something_else_are_refused() {
    let relu = |input: &'static [i64]| Graph {
        input,
        nodes: vec![node("Relu", &["x"], &["y"], &[])],
        output: "y",
        ..Graph::default()
    };
    for input in
        [&[1, 4, 28, 28][..], &[1, 3, 28], &[2, 3, 28, 28], &[1, 3, 28, 14], &[1, 3, 1 << 40, 1 << 40]]
    {
        let (_folder, path) = relu(input).write();
        let error = OnnxFeatures::load(&path).err().unwrap();
        assert!(matches!(error, FeatureError::Onnx(OnnxError::Input { .. })), "{input:?}: {error}");
    }
    for (op_type, found) in [("Flatten", "rank 2"), ("Shape", "tensor(i32)")] {
        let nodes = vec![node(op_type, &["x"], &["y"], &[])];
        refused(&Graph { input: &[1, 3, 28, 28], nodes, output: "y", ..Graph::default() }, found);
    }
    // Nine patches of 28 / 3 pixels, 16 patches after eight other tokens, three pictures.
    for shape in [[1, 12, 196], [1, 24, 98], [3, 28, 28]] {
        let nodes = vec![node("Reshape", &["x", "shape"], &["y"], &[])];
        let constants = vec![int64_tensor("shape", &shape)];
        let graph = Graph { input: &[1, 3, 28, 28], nodes, constants, output: "y" };
        refused(&graph, &format!("{shape:?}"));
    }
}

#[test]
fn a_damaged_file_is_an_error_wherever_it_is_damaged() {
    let whole = std::fs::read(fixture()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.onnx");
    let refuse = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        OnnxFeatures::load_with_side(&path, 28).err()
    };
    // What follows the graph is the version of the operators, without which the graph is whole.
    let end_of_graph = whole.len() - 6;
    for length in (0..end_of_graph).step_by(7) {
        assert!(
            matches!(refuse(&whole[..length]), Some(FeatureError::Onnx(OnnxError::Damaged { .. }))),
            "{length} bytes"
        );
    }
    for k in (0..whole.len()).step_by(3) {
        let mut bytes = whole.clone();
        bytes[k] ^= 1 << (k % 8);
        // A weight may change unseen, but nothing may panic.
        refuse(&bytes);
    }
    let absent = OnnxFeatures::load(Path::new("absent.onnx")).err().unwrap();
    assert!(
        matches!(absent, FeatureError::Onnx(OnnxError::Read { .. }))
            && absent.to_string().contains("absent.onnx")
    );
}
