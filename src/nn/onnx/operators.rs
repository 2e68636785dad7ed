//! Operators that rten computes otherwise than a version of ONNX's operators defines them, and what stands for them.
//!
//! The definitions: <https://onnx.ai/onnx/operators/>. `scripts/check-onnx-operators` compares all with onnxruntime.

use super::graph::Fault;
use super::node::{Constants, Node};
use super::resize;
use super::writer::{GraphWriter, int, ints};

/// Codes of element types.
const BOOL: i64 = 9;
const INT32: i64 = 6;

/// The nodes and constants that stand for a node, as fields of a graph; none if rten computes it as it is.
pub fn replacement(node: &Node, version: i64, constants: &Constants) -> Result<Option<Vec<u8>>, Fault> {
    let mut graph = GraphWriter::within(format!("{}/", node.outputs.first().unwrap_or(&"")));
    let done = match node.op_type {
        "Softmax" | "LogSoftmax" if version < 13 => softmax(node, &mut graph)?,
        "Resize" | "Upsample" => resize::write(node, version, constants, &mut graph)?,
        "Conv" | "ConvTranspose" | "ConvInteger" => convolution(node, constants, &mut graph)?,
        "MaxPool" | "AveragePool" => pooling(node, &mut graph)?,
        "Cast" => cast(node, &mut graph)?,
        "Slice" if version < 10 => slice(node, &mut graph)?,
        "Pad" if version < 11 => pad(node, &mut graph)?,
        "TopK" if version < 10 => top_k(node, &mut graph)?,
        _ => false,
    };
    Ok(done.then(|| graph.into_fields()))
}

/// Before version 13 the values along `axis` and all later axes share one sum, and `axis` is 1 if it is not given.
fn softmax(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let Some(input) = node.input(0) else { return Ok(false) };
    let axis = node.int("axis")?.unwrap_or(1);
    let shape = graph.node("Shape", &[input], &[]);
    let flat = graph.node("Flatten", &[input], &[int("axis", axis)]);
    let shares = graph.node(node.op_type, &[&flat], &[int("axis", -1)]);
    graph.named_node("Reshape", &[&shares, &shape], &node.outputs, &[]);
    Ok(true)
}

/// Strides, dilations and padding have defaults, of which rten knows the number of sides from `kernel_shape` only; it pads
/// `SAME_LOWER` as `SAME_UPPER`.
fn convolution(node: &Node, constants: &Constants, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let kernel = match (node.ints("kernel_shape")?, node.input(1).and_then(|name| constants.get(name))) {
        (Some(kernel), _) => kernel,
        (None, Some(weights)) => weights.dims.iter().skip(2).copied().collect(),
        (None, None) => return Err(node.fault("it has no `kernel_shape`, and its weights are no constant")),
    };
    if node.op_type == "ConvTranspose" && node.has("output_shape")? {
        return Err(node.fault("`output_shape` is not supported; expected `pads` and `output_padding`"));
    }
    let ones = vec![1; kernel.len()];
    let strides = node.ints("strides")?.unwrap_or_else(|| ones.clone());
    let dilations = node.ints("dilations")?.unwrap_or(ones);
    let Some(pads) = padding(node, &kernel, &strides, &dilations)? else { return Ok(false) };
    let mut attributes =
        node.attributes_without(&["kernel_shape", "strides", "dilations", "pads", "auto_pad"])?;
    attributes.extend([
        ints("kernel_shape", &kernel),
        ints("strides", &strides),
        ints("dilations", &dilations),
        ints("pads", &pads),
    ]);
    graph.named_node(node.op_type, &node.inputs, &node.outputs, &attributes);
    Ok(true)
}

