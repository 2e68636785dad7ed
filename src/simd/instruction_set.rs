//! The trait of instruction sets, and the compilation of a kernel for each of them.

use super::Real;

/// Largest number of lanes of a vector.
pub const MAX_LANES: usize = 16;

/// A computation that is compiled for every instruction set.
///
/// It is a type and not a closure, because its method is generic over the instruction set.
pub trait SimdKernel<T> {
    /// Runs the computation with an instruction set.
    fn run<S: Simd<Scalar = T>>(self, simd: S);
}

/// A scalar that kernels can be compiled for: f32 or f64.
pub trait SimdReal: Real {
    /// Runs the kernel with the best instruction set of the processor.
    fn dispatch(kernel: impl SimdKernel<Self>);
}

/// An instruction set: operations on vectors of [`Simd::WIDTH`] scalars.
pub trait Simd: Copy {
    /// Lanes of a vector: 8 or [`MAX_LANES`].
    const WIDTH: usize;
    /// The type of a lane.
    type Scalar: Real;
    /// The type of all lanes together.
    type Vector: Copy;
    /// A boolean for each lane.
    type Mask: Copy;

    /// The same number in every lane.
    fn broadcast(self, value: Self::Scalar) -> Self::Vector;
    /// Reads the first [`Simd::WIDTH`] values of a slice, which has at least as many.
    fn load(self, values: &[Self::Scalar]) -> Self::Vector;
    /// Writes to the first [`Simd::WIDTH`] values of a slice, which has at least as many.
    fn store(self, a: Self::Vector, values: &mut [Self::Scalar]);
    /// The lower halves of `a` and `b` as one vector, and the upper halves as another.
    fn concat_halves(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2];
    /// Separates even and odd groups of four lanes. With the four groups of `a` named a0 to a3 and those of
    /// `b` b0 to b3, the results are (a0, a2, b0, b2) and (a1, a3, b1, b3). This is for 16 lanes only; with
    /// 8, the result is unspecified.
    fn deinterleave_quarters(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2];
    /// Reads eight lanes from the first array and, with 16 lanes, the other eight from the second.
    fn load_eights(self, eights: [&[Self::Scalar; 8]; 2]) -> Self::Vector;
    /// Writes the lanes to the places from which [`Simd::load_eights`] reads them.
    fn store_eights(self, a: Self::Vector, eights: [&mut [Self::Scalar; 8]; 2]);
    /// Transposes every 4 x 4 block: within each group of four lanes, lane `j` of vector `k` and lane `k` of
    /// vector `j` change places.
    fn transpose_fours(self, rows: [Self::Vector; 4]) -> [Self::Vector; 4];
    /// Transposes every 8 x 8 block: within each group of eight lanes, lane `j` of vector `k` and lane `k` of
    /// vector `j` change places.
    fn transpose_eights(self, rows: [Self::Vector; 8]) -> [Self::Vector; 8];
    /// `a + b`.
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a - b`.
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a b`.
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `a / b`.
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// `1 / a`, with an error of at most two units in the last place.
    fn reciprocal(self, a: Self::Vector) -> Self::Vector;
    /// `a b + c`; rounded once where the processor has such an instruction, else twice.
    fn mul_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector;
    /// The smaller of two lanes.
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// The greater of two lanes.
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector;
    /// Square root.
    fn sqrt(self, a: Self::Vector) -> Self::Vector;
    /// Approximate square root of positive numbers, with a relative error below 4e-4.
    fn sqrt_approx(self, a: Self::Vector) -> Self::Vector;
    /// `2^a` for `a` between -126 and 126; unspecified values outside. `constants` are those of
    /// [`Exp2`](super::Exp2).
    fn exp2(self, a: Self::Vector, constants: &[Self::Vector; 7]) -> Self::Vector;
    /// Binary logarithm of positive numbers.
    fn log2(self, a: Self::Vector) -> Self::Vector;
    /// Sum of the lanes. The order of the additions depends on the instruction set only.
    fn sum(self, a: Self::Vector) -> Self::Scalar;
    /// The largest whole number not above `a`, for `a` between 0 and 2^22.
    fn floor(self, a: Self::Vector) -> Self::Vector;
    /// Writes whole numbers between 0 and 2^22 as u32 to the first [`Simd::WIDTH`] values of an array.
    fn store_u32(self, a: Self::Vector, values: &mut [u32; MAX_LANES]);
    /// `a >= b`.
    fn greater_equal(self, a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// `a > b`.
    fn greater_than(self, a: Self::Vector, b: Self::Vector) -> Self::Mask;
    /// True in the lanes where both masks are.
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The mask as an integer with one bit for each lane, the lowest bit for the first.
    fn bitmask(self, a: Self::Mask) -> u32;
    /// Writes `first` plus the index of each true lane to `indices`, in ascending order, and returns the
    /// number of true lanes. `indices` has at least [`MAX_LANES`] elements, of which those after the written
    /// ones are unspecified.
    fn compress(self, a: Self::Mask, first: u8, indices: &mut [u8]) -> usize;
    /// `a` where the mask is true, else zero.
    fn select_or_zero(self, mask: Self::Mask, a: Self::Vector) -> Self::Vector;
}
