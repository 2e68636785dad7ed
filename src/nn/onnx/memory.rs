//! How much memory the tensors of a graph take at once, before it is evaluated.
//!
//! Shapes are those that rten infers for the graph without its weights and with the size of the picture; what it does not infer
//! (`Resize`, `ConvTranspose`, `Pad`, `Tile`, `DepthToSpace`) follows here from constants. Tensors of unknown shape count nothing, so
//! that the estimate may be too small.

use super::convert::converted;
use super::error::OnnxError;
use super::fault::Fault;
use super::graph::MODEL_GRAPH;
use super::node::{Constants, Node};
use super::runtime::caught;
use super::wire::Slice;
use super::writer::{FLOAT, block, number};
use crate::io::available_memory_mb;
use rten::{Dimension, Model, ModelOptions};
use std::collections::BTreeMap;
use std::path::Path;

/// Numbers of fields.
const GRAPH_NODE: u64 = 1;
const GRAPH_INITIALISER: u64 = 5;
const GRAPH_INPUT: u64 = 11;
const VALUE_NAME: u64 = 1;
const MEGABYTE: f64 = 1e6;
/// Bytes of a value: rten has single precision and integers of 32 bits.
const VALUE_BYTES: u64 = 4;
/// A constant of more values is a weight, whose values decide no shape.
const MOST_SHAPE_VALUES: u64 = 64;
/// Tensors of the output's size that a resize holds at once: two neighbours of each value and their sum.
const RESIZE_TENSORS: u64 = 3;

type Shapes = BTreeMap<String, Vec<usize>>;

/// The memory of the tensors of a graph.
pub(super) struct Estimate {
    /// Bytes of those that are needed at once, weights apart.
    peak_bytes: u64,
    /// The largest of them.
    largest: String,
    shape: Vec<usize>,
}

impl Estimate {
    /// The estimate for an input of a shape.
    ///
    /// # Errors
    /// [`OnnxError::Read`] if the file cannot be read.
    pub fn of(path: &Path, input: &str, shape: &[usize]) -> Result<Self, OnnxError> {
        let bytes = std::fs::read(path).map_err(|cause| OnnxError::Read { path: path.into(), cause })?;
        // The file has been checked; a graph whose shapes cannot be inferred has an estimate of nothing.
        let none = Self { peak_bytes: 0, largest: String::new(), shape: Vec::new() };
        Ok(Self::of_bytes(&bytes, input, shape).unwrap_or(none))
    }

    fn of_bytes(bytes: &[u8], input: &str, shape: &[usize]) -> Result<Self, Fault> {
        let graph = Slice::file(bytes).first(MODEL_GRAPH)?.unwrap_or(Slice::file(&[]));
        let nodes: Vec<Node> =
            graph.all(GRAPH_NODE)?.into_iter().map(Node::read).collect::<Result<_, _>>()?;
        let mut constants = Constants::default();
        let mut given = Shapes::from([(input.to_owned(), shape.to_vec())]);
        for tensor in graph.all(GRAPH_INITIALISER)? {
            let name = constants.add_initialiser(tensor)?;
            let dims = constants.get(name).map(|constant| constant.shape()).unwrap_or_default();
            if product(&dims) > MOST_SHAPE_VALUES {
                given.insert(name.to_owned(), dims);
            }
        }
        nodes.iter().try_for_each(|node| constants.add_node(node))?;
        let runnable = converted(bytes)?;
        let runnable = runnable.as_deref().unwrap_or(bytes);
        // Every round finds the shapes up to those that rten does not infer, and computes some of these.
        let shapes = loop {
            let mut shapes = inferred(runnable, &nodes, &given)?;
            let found = shapes.len();
            for node in &nodes {
                let Some(name) = node.outputs.first().filter(|name| !shapes.contains_key(**name)) else {
                    continue;
                };
                let of_input = node.input(0).and_then(|input| shapes.get(input)).cloned();
                if let Some(shape) = of_input.map_or(Ok(None), |input| computed(node, &input, &constants))? {
                    given.insert((*name).to_owned(), shape.clone());
                    shapes.insert((*name).to_owned(), shape);
                }
            }
            if shapes.len() == found {
                break shapes;
            }
        };
        Ok(Self::of_shapes(&nodes, &shapes))
    }

