//! Vectors of f32 in the registers of the processor.

use super::elementary::{exp2, floor, log2, to_u32};
use super::processor::Processor;
use super::{MAX_LANES, Simd, SimdKernel, SimdReal};

/// Vectors of `N` registers of f32 each.
#[derive(Clone, Copy)]
pub(super) struct Registers<S, const N: usize>(pub(super) S);

impl SimdReal for f32 {
    #[inline]
    fn dispatch(kernel: impl SimdKernel<f32>) {
        match pulp::Arch::new() {
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V4(s) => s.vectorize(Compiled::<_, _, 1>(s, kernel)),
            #[cfg(target_arch = "x86_64")]
            pulp::Arch::V3(s) => s.vectorize(Compiled::<_, _, 1>(s, kernel)),
            #[cfg(target_arch = "aarch64")]
            pulp::Arch::Neon(s) => s.vectorize(Compiled::<_, _, 2>(s, kernel)),
            _ => kernel.run(Registers::<_, 8>(pulp::Scalar::new())),
        }
    }
}

/// A kernel as a function that `pulp` compiles with the instructions of a processor.
pub(super) struct Compiled<S, K, const N: usize>(pub(super) S, pub(super) K);

impl<S: Processor, K: SimdKernel<f32>, const N: usize> pulp::NullaryFnOnce for Compiled<S, K, N> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        self.1.run(Registers::<S, N>(self.0));
    }
}

/// An array with the value of an expression for every register `k`. A macro, because closures would be
/// compiled without the instructions of the processor.
macro_rules! each {
    ($k:ident: $value:expr) => {{
        let $k = 0;
        let mut out = [$value; N];
        for $k in 1..N {
            out[$k] = $value;
        }
        out
    }};
}

impl<S: Processor, const N: usize> Simd for Registers<S, N> {
    const WIDTH: usize = N * S::F32_LANES;
    type Scalar = f32;
    type Vector = [S::f32s; N];
    type Mask = [S::m32s; N];

    #[inline(always)]
    fn broadcast(self, value: f32) -> Self::Vector {
        [self.0.splat_f32s(value); N]
    }
    #[inline(always)]
    fn load(self, values: &[f32]) -> Self::Vector {
        let registers = S::as_simd_f32s(&values[..Self::WIDTH]).0;
        each!(k: registers[k])
    }
    #[inline(always)]
    fn store(self, a: Self::Vector, values: &mut [f32]) {
        S::as_mut_simd_f32s(&mut values[..Self::WIDTH]).0.copy_from_slice(&a);
    }
    #[inline(always)]
    fn concat_halves(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2] {
        self.0.concat_halves(a, b)
    }
    #[inline(always)]
    fn deinterleave_quarters(self, a: Self::Vector, b: Self::Vector) -> [Self::Vector; 2] {
        self.0.deinterleave_quarters(a, b)
    }
    #[inline(always)]
    fn load_eights(self, eights: [&[f32; 8]; 2]) -> Self::Vector {
        self.0.load_eights(eights)
    }
    #[inline(always)]
    fn store_eights(self, a: Self::Vector, eights: [&mut [f32; 8]; 2]) {
        self.0.store_eights(a, eights);
    }
    #[inline(always)]
    fn transpose_fours(self, rows: [Self::Vector; 4]) -> [Self::Vector; 4] {
        self.0.transpose_fours(rows)
    }
    #[inline(always)]
    fn transpose_eights(self, rows: [Self::Vector; 8]) -> [Self::Vector; 8] {
        self.0.transpose_eights(rows)
    }
    #[inline(always)]
    fn add(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.add_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sub(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.sub_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn mul(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.mul_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn div(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.div_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn reciprocal(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.reciprocal(a[k]))
    }
    #[inline(always)]
    fn mul_add(self, a: Self::Vector, b: Self::Vector, c: Self::Vector) -> Self::Vector {
        each!(k: self.0.mul_add_e_f32s(a[k], b[k], c[k]))
    }
    #[inline(always)]
    fn min(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.min_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn max(self, a: Self::Vector, b: Self::Vector) -> Self::Vector {
        each!(k: self.0.max_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn sqrt(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.sqrt_f32s(a[k]))
    }
    #[inline(always)]
    fn sqrt_approx(self, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.sqrt_approx(a[k]))
    }
    #[inline(always)]
    fn exp2(self, a: Self::Vector, constants: &[Self::Vector; 7]) -> Self::Vector {
        each!(k: exp2(self.0, a[k], std::array::from_fn(|c| constants[c][k])))
    }
    #[inline(always)]
    fn log2(self, a: Self::Vector) -> Self::Vector {
        each!(k: log2(self.0, a[k]))
    }
    #[inline(always)]
    fn sum(self, a: Self::Vector) -> f32 {
        let mut sum = a[0];
        for k in 1..N {
            sum = self.0.add_f32s(sum, a[k]);
        }
        self.0.reduce_sum_f32s(sum)
    }
    #[inline(always)]
    fn floor(self, a: Self::Vector) -> Self::Vector {
        each!(k: floor(self.0, a[k]))
    }
    #[inline(always)]
    fn store_u32(self, a: Self::Vector, values: &mut [u32; MAX_LANES]) {
        let values = S::as_mut_simd_u32s(&mut values[..Self::WIDTH]).0;
        for k in 0..N {
            values[k] = to_u32(self.0, a[k]);
        }
    }
    #[inline(always)]
    fn greater_equal(self, a: Self::Vector, b: Self::Vector) -> Self::Mask {
        each!(k: self.0.greater_than_or_equal_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn greater_than(self, a: Self::Vector, b: Self::Vector) -> Self::Mask {
        each!(k: self.0.greater_than_f32s(a[k], b[k]))
    }
    #[inline(always)]
    fn and(self, a: Self::Mask, b: Self::Mask) -> Self::Mask {
        each!(k: self.0.and_m32s(a[k], b[k]))
    }
    #[inline(always)]
    fn compress(self, a: Self::Mask, first: u8, indices: &mut [u8]) -> usize {
        self.0.compress(a, first, indices)
    }
    #[inline(always)]
    fn bitmask(self, a: Self::Mask) -> u32 {
        let mut bits = 0;
        for k in 0..N {
            bits |= self.0.bitmask(a[k]) << (k * S::F32_LANES);
        }
        bits
    }
    #[inline(always)]
    fn select_or_zero(self, mask: Self::Mask, a: Self::Vector) -> Self::Vector {
        each!(k: self.0.select_or_zero(mask[k], a[k]))
    }
}
