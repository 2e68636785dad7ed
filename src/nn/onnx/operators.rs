//! Operators that rten computes otherwise than a version of ONNX's operators defines them, and what stands for them.
//!
//! The definitions: <https://onnx.ai/onnx/operators/>. `scripts/check-onnx-operators` compares all with onnxruntime.

use super::fault::Fault;
use super::node::{Constants, Node};
use super::resize;
use super::writer::{GraphWriter, int, ints};

/// Codes of element types.
const BOOL: i64 = 9;

/// The nodes and constants that stand for a node, as fields of a graph; none if rten computes it as it is.
pub fn replacement(node: &Node, version: i64, constants: &Constants) -> Result<Option<Vec<u8>>, Fault> {
    let mut graph = GraphWriter::within(format!("{}/", node.outputs.first().unwrap_or(&"")));
    let done = match node.op_type {
        "Softmax" | "LogSoftmax" if version < 13 => softmax(node, &mut graph)?,
        "Resize" | "Upsample" => resize::write(node, version, constants, &mut graph)?,
        "Conv" | "ConvTranspose" | "ConvInteger" => convolution(node, constants, &mut graph)?,
        "MaxPool" | "AveragePool" => pooling(node, &mut graph)?,
        "Cast" => cast(node, &mut graph)?,
        "Sign" => sign(node, &mut graph)?,
        "ArgMax" | "ArgMin" => first_extreme(node, &mut graph)?,
        "Dropout" if version < 12 => without_dropout(node, &mut graph)?,
        "MatMul" => matrix_product(node, constants)?,
        "NonMaxSuppression" => return Err(node.fault("it is not supported")),
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
    let weights = node.input(1).and_then(|name| constants.get(name));
    let of_weights = || weights.map(|weights| weights.dims.iter().skip(2).copied().collect::<Vec<i64>>());
    let is_same = node.text("auto_pad")?.is_some_and(|pad| pad.starts_with("SAME"));
    let kernel = match node.ints("kernel_shape")?.or_else(of_weights) {
        Some(kernel) => kernel,
        None if is_same => {
            return Err(node.fault("it has no `kernel_shape`, and its weights are no constant"));
        }
        // Of a picture; only the number of sides counts.
        None => vec![1; 2],
    };
    if node.op_type == "ConvTranspose"
        && is_same
        && node.ints("strides")?.is_some_and(|s| s.iter().any(|s| *s != 1))
    {
        return Err(node.fault("`auto_pad` is set, with strides; expected `pads`"));
    }
    if node.op_type == "ConvTranspose" && node.has("output_shape")? {
        return Err(node.fault("`output_shape` is not supported; expected `pads` and `output_padding`"));
    }
    let ones = vec![1; kernel.len()];
    let strides = node.ints("strides")?.unwrap_or_else(|| ones.clone());
    let dilations = node.ints("dilations")?.unwrap_or(ones);
    let pads = padding(node, &kernel, &strides, &dilations)?;
    let mut attributes = without_padding(node, pads.as_deref(), &["strides", "dilations"])?;
    attributes.extend([ints("strides", &strides), ints("dilations", &dilations)]);
    graph.named_node(node.op_type, &node.inputs, &node.outputs, &attributes);
    Ok(true)
}

/// As for convolutions.
fn pooling(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let is_set = |name| node.int(name).map(|value| value.is_some_and(|value| value != 0));
    if is_set("ceil_mode")? && is_set("count_include_pad")? {
        return Err(node.fault("`ceil_mode` and `count_include_pad` are set together"));
    }
    let Some(kernel) = node.ints("kernel_shape")? else {
        return Err(node.fault("it has no `kernel_shape`"));
    };
    let ones = vec![1; kernel.len()];
    let strides = node.ints("strides")?.unwrap_or_else(|| ones.clone());
    let dilations = node.ints("dilations")?.unwrap_or(ones);
    let pads = padding(node, &kernel, &strides, &dilations)?;
    let mut attributes = without_padding(node, pads.as_deref(), &["strides"])?;
    attributes.push(ints("strides", &strides));
    graph.named_node(node.op_type, &node.inputs, &node.outputs, &attributes);
    Ok(true)
}

/// The attributes but those of these names, with padding in numbers if it is known.
fn without_padding(node: &Node, pads: Option<&[i64]>, names: &[&str]) -> Result<Vec<Vec<u8>>, Fault> {
    let Some(pads) = pads else { return node.attributes_without(names) };
    let mut attributes = node.attributes_without(&[names, &["pads", "auto_pad"]].concat())?;
    attributes.push(ints("pads", pads));
    Ok(attributes)
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
    let zero = zero_like(input, graph);
    let is_zero = graph.node("Equal", &[input, &zero], &[]);
    graph.named_node("Not", &[&is_zero], &node.outputs, &[]);
    Ok(true)
}

/// rten gives 0 the sign 1.
fn sign(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let Some(input) = node.input(0) else { return Ok(false) };
    let zero = zero_like(input, graph);
    let [above, below] = ["Greater", "Less"].map(|op_type| graph.node(op_type, &[input, &zero], &[]));
    let sign = graph.node("Sub", &[&above, &below], &[]);
    graph.named_node("CastLike", &[&sign, input], &node.outputs, &[]);
    Ok(true)
}

/// Zero of the element type of a value.
fn zero_like(value: &str, graph: &mut GraphWriter) -> String {
    let zero = graph.floats(&[], &[0.0]);
    graph.node("CastLike", &[&zero, value], &[])
}

/// Of equal values the first one counts, unless `select_last_index` is set; rten takes the last one. So the last one of the reversed
/// values is asked for.
fn first_extreme(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let Some(input) = node.input(0) else { return Ok(false) };
    let attributes = node.attributes_without(&["select_last_index"])?;
    if node.int("select_last_index")?.is_some_and(|last| last != 0) {
        graph.named_node(node.op_type, &[input], &node.outputs, &attributes);
        return Ok(true);
    }
    let axis = node.int("axis")?.unwrap_or(0);
    // Both limits saturate at the ends of an axis.
    let [starts, ends, axes, steps] = [-1, i64::MIN, axis, -1].map(|value| graph.integers(&[value]));
    let reversed = graph.node("Slice", &[input, &starts, &ends, &axes, &steps], &[]);
    let found = graph.node(node.op_type, &[&reversed], &attributes);
    let shape = graph.node("Shape", &[input], &[]);
    let size = graph.node("Gather", &[&shape, &axes], &[]);
    let one = graph.integers(&[1]);
    let last = graph.node("Sub", &[&size, &one], &[]);
    graph.named_node("Sub", &[&last, &found], &node.outputs, &[]);
    Ok(true)
}

/// Values are left out in training only.
fn without_dropout(node: &Node, graph: &mut GraphWriter) -> Result<bool, Fault> {
    let (Some(input), [output]) = (node.input(0), &node.outputs[..]) else {
        return Err(node.fault("its mask is used"));
    };
    graph.named_node("Identity", &[input], &[output], &[]);
    Ok(true)
}

/// rten leaves an axis of one element where the second factor is a vector.
fn matrix_product(node: &Node, constants: &Constants) -> Result<bool, Fault> {
    match node.input(1).and_then(|name| constants.get(name)) {
        Some(second) if second.dims.len() == 1 => Err(node.fault("its second factor is a vector")),
        _ => Ok(false),
    }
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