    /// Tensors live from the node that makes them to the last one that reads them.
    fn of_shapes(nodes: &[Node], shapes: &Shapes) -> Self {
        let bytes = |name: &str| shapes.get(name).map_or(0, |s| product(s).saturating_mul(VALUE_BYTES));
        let mut last_use = BTreeMap::new();
        for (k, node) in nodes.iter().enumerate() {
            node.inputs.iter().chain(&node.outputs).for_each(|name| {
                last_use.insert(*name, k);
            });
        }
        let (mut alive, mut peak_bytes) = (0u64, 0);
        let mut largest = ("", 0);
        for (k, node) in nodes.iter().enumerate() {
            let tensors = if matches!(node.op_type, "Resize" | "Upsample") { RESIZE_TENSORS } else { 1 };
            let made = node.outputs.iter().map(|name| bytes(name)).fold(0, u64::saturating_add);
            peak_bytes = peak_bytes.max(alive.saturating_add(made.saturating_mul(tensors)));
            alive = alive.saturating_add(made);
            for name in &node.outputs {
                if bytes(name) > largest.1 {
                    largest = (name, bytes(name));
                }
            }
            let mut over: Vec<&str> = node
                .inputs
                .iter()
                .chain(&node.outputs)
                .copied()
                .filter(|n| last_use.get(n) == Some(&k))
                .collect();
            over.sort_unstable();
            over.dedup();
            alive = alive.saturating_sub(over.into_iter().map(bytes).fold(0, u64::saturating_add));
        }
        let shape = shapes.get(largest.0).cloned().unwrap_or_default();
        Self { peak_bytes, largest: largest.0.to_owned(), shape }
    }

    /// Checks that the memory is available.
    ///
    /// # Errors
    /// [`OnnxError::Memory`].
    pub fn check(self, path: &Path, [rows, columns]: [usize; 2]) -> Result<(), OnnxError> {
        let needed_mb = self.peak_bytes as f64 / MEGABYTE;
        let Some(available_mb) = available_memory_mb().filter(|available| *available < needed_mb) else {
            return Ok(());
        };
        let (path, node, shape) = (path.into(), self.largest, self.shape);
        Err(OnnxError::Memory { path, columns, rows, needed_mb, available_mb, node, shape })
    }
}

fn product(shape: &[usize]) -> u64 {
    shape.iter().fold(1, |n: u64, side| n.saturating_mul(*side as u64))
}

/// The shapes of the outputs of nodes that rten infers if some values are given.
fn inferred(bytes: &[u8], nodes: &[Node], given: &Shapes) -> Result<Shapes, Fault> {
    let mut shapes = given.clone();
    let mut options = ModelOptions::with_all_ops();
    let graph = with_given(bytes, given)?;
    let Ok(model) = caught(|| options.enable_shape_inference(true).load(graph)) else { return Ok(shapes) };
    for name in nodes.iter().flat_map(|node| &node.outputs) {
        if let Some(shape) = fixed_shape(&model, name) {
            shapes.entry((*name).to_owned()).or_insert(shape);
        }
    }
    Ok(shapes)
}

fn fixed_shape(model: &Model, name: &str) -> Option<Vec<usize>> {
    let shape = model.node_info(model.find_node(name)?)?.shape()?;
    let sides = shape.iter().map(|side| match side {
        Dimension::Fixed(size) => Some(*size),
        Dimension::Symbolic(_) => None,
    });
    sides.collect()
}

/// The model with values of these shapes as inputs, in place of the nodes, constants and inputs that have been there.
fn with_given(bytes: &[u8], given: &Shapes) -> Result<Vec<u8>, Fault> {
    let mut out = Vec::new();
    for field in Slice::file(bytes).fields() {
        let field = field?;
        let (MODEL_GRAPH, Some(graph)) = (field.number, field.content()) else {
            out.extend_from_slice(field.bytes);
            continue;
        };
        let mut kept: Vec<u8> =
            given.iter().flat_map(|(name, shape)| block(GRAPH_INPUT, &port(name, shape))).collect();
        for field in graph.fields() {
            let field = field?;
            let name = match (field.number, field.content()) {
                (GRAPH_NODE, Some(node)) => Node::read(node)?.outputs.first().copied(),
                (GRAPH_INITIALISER, Some(tensor)) => Some(Constants::default().add_initialiser(tensor)?),
                (GRAPH_INPUT, Some(input)) => input.text(VALUE_NAME)?,
                _ => None,
            };
            if !name.is_some_and(|name| given.contains_key(name)) {
                kept.extend_from_slice(field.bytes);
            }
        }
        out.extend(block(MODEL_GRAPH, &kept));
    }
    Ok(out)
}

