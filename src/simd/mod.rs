//! SIMD: vectors of 8 or 16 scalars in the registers of the processor (AVX-512, AVX2, NEON), or in arrays.
//!
//! A kernel is written once, generic over an instruction set [`Simd`], and compiled for each of them
//! ([`SimdKernel`]). [`SimdReal::dispatch`] runs it with the best instruction set of the processor. Training
//! uses f32. The same kernels run in f64 in tests, where their gradients are compared with finite
//! differences.
//!
//! Vectors carry a value of their instruction set, which proves that the processor supports it (as in the
//! crate `pulp`, on which this module is built).

mod compress;
mod elementary;
mod exp2;
mod f64_array;
mod instruction_set;
mod processor;
mod real;
mod registers;
mod transpose;
mod vector;

pub use compress::set_bits;
pub use exp2::Exp2;
pub use instruction_set::{MAX_LANES, Simd, SimdKernel, SimdReal};
pub use real::Real;
pub use transpose::{
    arrays_of_lanes, blocks_of_lines, lines_of_blocks, sum_fours, transpose_eights, transpose_fours,
};
pub use vector::{Arithmetic, SimdMask, SimdVec, broadcast_each};

#[cfg(test)]
mod tests;
