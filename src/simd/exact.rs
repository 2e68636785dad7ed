//! Lanes of f64 in an array: gradients are checked with them.

use super::{Kernel, LANES, Lanes, Lanewise, list_eight};

/// Eight of them.
#[derive(Clone, Copy)]
pub(super) struct Exact;

impl Lanewise for f64 {
    fn dispatch(kernel: impl Kernel<f64>) {
        kernel.run(Exact);
    }
}

impl Lanes for Exact {
    const WIDTH: usize = 8;
    type Number = f64;
    type Numbers = [f64; 8];
    type Truths = [bool; 8];

    fn splat(self, value: f64) -> [f64; 8] {
        [value; 8]
    }
    fn load(self, values: &[f64]) -> [f64; 8] {
        std::array::from_fn(|i| values[i])
    }
    fn store(self, a: [f64; 8], places: &mut [f64]) {
        places[..8].copy_from_slice(&a);
    }
    fn halves(self, a: [f64; 8], b: [f64; 8]) -> [[f64; 8]; 2] {
        [0, 4].map(|k| std::array::from_fn(|i| if i < 4 { a[k + i] } else { b[k + i - 4] }))
    }
    fn quarters(self, a: [f64; 8], b: [f64; 8]) -> [[f64; 8]; 2] {
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
    fn rough_sqrt(self, a: [f64; 8]) -> [f64; 8] {
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
    fn store_whole(self, a: [f64; 8], places: &mut [u32; LANES]) {
        places[..8].copy_from_slice(&a.map(|v| v as u32));
    }
    fn at_least(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] >= b[i])
    }
    fn above(self, a: [f64; 8], b: [f64; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] > b[i])
    }
    fn and(self, a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        std::array::from_fn(|i| a[i] && b[i])
    }
    fn bits(self, a: [bool; 8]) -> u32 {
        a.iter().enumerate().fold(0, |bits, (i, holds)| bits | u32::from(*holds) << i)
    }
    fn list(self, a: [bool; 8], first: u8, places: &mut [u8]) -> usize {
        list_eight(self.bits(a) as u8, first, places)
    }
    fn keep(self, truths: [bool; 8], a: [f64; 8]) -> [f64; 8] {
        std::array::from_fn(|i| if truths[i] { a[i] } else { 0.0 })
    }
}
