//! The network as an ONNX file, for other programs, and as the example of what such a file takes and gives.
//!
//! | name | shape | what |
//! |---|---|---|
//! | `members` | `[keys, 16, 6]` | numbers of the points of each group |
//! | `keys` | `[keys, 5 + image features]` | numbers of the key points |
//! | `neighbours` | `[queries, 8]`, int64 | indices of the key points that a query attends to |
//! | `relative` | `[queries, 8, 3]` | place of the query relative to each, in spacings of the key points |
//! | `queries` | `[queries, 16]` | numbers of the queries |
//! | `splats` (output) | `[queries, 14]` | numbers that the [head](crate::predict::head) makes splats of |

use super::attention::{CODES, DECAY_AT_START, HEADS};
use super::encoder::{Encoder, GROUP, MEMBER_INPUTS};
use super::input::{NEIGHBOURS, NetworkInput};
use super::{KEY_INPUTS, OUTPUTS, QUERY_INPUTS, SplatNetwork};
use crate::nn::mlp::Mlp;
use crate::nn::onnx::NamedInput;
use crate::nn::onnx::writer::{Element, GraphWriter, Port, Side, int, ints};

/// Names of the inputs, in the order of [`inputs`].
pub(crate) const INPUT_NAMES: [&str; 5] = ["members", "keys", "neighbours", "relative", "queries"];
const KEYS: Side = Side::Open("keys");
const QUERIES: Side = Side::Open("queries");

/// The values of the inputs.
pub(crate) fn inputs(input: &NetworkInput<f32>) -> Vec<NamedInput> {
    let rows = |blocks: &super::FeatureBlocks<f32>| -> Vec<f32> {
        (0..blocks.items()).flat_map(|i| (0..blocks.features()).map(move |k| blocks.at(k, i))).collect()
    };
    let (keys, queries) = (input.keys.items(), input.queries.items());
    vec![
        NamedInput::Float(vec![keys, GROUP, MEMBER_INPUTS], rows(&input.members)),
        NamedInput::Float(vec![keys, input.keys.features()], rows(&input.keys)),
        NamedInput::Whole(
            vec![queries, NEIGHBOURS],
            input.neighbours.iter().flatten().map(|k| *k as i32).collect(),
        ),
        NamedInput::Float(
            vec![queries, NEIGHBOURS, 3],
            input.relative.iter().flatten().flatten().copied().collect(),
        ),
        NamedInput::Float(vec![queries, QUERY_INPUTS], rows(&input.queries)),
    ]
}

/// The bytes of the ONNX file of a network with these parameters.
pub(crate) fn onnx(network: &SplatNetwork, values: &[f32], metadata: &[(&str, &str)]) -> Vec<u8> {
    let parts = network.parts();
    let mut g = GraphWriter::default();
    let groups = encoded_groups(&mut g, &parts.encoder, &values[parts.of_encoder.clone()]);
    let keys = Layers::of(&parts.keys, &values[parts.of_keys.clone()]);
    let rows = keys.apply(&mut g, 0, &groups, Some(("keys", network.width)));
    let attended = attended(&mut g, network.width, &rows, &values[parts.of_decays.clone()]);
    let head = Layers::of(&parts.head, &values[parts.of_head.clone()]);
    let mut outputs = head.apply(&mut g, 0, &attended, Some(("queries", network.width)));
    for layer in 1..head.count() {
        let active = g.node("Relu", &[&outputs], &[]);
        outputs = head.apply(&mut g, layer, &active, None);
    }
    let known = [KEYS, Side::Fixed(KEY_INPUTS + network.image_features)];
    let inputs: [Port; 5] = [
        ("members", Element::Float, &[KEYS, Side::Fixed(GROUP), Side::Fixed(MEMBER_INPUTS)]),
        ("keys", Element::Float, &known),
        ("neighbours", Element::Int64, &[QUERIES, Side::Fixed(NEIGHBOURS)]),
        ("relative", Element::Float, &[QUERIES, Side::Fixed(NEIGHBOURS), Side::Fixed(3)]),
        ("queries", Element::Float, &[QUERIES, Side::Fixed(QUERY_INPUTS)]),
    ];
    let output: Port = ("splats", Element::Float, &[QUERIES, Side::Fixed(OUTPUTS)]);
    g.finish("points to splats", &inputs, &outputs, output, metadata)
}

