//! Why an ONNX file is refused before a runtime reads it.

/// Why a file is refused.
#[derive(Debug, PartialEq)]
pub enum Fault {
    /// The bytes are no whole ONNX model.
    Damaged { at: usize, reason: &'static str },
    /// A `Resize` with cubic polynomials, by its name or its first output.
    CubicResize { node: String },
    /// The version of the operators; none if the file states none.
    Version { found: Option<i64> },
    /// An operator that cannot be computed as the file's version of the operators defines it.
    Operator { node: String, op_type: String, reason: String },
}