/// An input of single precision.
fn port(name: &str, shape: &[usize]) -> Vec<u8> {
    let sides: Vec<u8> = shape.iter().flat_map(|n| block(1, &number(1, *n as i64))).collect();
    let tensor = [number(1, FLOAT), block(2, &sides)].concat();
    [block(VALUE_NAME, name.as_bytes()), block(2, &block(1, &tensor))].concat()
}

/// The shape of the output of a node whose shapes rten does not infer, if its other inputs are constants.
fn computed(node: &Node, input: &[usize], constants: &Constants) -> Result<Option<Vec<usize>>, Fault> {
    let floats = |k: usize| {
        let values = node.input(k).and_then(|name| constants.get(name)).map(|c| c.floats());
        values.transpose().map(|values| values.filter(|v| v.len() == input.len()))
    };
    let integers = |k: usize| {
        let values = node.input(k).and_then(|name| constants.get(name)).map(|c| c.integers());
        values.transpose()
    };
    let whole = |sides: Vec<i64>| sides.into_iter().map(|side| usize::try_from(side).ok()).collect();
    let scaled = |scales: Vec<f32>| {
        input.iter().zip(scales).map(|(n, scale)| (*n as f32 * scale).floor() as usize).collect()
    };
    let signed = || input.iter().map(|n| *n as i64);
    Ok(match node.op_type {
        "Resize" => match (floats(2)?, integers(3)?.filter(|sizes| sizes.len() == input.len())) {
            (Some(scales), _) => Some(scaled(scales)),
            (None, Some(sizes)) => whole(sizes),
            (None, None) => floats(1)?.map(scaled),
        },
        "Upsample" => floats(1)?.or(node.floats("scales")?).map(scaled),
        "Pad" => {
            let pads = integers(1)?.or(node.ints("pads")?).filter(|pads| pads.len() == 2 * input.len());
            pads.and_then(|pads| {
                let (before, after) = pads.split_at(input.len());
                whole(
                    signed()
                        .zip(before)
                        .zip(after)
                        .map(|((n, b), a)| n.saturating_add(*b).saturating_add(*a))
                        .collect(),
                )
            })
        }
        "Tile" => integers(1)?
            .filter(|times| times.len() == input.len())
            .and_then(|times| whole(signed().zip(times).map(|(n, times)| n.saturating_mul(times)).collect())),
        "DepthToSpace" => match (input, node.int("blocksize")?.and_then(|n| usize::try_from(n).ok())) {
            (&[n, channels, rows, columns], Some(side)) if side > 0 => Some(vec![
                n,
                channels / (side * side).max(1),
                rows.saturating_mul(side),
                columns.saturating_mul(side),
            ]),
            _ => None,
        },
        "ConvTranspose" => {
            let weights = node.input(1).and_then(|name| constants.get(name)).map(|c| c.shape());
            let (Some(weights), true) = (weights, input.len() > 2) else { return Ok(None) };
            let groups = usize::try_from(node.int("group")?.unwrap_or(1)).unwrap_or(1);
            let (strides, pads) =
                (node.ints("strides")?.unwrap_or_default(), node.ints("pads")?.unwrap_or_default());
            let count = input.len() - 2;
            let side = |k: usize| -> i64 {
                let at = |values: &[i64], k: usize, default| values.get(k).copied().unwrap_or(default);
                let kernel = weights.get(k + 2).map_or(1, |n| *n as i64);
                let stretched = (input[k + 2] as i64 - 1).saturating_mul(at(&strides, k, 1));
                stretched.saturating_add(kernel) - at(&pads, k, 0) - at(&pads, k + count, 0)
            };
            let channels = weights.get(1).map_or(0, |n| n.saturating_mul(groups));
            let sides: Option<Vec<usize>> = whole((0..count).map(side).collect());
            sides.map(|sides| [vec![input[0], channels], sides].concat())
        }
        _ => None,
    })
}
