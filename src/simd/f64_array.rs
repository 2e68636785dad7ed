//! Vectors of f64 in arrays, with which tests compare the gradients of kernels with finite differences.

use super::compress::compress_eight;
use super::{MAX_LANES, Simd, SimdKernel, SimdReal};

/// Vectors of eight f64.
#[derive(Clone, Copy)]
pub(super) struct F64Array;

impl SimdReal for f64 {
    fn dispatch(kernel: impl SimdKernel<f64>) {
        kernel.run(F64Array);
    }
}

impl Simd for F64Array {
    const WIDTH: usize = 8;
    type Scalar = f64;
    type Vector = [f64; 8];
    type Mask = [bool; 8];

    fn broadcast(self, value: f64) -> [f64; 8] {
        [value; 8]
    }
    fn load(self, values: &[f64]) -> [f64; 8] {
        std::array::from_fn(|i| values[i])
    }
    fn store(self, a: [f64; 8], values: &mut [f64]) {
        values[..8].copy_from_slice(&a);
    }
    fn concat_halves(self, a: [f64; 8], b: [f64; 8]) -> [[f64; 8]; 2] {
        [0, 4].map(|k| std::array::from_fn(|i| if i < 4 { a[k + i] } else { b[k + i - 4] }))
    }
    fn deinterleave_quarters(self, a: [f64; 8], b: [f64; 8]) -> [[f64; 8]; 2] {
        [a, b]
    }
    fn load_eights(self, [eight, _]: [&[f64; 8]; 2]) -> [f64; 8] {
        *eight
    }
    fn store_eights(self, a: [f64; 8], [eight, _]: [&mut [f64; 8]; 2]) {
        *eight = a;
    }
    fn transpose_fours(self, rows: [[f64; 8]; 4]) -> [[f64; 8]; 4] {
        std::array::from_fn(|k| std::array::from_fn(|i| rows[i % 4][i / 4 * 4 + k]))
    }
    fn transpose_eights(self, rows: [[f64; 8]; 8]) -> [[f64; 8]; 8] {
        std::array::from_fn(|k| rows.map(|row| row[k]))
    }
    fn add(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] + b[i])
    }
    fn sub(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] - b[i])
    }
    fn mul(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] * b[i])
    }
    fn div(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] / b[i])
    }
    fn reciprocal(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::recip)
    }
    fn mul_add(self, a: [f64; 8], b: [f64; 8], c: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i] * b[i] + c[i])
    }
    fn min(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i].min(b[i]))
    }
    fn max(self, a: [f64; 8], b: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| a[i].max(b[i]))
    }
    fn sqrt(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::sqrt)
    }
    fn sqrt_approx(self, a: [f64; 8]) -> [f64; 8] {
        self.sqrt(a)
    }
    fn exp2(self, a: [f64; 8], _: &[[f64; 8]; 7]) -> [f64; 8] {
        a.map(f64::exp2)
    }
    fn log2(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::log2)
    }
    fn sum(self, a: [f64; 8]) -> f64 {
        a.iter().sum()
    }
    fn floor(self, a: [f64; 8]) -> [f64; 8] {
        a.map(f64::floor)
    }
    fn store_u32(self, a: [f64; 8], values: &mut [u32; MAX_LANES]) {
        values[..8].copy_from_slice(&a.map(|v| v as u32));
    }
    fn greater_equal(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] >= b[i])
    }
    fn greater_than(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] > b[i])
    }
    fn and(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] && b[i])
    }
    fn bitmask(self, a: [bool; 8]) -> u32 {
        a.iter().enumerate().fold(0, |bits, (i, holds)| bits | u32::from(*holds) << i)
    }
    fn compress(self, a: [bool; 8], first: u8, indices: &mut [u8]) -> usize {
        compress_eight(self.bitmask(a) as u8, first, indices)
    }
    fn select_or_zero(self, mask: [bool; 8], a: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| if mask[i] { a[i] } else { 0.0 })
    }
}
