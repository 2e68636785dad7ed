//! `Resize` and `Upsample` by scales, as gathers along each axis.
//!
//! <https://onnx.ai/onnx/operators/onnx__Resize.html>: of `n` values along an axis there become `floor(n s)`, and a place `i` of
//! these lies at `(i + 0.5) / s - 0.5` of the others (`half_pixel`). rten computes with the ratio of the two sizes instead of `s`, which
//! is the same only where `n s` is a whole number.

use super::fault::Fault;
use super::node::{Constants, Node};
use super::writer::{GraphWriter, int};

/// Code of the element type of places.
const INT32: i64 = 6;
const FLOAT: i64 = 1;
/// Axes of a picture; computed scales are taken to be of one, and the runtime checks it.
const PICTURE_AXES: usize = 4;

/// Writes what stands for a node; false if rten computes it as it is.
pub fn write(
    node: &Node,
    version: i64,
    constants: &Constants,
    graph: &mut GraphWriter,
) -> Result<bool, Fault> {
    let Some(input) = node.input(0) else { return Ok(false) };
    let rule = Rule::of(node, version)?;
    let scales_at = if node.op_type == "Upsample" || version == 10 { 1 } else { 2 };
    let known = match node.input(scales_at) {
        Some(name) => constants.get(name).map(|scales| scales.floats()).transpose()?,
        None => node.floats("scales")?,
    };
    let is_native = node.op_type == "Resize" && version > 10;
    // rten divides by the number of rows or columns but one.
    let sizes = node.input(3).and_then(|name| constants.get(name)).map(|c| c.integers()).transpose()?;
    if matches!(rule.place, Place::AlignCorners)
        && sizes.is_some_and(|sizes| sizes.iter().skip(2).any(|n| *n == 1))
    {
        return Err(node.fault("`align_corners` with a size of 1"));
    }
    let (scales, axes) = match (known, node.input(scales_at)) {
        (Some(known), _) if known.is_empty() => return Ok(false),
        // The sizes are whole then, and their ratio is the scale.
        (Some(known), _) if is_native && rule.is_native() && known.iter().all(|s| s.fract() == 0.0) => {
            return Ok(false);
        }
        (Some(known), _) => {
            let shape = [known.len()];
            (graph.floats(&shape, &known), known.into_iter().map(Some).collect())
        }
        (None, Some(computed)) => {
            let shape = graph.integers(&[PICTURE_AXES as i64]);
            (graph.node("Reshape", &[computed, &shape], &[]), vec![None; PICTURE_AXES])
        }
        (None, None) => return Ok(false),
    };
    let mut value = input.to_owned();
    for (axis, known) in axes.iter().enumerate().filter(|(_, scale)| **scale != Some(1.0)) {
        value = rule.along(&value, axis, axes.len(), &scales, *known, graph);
    }
    graph.named_node("Identity", &[&value], &node.outputs, &[]);
    Ok(true)
}

/// Where the values of an axis come from.
enum Place {
    HalfPixel,
    HalfPixelSymmetric,
    PytorchHalfPixel,
    HalfPixelForNearest,
    Asymmetric,
    AlignCorners,
}

/// Which values of the input make one of the output.
enum Choice {
    Linear,
    Floor,
    Ceil,
    RoundPreferFloor,
    RoundPreferCeil,
    /// Before version 11: the value before the place of a larger output, and the one after it of a smaller one, as onnxruntime has it.
    Early,
}

struct Rule {
    place: Place,
    choice: Choice,
}

impl Rule {
    fn of(node: &Node, version: i64) -> Result<Self, Fault> {
        let early = node.op_type == "Upsample" || version == 10;
        let place = match node.text("coordinate_transformation_mode")?.unwrap_or("half_pixel") {
            _ if early => Place::Asymmetric,
            "half_pixel" => Place::HalfPixel,
            "half_pixel_symmetric" => Place::HalfPixelSymmetric,
            "pytorch_half_pixel" => Place::PytorchHalfPixel,
            "tf_half_pixel_for_nn" => Place::HalfPixelForNearest,
            "asymmetric" => Place::Asymmetric,
            "align_corners" => Place::AlignCorners,
            other => return Err(node.fault(format!("`coordinate_transformation_mode` is `{other}`"))),
        };
        let choice = match node.text("mode")?.unwrap_or("nearest") {
            "linear" | "bilinear" => Choice::Linear,
            "nearest" if early => Choice::Early,
            "nearest" => match node.text("nearest_mode")?.unwrap_or("round_prefer_floor") {
                "floor" => Choice::Floor,
                "ceil" => Choice::Ceil,
                "round_prefer_floor" => Choice::RoundPreferFloor,
                "round_prefer_ceil" => Choice::RoundPreferCeil,
                other => return Err(node.fault(format!("`nearest_mode` is `{other}`"))),
            },
            other => return Err(node.fault(format!("`mode` is `{other}`; expected `nearest` or `linear`"))),
        };
        for name in ["antialias", "exclude_outside"] {
            if node.int(name)?.is_some_and(|value| value != 0) {
                return Err(node.fault(format!("`{name}` is not supported")));
            }
        }
        if node.has("axes")? {
            return Err(node.fault("`axes` are not supported; expected scales or sizes of all axes"));
        }
        Ok(Self { place, choice })
    }

    /// Whether rten has the rule, for sizes that are whole multiples.
    fn is_native(&self) -> bool {
        !matches!(self.place, Place::HalfPixelSymmetric | Place::HalfPixelForNearest)
    }

