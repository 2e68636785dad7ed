//! The types of stored numbers, as far as readers tell them apart.

/// The type of the numbers of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NumberKind {
    /// Floating-point numbers.
    Float,
    /// Unsigned integers of 16 bits.
    U16,
    /// Integers of any other size.
    Integer,
}

impl NumberKind {
    /// Whether the numbers are whole.
    #[must_use]
    pub fn is_integer(self) -> bool {
        self != Self::Float
    }

    /// The stored depth of a number; NaN for what marks a pixel without a depth: numbers that are not finite or not above zero,
    /// and in files of 16 bits the largest one (7-Scenes, ScanNet).
    #[must_use]
    pub fn depth(self, value: f32) -> f32 {
        let is_mark = self == Self::U16 && value == f32::from(u16::MAX);
        if value.is_finite() && value > 0.0 && !is_mark { value } else { f32::NAN }
    }
}