/// As for convolutions; rten takes a stride of nothing for one of `kernel_shape`.
fn pooling(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let Some(kernel) = node.ints("kernel_shape")? else {
        return Err(node.fault("it has no `kernel_shape`"));
    };
    let ones = vec![1; kernel.len()];
    let strides = node.ints("strides")?.unwrap_or_else(|| ones.clone());
    let dilations = node.ints("dilations")?.unwrap_or(ones);
    let Some(pads) = padding(node, &kernel, &strides, &dilations)? else { return Ok(false) };
    let mut attributes = node.attributes_without(&["strides", "pads", "auto_pad"])?;
    attributes.extend([ints("strides", &strides), ints("pads", &pads)]);
    graph.named_node(node.op_type, &node.inputs, &node.outputs, &attributes);
    Ok(true)
}

/// The padding before and after each side; none if it depends on the size of the input and rten computes it rightly.
fn padding(
    node: &Node,
    kernel: &[i64],
    strides: &[i64],
    dilations: &[i64],
) -> Result<Option<Vec<i64>>, Fault> {
    let automatic = node.text("auto_pad")?.unwrap_or("NOTSET");
    if kernel.len() != strides.len() || kernel.len() != dilations.len() {
        return Err(node.fault(format!(
            "its kernel has {} sides, its strides {}, its dilations {}",
            kernel.len(),
            strides.len(),
            dilations.len()
        )));
    }
    match automatic {
        "SAME_UPPER" | "SAME_LOWER" if strides.iter().all(|s| *s == 1) => {
            let total = kernel.iter().zip(dilations).map(|(k, d)| (k - 1).saturating_mul(*d));
            let halves: Vec<[i64; 2]> = total.map(|n| [n / 2, n - n / 2]).collect();
            let [before, after] = if automatic == "SAME_UPPER" { [0, 1] } else { [1, 0] };
            Ok(Some([before, after].iter().flat_map(|k| halves.iter().map(move |n| n[*k])).collect()))
        }
        "SAME_UPPER" => Ok(None),
        "SAME_LOWER" => Err(node.fault("`auto_pad` is SAME_LOWER with strides; expected `pads`")),
        "VALID" => Ok(Some(vec![0; 2 * kernel.len()])),
        "NOTSET" => Ok(Some(node.ints("pads")?.unwrap_or_else(|| vec![0; 2 * kernel.len()]))),
        other => Err(node.fault(format!("`auto_pad` is `{other}`"))),
    }
}

/// rten has whole numbers for truth values, and converts 2.5 to 2 and 0.5 to 0; both are true.
fn cast(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let (Some(input), Some(BOOL)) = (node.input(0), node.int("to")?) else { return Ok(false) };
    let sign = graph.node("Sign", &[input], &[]);
    let size = graph.node("Abs", &[&sign], &[]);
    graph.named_node("Cast", &[&size], &node.outputs, &[int("to", INT32)]);
    Ok(true)
}

/// Before version 10 the limits are attributes.
fn slice(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let (Some(input), Some(starts), Some(ends)) = (node.input(0), node.ints("starts")?, node.ints("ends")?)
    else {
        return Ok(false);
    };
    let axes = node.ints("axes")?.unwrap_or_else(|| (0..starts.len() as i64).collect());
    let [starts, ends, axes] = [starts, ends, axes].map(|values| graph.integers(&values));
    graph.named_node("Slice", &[input, &starts, &ends, &axes], &node.outputs, &[]);
    Ok(true)
}

/// Before version 11 the widths and the value are attributes.
fn pad(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let (Some(input), Some(pads)) = (node.input(0), node.ints("pads")?) else { return Ok(false) };
    let pads = graph.integers(&pads);
    let value = graph.floats(&[], &[node.float("value")?.unwrap_or(0.0)]);
    let mode = node.attributes_without(&["pads", "value"])?;
    graph.named_node("Pad", &[input, &pads, &value], &node.outputs, &mode);
    Ok(true)
}

/// Before version 10 the number is an attribute.
fn top_k(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let (Some(input), Some(k)) = (node.input(0), node.int("k")?) else { return Ok(false) };
    let k = graph.integers(&[k]);
    graph.named_node("TopK", &[input, &k], &node.outputs, &node.attributes_without(&["k"])?);
    Ok(true)
}
