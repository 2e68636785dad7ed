//! Products of the matrices of a fully connected layer with blocks of items.
//!
//! A block holds [`BLOCK`] items. Its matrices are stored feature by feature: value `k` of item `i` is at `k * BLOCK + i`, so
//! that a vector of the processor holds the same value of successive items, and weights are broadcast. A block of 128
//! features of f32 (256 KiB) stays in the second-level cache from one layer to the next.

use crate::simd::{Real, Simd, SimdVec};

/// Number of items of a block.
pub const BLOCK: usize = 512;

/// Rows of weights and vectors of items whose sums are in registers at the same time.
const ROWS: usize = 8;
const VECTORS: usize = 2;
/// Rows and columns of a tile of the weights' gradient whose sums are in registers at the same time.
const TILE: usize = 4;

/// What is applied to the sums of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    Identity,
    /// Negative values become zero.
    Relu,
}

/// `y = activation(weights x + bias)` of a block. `weights` has a row for each row of `y`; `bias` may be empty.
#[inline(always)]
pub fn multiply<S: Simd>(
    simd: S,
    weights: &[S::Scalar],
    bias: &[S::Scalar],
    x: &[S::Scalar],
    activation: Activation,
    y: &mut [S::Scalar],
) {
    let inputs = x.len() / BLOCK;
    let mut first = 0;
    for group in y.chunks_mut(ROWS * BLOCK) {
        let rows = group.len() / BLOCK;
        let weights = &weights[first * inputs..(first + rows) * inputs];
        let bias = bias.get(first..first + rows).unwrap_or_default();
        if rows == ROWS {
            multiply_rows::<S, ROWS>(simd, weights, bias, x, activation, group);
        } else {
            for (k, row) in group.chunks_mut(BLOCK).enumerate() {
                let bias = bias.get(k..=k).unwrap_or_default();
                multiply_rows::<S, 1>(simd, &weights[k * inputs..][..inputs], bias, x, activation, row);
            }
        }
        first += rows;
    }
}

/// [`multiply`] for `R` rows of weights.
#[inline(always)]
fn multiply_rows<S: Simd, const R: usize>(
    simd: S,
    weights: &[S::Scalar],
    bias: &[S::Scalar],
    x: &[S::Scalar],
    activation: Activation,
    y: &mut [S::Scalar],
) {
    let inputs = x.len() / BLOCK;
    let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
    let mut rows = [&weights[..inputs]; R];
    for r in 0..R {
        rows[r] = &weights[r * inputs..][..inputs];
    }
    for start in (0..BLOCK).step_by(VECTORS * S::WIDTH) {
        let mut sums = [[zero; VECTORS]; R];
        for (r, b) in bias.iter().enumerate() {
            sums[r] = [SimdVec::broadcast(simd, *b); VECTORS];
        }
        for (k, x) in x.chunks_exact(BLOCK).enumerate() {
            let x = &x[start..start + VECTORS * S::WIDTH];
            let mut own = [zero; VECTORS];
            for v in 0..VECTORS {
                own[v] = SimdVec::load(simd, &x[v * S::WIDTH..]);
            }
            for r in 0..R {
                let weight = SimdVec::broadcast(simd, rows[r][k]);
                for v in 0..VECTORS {
                    sums[r][v] = weight.mul_add(own[v], sums[r][v]);
                }
            }
        }
        for (y, sums) in y.chunks_exact_mut(BLOCK).zip(sums) {
            for v in 0..VECTORS {
                let sum = if activation == Activation::Relu { sums[v].max(zero) } else { sums[v] };
                sum.store_to(y, start + v * S::WIDTH);
            }
        }
    }
}

/// Adds the gradient of a layer's weights, `by_y x^T`, and of its bias, the sums of the rows of `by_y`.
#[inline(always)]
pub fn add_weight_gradient<S: Simd>(
    simd: S,
    by_y: &[S::Scalar],
    x: &[S::Scalar],
    by_weights: &mut [S::Scalar],
    by_bias: &mut [S::Scalar],
) {
    let (outputs, inputs) = (by_y.len() / BLOCK, x.len() / BLOCK);
    for (row, by) in by_y.chunks_exact(BLOCK).enumerate() {
        let mut sum = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
        for start in (0..BLOCK).step_by(S::WIDTH) {
            sum += SimdVec::load(simd, &by[start..]);
        }
        by_bias[row] = by_bias[row] + sum.sum();
    }
    for row in (0..outputs).step_by(TILE) {
        for col in (0..inputs).step_by(TILE) {
            let (rows, cols) = ((outputs - row).min(TILE), (inputs - col).min(TILE));
            let sums = products(simd, &by_y[row * BLOCK..], rows, &x[col * BLOCK..], cols);
            for r in 0..rows {
                let line = &mut by_weights[(row + r) * inputs + col..][..cols];
                for (by, sum) in line.iter_mut().zip(sums[r]) {
                    *by = *by + sum;
                }
            }
        }
    }
}

/// Scalar products over the items of the first `rows` rows of `a` and the first `cols` rows of `b`.
#[inline(always)]
fn products<S: Simd>(
    simd: S,
    a: &[S::Scalar],
    rows: usize,
    b: &[S::Scalar],
    cols: usize,
) -> [[S::Scalar; TILE]; TILE] {
    let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
    // Rows beyond the last repeat it, and their products are not used.
    let (mut a_rows, mut b_rows) = ([&a[..BLOCK]; TILE], [&b[..BLOCK]; TILE]);
    for k in 1..TILE {
        a_rows[k] = &a[k.min(rows - 1) * BLOCK..][..BLOCK];
        b_rows[k] = &b[k.min(cols - 1) * BLOCK..][..BLOCK];
    }
    let mut sums = [[zero; TILE]; TILE];
    for start in (0..BLOCK).step_by(S::WIDTH) {
        let (mut own_a, mut own_b) = ([zero; TILE], [zero; TILE]);
        for k in 0..TILE {
            own_a[k] = SimdVec::load(simd, &a_rows[k][start..]);
            own_b[k] = SimdVec::load(simd, &b_rows[k][start..]);
        }
        for r in 0..TILE {
            for c in 0..TILE {
                sums[r][c] = own_a[r].mul_add(own_b[c], sums[r][c]);
            }
        }
    }
    let mut out = [[S::Scalar::from_f64(0.0); TILE]; TILE];
    for r in 0..TILE {
        for c in 0..TILE {
            out[r][c] = sums[r][c].sum();
        }
    }
    out
}

/// Sets the derivatives by the output of a ReLU to zero where the output is zero.
#[inline(always)]
pub fn mask_by_relu<S: Simd>(simd: S, output: &[S::Scalar], by_output: &mut [S::Scalar]) {
    let zero = SimdVec::broadcast(simd, S::Scalar::from_f64(0.0));
    for start in (0..output.len()).step_by(S::WIDTH) {
        let is_positive = SimdVec::load_from(simd, output, start).greater_than(zero);
        SimdVec::load_from(simd, by_output, start).select_or_zero(is_positive).store_to(by_output, start);
    }
}