/// The features of the groups. The maxima of a group are added to all of its points by their own part of the weights.
fn encoded_groups(g: &mut GraphWriter, encoder: &Encoder, values: &[f32]) -> String {
    let (of_points, of_groups) = values.split_at(encoder.points().parameters());
    let points = Layers::of(&encoder.points(), of_points);
    let groups = Layers::of(&encoder.groups(), of_groups);
    let hidden = points.apply(g, 0, "members", None);
    let hidden = g.node("Relu", &[&hidden], &[]);
    let codes = points.apply(g, 1, &hidden, None);
    let largest = g.node("ReduceMax", &[&codes], &[ints("axes", &[1]), int("keepdims", 1)]);
    let hidden = groups.apply(g, 0, &codes, Some((&largest, encoder.width)));
    let hidden = g.node("Relu", &[&hidden], &[]);
    let features = groups.apply(g, 1, &hidden, None);
    g.node("ReduceMax", &[&features], &[ints("axes", &[1]), int("keepdims", 0)])
}

/// What the queries take from the key points, whose codes and values are the columns of `rows`. Products with matrices of zeros and
/// ones pick out columns.
fn attended(g: &mut GraphWriter, width: usize, rows: &str, decays: &[f32]) -> String {
    let gathered = g.node("Gather", &[rows, "neighbours"], &[int("axis", 0)]);
    let stride = CODES + width;
    let mut logits = picked(g, &gathered, [stride, HEADS], |row, head| row == 4 * head);
    for k in 0..3 {
        let place = picked(g, "relative", [3, 1], |row, _| row == k);
        let slope = picked(g, &gathered, [stride, HEADS], |row, head| row == 4 * head + k + 1);
        let product = g.node("Mul", &[&slope, &place], &[]);
        logits = g.node("Add", &[&logits, &product], &[]);
    }
    let squares = g.node("Mul", &["relative", "relative"], &[]);
    let decays: Vec<f32> = decays.iter().map(|v| -(1.0 + (v + DECAY_AT_START as f32).exp()).ln()).collect();
    let decays = g.floats(&[3, HEADS], &decays.repeat(3));
    let decays = g.node("MatMul", &[&squares, &decays], &[]);
    let logits = g.node("Add", &[&logits, &decays], &[]);
    let weights = g.node("Softmax", &[&logits], &[int("axis", 1)]);
    let weights = picked(g, &weights, [HEADS, width], |head, feature| feature / (width / HEADS) == head);
    let values = picked(g, &gathered, [stride, width], |row, feature| row == CODES + feature);
    let weighted = g.node("Mul", &[&weights, &values], &[]);
    let axes = g.integers(&[1]);
    g.node("ReduceSum", &[&weighted, &axes], &[int("keepdims", 0)])
}

/// The product of a value with a matrix of zeros, and ones where `is_one`.
fn picked(
    g: &mut GraphWriter,
    value: &str,
    shape: [usize; 2],
    is_one: impl Fn(usize, usize) -> bool,
) -> String {
    let [rows, columns] = shape;
    let at = |i: usize| f32::from(u8::from(is_one(i / columns, i % columns)));
    let matrix = g.floats(&shape, &(0..rows * columns).map(at).collect::<Vec<_>>());
    g.node("MatMul", &[value, &matrix], &[])
}

/// The layers of a perceptron.
struct Layers<'a> {
    sizes: Vec<usize>,
    values: &'a [f32],
}

impl<'a> Layers<'a> {
    fn of(mlp: &Mlp, values: &'a [f32]) -> Self {
        let sizes = [&[mlp.inputs][..], &mlp.hidden, &[mlp.outputs]].concat();
        Self { sizes, values }
    }

    fn count(&self) -> usize {
        self.sizes.len() - 1
    }

    /// A layer without its activation. Its last inputs may be another value, which `more` names with the index of the first.
    fn apply(&self, g: &mut GraphWriter, layer: usize, input: &str, more: Option<(&str, usize)>) -> String {
        let first: usize = self.sizes.windows(2).take(layer).map(|s| s[1] * (s[0] + 1)).sum();
        let (inputs, outputs) = (self.sizes[layer], self.sizes[layer + 1]);
        let (weights, rest) = self.values[first..].split_at(inputs * outputs);
        // The columns of some inputs, with a row for each.
        let rows = |from: usize, to: usize| -> Vec<f32> {
            (from..to).flat_map(|k| (0..outputs).map(move |o| weights[o * inputs + k])).collect()
        };
        let own = more.map_or(inputs, |(_, first)| first);
        let matrix = g.floats(&[own, outputs], &rows(0, own));
        let mut sum = g.node("MatMul", &[input, &matrix], &[]);
        if let Some((other, first)) = more {
            let matrix = g.floats(&[inputs - first, outputs], &rows(first, inputs));
            let product = g.node("MatMul", &[other, &matrix], &[]);
            sum = g.node("Add", &[&sum, &product], &[]);
        }
        let biases = g.floats(&[outputs], &rest[..outputs]);
        g.node("Add", &[&sum, &biases], &[])
    }
}