    /// The value with another number of elements along an axis.
    fn along(
        &self,
        value: &str,
        axis: usize,
        axes: usize,
        scales: &str,
        known: Option<f32>,
        graph: &mut GraphWriter,
    ) -> String {
        let axis_i64 = axis as i64;
        let shape = graph.node("Shape", &[value], &[int("start", axis_i64), int("end", axis_i64 + 1)]);
        let size = graph.node("Cast", &[&shape], &[int("to", FLOAT)]);
        let at = graph.integers(&[axis_i64]);
        let scale = match known {
            Some(scale) => graph.floats(&[1], &[scale]),
            None => graph.node("Gather", &[scales, &at], &[int("axis", 0)]),
        };
        let mut sum = Formulas { graph };
        let exact_size = sum.of("Mul", &size, &scale);
        let new_size = sum.graph.node("Floor", &[&exact_size], &[]);
        let [zero, half, one] = [0.0, 0.5, 1.0].map(|v| sum.graph.floats(&[1], &[v]));
        let [start, step] = [0.0, 1.0].map(|v| sum.graph.floats(&[], &[v]));
        let count = sum.graph.node("Squeeze", &[&new_size], &[]);
        let places = sum.graph.node("Range", &[&start, &count, &step], &[]);
        let last = sum.of("Sub", &size, &one);

        // rten multiplies by the reciprocal of a divisor of one element, which is inexact where places lie in the middle.
        let count = sum.graph.node("Shape", &[&places], &[]);
        let scale = sum.graph.node("Expand", &[&scale, &count], &[]);
        let middle = sum.of("Add", &places, &half);
        let corner = sum.of("Div", &middle, &scale);
        let half_pixel = sum.of("Sub", &corner, &half);
        let place = match self.place {
            Place::HalfPixel => half_pixel,
            Place::HalfPixelForNearest => corner,
            Place::HalfPixelSymmetric => {
                // Equal margins on both sides: n / 2 (1 - floor(n s) / (n s)).
                let kept = sum.of("Div", &new_size, &exact_size);
                let lost = sum.of("Sub", &one, &kept);
                let center = sum.of("Mul", &size, &half);
                let margin = sum.of("Mul", &center, &lost);
                let moved = sum.of("Add", &margin, &corner);
                sum.of("Sub", &moved, &half)
            }
            Place::PytorchHalfPixel => {
                // 0 where there is one place only.
                let more = sum.of("Sub", &new_size, &one);
                let is_more = sum.of("Min", &more, &one);
                sum.of("Mul", &half_pixel, &is_more)
            }
            Place::Asymmetric => sum.of("Div", &places, &scale),
            Place::AlignCorners => {
                let last_place = sum.of("Sub", &new_size, &one);
                let last_place = sum.of("Max", &last_place, &one);
                let scaled = sum.of("Mul", &places, &last);
                sum.of("Div", &scaled, &last_place)
            }
        };
        let (first, share) = match self.choice {
            Choice::Linear => {
                let inside = sum.clamped(&place, &zero, &last);
                let first = sum.graph.node("Floor", &[&inside], &[]);
                let share = sum.of("Sub", &inside, &first);
                (first, Some(share))
            }
            Choice::Floor => (sum.graph.node("Floor", &[&place], &[]), None),
            Choice::Ceil => (sum.graph.node("Ceil", &[&place], &[]), None),
            Choice::RoundPreferFloor => (sum.rounded(&place, &half, "Greater"), None),
            Choice::RoundPreferCeil => (sum.rounded(&place, &half, "GreaterOrEqual"), None),
            Choice::Early => {
                let [below, above] = ["Floor", "Ceil"].map(|op| sum.graph.node(op, &[&place], &[]));
                let is_smaller = sum.of("Less", &scale, &one);
                (sum.graph.node("Where", &[&is_smaller, &above, &below], &[]), None)
            }
        };
        let first = sum.clamped(&first, &zero, &last);
        let first_values = sum.gathered(value, &first, axis_i64);
        let Some(share) = share else { return first_values };
        let second = sum.of("Add", &first, &one);
        let second = sum.of("Min", &second, &last);
        let second_values = sum.gathered(value, &second, axis_i64);
        let mut column = vec![1; axes - axis];
        column[0] = -1;
        let column = sum.graph.integers(&column);
        let share = sum.graph.node("Reshape", &[&share, &column], &[]);
        let rest = sum.of("Sub", &one, &share);
        let first_part = sum.of("Mul", &first_values, &rest);
        let second_part = sum.of("Mul", &second_values, &share);
        sum.of("Add", &first_part, &second_part)
    }
}

/// Formulas of vectors.
struct Formulas<'a> {
    graph: &'a mut GraphWriter,
}

impl Formulas<'_> {
    fn of(&mut self, op_type: &str, a: &str, b: &str) -> String {
        self.graph.node(op_type, &[a, b], &[])
    }

    fn clamped(&mut self, value: &str, lowest: &str, highest: &str) -> String {
        let above = self.of("Max", value, lowest);
        self.of("Min", &above, highest)
    }

    /// Rounded down, and up by one where the fraction is above a half by a comparison: a sum with a half would round.
    fn rounded(&mut self, value: &str, half: &str, comparison: &str) -> String {
        let below = self.graph.node("Floor", &[value], &[]);
        let fraction = self.of("Sub", value, &below);
        let is_above = self.of(comparison, &fraction, half);
        let up = self.graph.node("Cast", &[&is_above], &[int("to", FLOAT)]);
        self.of("Add", &below, &up)
    }

    fn gathered(&mut self, value: &str, places: &str, axis: i64) -> String {
        let places = self.graph.node("Cast", &[places], &[int("to", INT32)]);
        self.graph.node("Gather", &[value, &places], &[int("axis", axis)])
    }
}
