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
use super::encoder::{GROUP, MEMBER_INPUTS};
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
    let width = network.width;
    let mut g = GraphWriter::default();

    // Encoder. Maxima are added to all points of a group by their own part of the weights.
    let (of_points, of_groups) =
        values[parts.of_encoder.clone()].split_at(parts.encoder.points().parameters());
    let points = Layers::of(&parts.encoder.points(), of_points);
    let groups = Layers::of(&parts.encoder.groups(), of_groups);
    let hidden = points.apply(&mut g, 0, "members", None);
    let hidden = g.node("Relu", &[&hidden], &[]);
    let codes = points.apply(&mut g, 1, &hidden, None);
    let largest = g.node("ReduceMax", &[&codes], &[ints("axes", &[1]), int("keepdims", 1)]);
    let hidden = groups.apply(&mut g, 0, &codes, Some((&largest, width)));
    let hidden = g.node("Relu", &[&hidden], &[]);
    let features = groups.apply(&mut g, 1, &hidden, None);
    let features = g.node("ReduceMax", &[&features], &[ints("axes", &[1]), int("keepdims", 0)]);

    // Key points: codes of the logits, and values.
    let keys = Layers::of(&parts.keys, &values[parts.of_keys.clone()]);
    let rows = keys.apply(&mut g, 0, &features, Some(("keys", width)));
    let gathered = g.node("Gather", &[&rows, "neighbours"], &[int("axis", 0)]);

    // Attention. Matrices of ones pick out columns.
    let stride = CODES + width;
    let coefficient = |g: &mut GraphWriter, k: usize| {
        let mut pick = vec![0.0; stride * HEADS];
        (0..HEADS).for_each(|h| pick[(4 * h + k) * HEADS + h] = 1.0);
        let pick = g.floats(&[stride, HEADS], &pick);
        g.node("MatMul", &[&gathered, &pick], &[])
    };
    let mut logits = coefficient(&mut g, 0);
    for k in 0..3 {
        let pick: Vec<f32> = (0..3).map(|j| f32::from(u8::from(j == k))).collect();
        let pick = g.floats(&[3, 1], &pick);
        let place = g.node("MatMul", &["relative", &pick], &[]);
        let slope = coefficient(&mut g, k + 1);
        let product = g.node("Mul", &[&slope, &place], &[]);
        logits = g.node("Add", &[&logits, &product], &[]);
    }
    let squares = g.node("Mul", &["relative", "relative"], &[]);
    let decays =
        values[parts.of_decays.clone()].iter().map(|v| -(1.0 + (v + DECAY_AT_START as f32).exp()).ln());
    let decays: Vec<f32> = (0..3).flat_map(|_| decays.clone()).collect();
    let decays = g.floats(&[3, HEADS], &decays);
    let decays = g.node("MatMul", &[&squares, &decays], &[]);
    let logits = g.node("Add", &[&logits, &decays], &[]);
    let weights = g.node("Softmax", &[&logits], &[int("axis", 1)]);
    let mut spread = vec![0.0; HEADS * width];
    (0..width).for_each(|k| spread[k / (width / HEADS) * width + k] = 1.0);
    let spread = g.floats(&[HEADS, width], &spread);
    let weights = g.node("MatMul", &[&weights, &spread], &[]);
    let mut pick = vec![0.0; stride * width];
    (0..width).for_each(|k| pick[(CODES + k) * width + k] = 1.0);
    let pick = g.floats(&[stride, width], &pick);
    let attended = g.node("MatMul", &[&gathered, &pick], &[]);
    let weighted = g.node("Mul", &[&weights, &attended], &[]);
    let axes = g.integers(&[1]);
    let features = g.node("ReduceSum", &[&weighted, &axes], &[int("keepdims", 0)]);

    // Head.
    let head = Layers::of(&parts.head, &values[parts.of_head.clone()]);
    let mut hidden = head.apply(&mut g, 0, &features, Some(("queries", width)));
    for layer in 1..head.count() {
        let active = g.node("Relu", &[&hidden], &[]);
        hidden = head.apply(&mut g, layer, &active, None);
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
    g.finish("points to splats", &inputs, &hidden, output, metadata)
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
