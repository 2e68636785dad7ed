//! Convolutions with fixed weights, and their gradient by the input.
//!
//! As in every network library, a "convolution" is a correlation:
//! `out[o, y, x] = b[o] + Σ w[o, i, t, u] in[i, y + t - p, x + u - p]`, with square kernels, stride 1 and padding `p` by zeros. Its
//! gradient by the input is one too, with flipped kernels and the channels exchanged.

use super::feature_map::{BORDER, FeatureMap, LANES, Pixel16, SLACK, Stripe};
use crate::simd::{Real, Simd, SimdKernel, SimdReal, SimdVec};
use rayon::prelude::*;
use std::sync::OnceLock;

/// A convolution followed by a ReLU, with fixed weights.
pub(super) struct Convolution<T> {
    forward: Correlation<T>,
    bias: Vec<Pixel16<T>>,
    /// The gradient by the input; made when it is first asked for, because scores need none.
    backward: OnceLock<Correlation<T>>,
}

/// Numbers of channels, side and padding of the kernels of a convolution.
#[derive(Clone, Copy)]
pub(super) struct KernelShape {
    /// Channels of the input.
    pub(super) inputs: usize,
    /// Channels of the output.
    pub(super) outputs: usize,
    /// Columns and rows of a kernel: at most `BORDER + 1 + padding`.
    pub(super) side: usize,
    /// Columns and rows of zeros around the input: at most [`BORDER`].
    pub(super) padding: usize,
}

impl<T: SimdReal> Convolution<T> {
    /// A convolution whose weight of output and input channel, row and column of the kernel is `weight(o, i, t, u)`; `bias` has
    /// a value for each output.
    pub(super) fn new(
        shape: KernelShape,
        weight: impl Fn(usize, usize, usize, usize) -> T,
        bias: &[T],
    ) -> Self {
        debug_assert!(shape.padding <= BORDER && shape.side <= BORDER + 1 + shape.padding);
        let mut blocks = vec![[T::zero(); LANES]; shape.outputs.div_ceil(LANES)];
        blocks.as_flattened_mut().iter_mut().zip(bias).for_each(|(own, bias)| *own = *bias);
        Self { forward: Correlation::new(shape, weight), bias: blocks, backward: OnceLock::new() }
    }

    /// Sets the output: the rectified convolution of the input.
    pub(super) fn forward(&self, input: &FeatureMap<T>, output: &mut FeatureMap<T>) {
        self.forward.run(input, Some(&self.bias), output);
    }

    /// Sets the derivatives by the input, from those by the output of the convolution, before the ReLU.
    pub(super) fn backward(&self, by_output: &FeatureMap<T>, by_input: &mut FeatureMap<T>) {
        self.backward.get_or_init(|| self.forward.adjoint()).run(by_output, None, by_input);
    }
}

/// Weights of a block of input channels (rows) and a block of output channels (columns) at one place of the kernel. A row of
/// f32 is one line of the cache.
#[repr(align(64))]
struct Tap<T>([Pixel16<T>; LANES]);

/// The linear part of a convolution.
struct Correlation<T> {
    shape: KernelShape,
    /// For each block of outputs, each block of inputs, each row and column of the kernel; zero for channels that do not exist.
    taps: Vec<Tap<T>>,
}

impl<T: SimdReal> Correlation<T> {
    fn new(shape: KernelShape, weight: impl Fn(usize, usize, usize, usize) -> T) -> Self {
        let KernelShape { inputs, outputs, side, .. } = shape;
        let mut taps = Vec::new();
        for first_output in (0..outputs).step_by(LANES) {
            for first_input in (0..inputs).step_by(LANES) {
                for (t, u) in (0..side).flat_map(|t| (0..side).map(move |u| (t, u))) {
                    let mut tap = Tap([[T::zero(); LANES]; LANES]);
                    for (i, row) in (first_input..inputs).zip(&mut tap.0) {
                        for (o, value) in (first_output..outputs).zip(row) {
                            *value = weight(o, i, t, u);
                        }
                    }
                    taps.push(tap);
                }
            }
        }
        Self { shape, taps }
    }

    /// Number of taps of a block of outputs.
    fn taps_of_block(&self) -> usize {
        self.shape.inputs.div_ceil(LANES) * self.shape.side.pow(2)
    }

    /// The gradient of this map: its transpose.
    fn adjoint(&self) -> Self {
        let KernelShape { inputs, outputs, side, padding } = self.shape;
        let shape = KernelShape { inputs: outputs, outputs: inputs, side, padding: side - 1 - padding };
        Self::new(shape, |o, i, t, u| {
            let place = (side - 1 - t) * side + side - 1 - u;
            let tap = i / LANES * self.taps_of_block() + o / LANES * side.pow(2) + place;
            self.taps[tap].0[o % LANES][i % LANES]
        })
    }

    /// Sets the output; with a bias it is added, and the sum rectified.
    fn run(&self, input: &FeatureMap<T>, bias: Option<&[Pixel16<T>]>, output: &mut FeatureMap<T>) {
        let KernelShape { inputs, outputs, side, padding } = self.shape;
        debug_assert_eq!(input.channels(), inputs);
        let grow = |n: usize| n + 2 * padding + 1 - side;
        output.resize(grow(input.width()), grow(input.height()), outputs);
        let places = (0..side).flat_map(|t| (0..side).map(move |u| t * input.pitch() + u));
        let offsets: Vec<usize> = (0..input.blocks())
            .flat_map(|block| places.clone().map(move |place| block * input.plane_len() + place))
            .collect();
        let corner = input.index(0, 0) - padding * (input.pitch() + 1);
        output.stripes_mut().into_par_iter().for_each(|stripe| {
            T::dispatch(StripeKernel {
                input: &input.pixels()[corner..],
                pitch: input.pitch(),
                offsets: &offsets,
                taps: &self.taps[stripe.block * self.taps_of_block()..][..self.taps_of_block()],
                bias: bias.map(|bias| &bias[stripe.block]),
                output: stripe,
            });
        });
    }
}

/// The convolution of one stripe.
struct StripeKernel<'a, T> {
    /// Input from the pixel on that meets the first element of the kernel for the first pixel of the output.
    input: &'a [Pixel16<T>],
    pitch: usize,
    /// Place in the input that each tap meets for the first pixel of the output.
    offsets: &'a [usize],
    taps: &'a [Tap<T>],
    bias: Option<&'a Pixel16<T>>,
    output: Stripe<'a, T>,
}

impl<T: SimdReal> SimdKernel<T> for StripeKernel<'_, T> {
    #[inline(always)]
    fn run<S: Simd<Scalar = T>>(self, simd: S) {
        // As many sums as the registers of an instruction set hold beside the weights: of 32, or of 16.
        if S::WIDTH == LANES {
            self.tiles::<S, 2, 8, 1>(simd);
        } else {
            self.tiles::<S, 1, 6, 2>(simd);
        }
    }
}

/// Sums in registers: `V` vectors of channels for `C` columns of `R` rows.
type Sums<S, const R: usize, const C: usize, const V: usize> = [[[SimdVec<S>; V]; C]; R];

impl<T: Real> StripeKernel<'_, T> {
    /// The stripe in tiles of `R` x `C` pixels.
    #[inline(always)]
    fn tiles<S: Simd<Scalar = T>, const R: usize, const C: usize, const V: usize>(mut self, simd: S) {
        const { assert!(C <= SLACK) };
        let (height, width) = (self.output.rows.len(), self.output.rows.first().map_or(0, |row| row.len()));
        for row in (0..height).step_by(R) {
            for col in (0..width).step_by(C) {
                let mut starts = [0; R];
                for r in 0..R {
                    // A tile that ends below the stripe computes its last row again.
                    let row = self.output.first_row + (row + r).min(height - 1);
                    starts[r] = row * self.pitch + col;
                }
                let sums = self.sums::<S, R, C, V>(simd, starts);
                self.store(simd, sums, row, col);
            }
        }
    }

    /// The sums over all taps, for pixels of the output to the right of those whose first input is at `starts`.
    #[inline(always)]
    fn sums<S: Simd<Scalar = T>, const R: usize, const C: usize, const V: usize>(
        &self,
        simd: S,
        starts: [usize; R],
    ) -> Sums<S, R, C, V> {
        let zero = SimdVec::broadcast(simd, T::zero());
        let mut sums = [[[zero; V]; C]; R];
        for (tap, offset) in self.taps.iter().zip(self.offsets) {
            let mut rows = [&self.input[..0]; R];
            for r in 0..R {
                rows[r] = &self.input[starts[r] + offset..][..C];
            }
            for i in 0..LANES {
                let mut weights = [zero; V];
                for v in 0..V {
                    weights[v] = SimdVec::load(simd, &tap.0[i][v * S::WIDTH..]);
                }
                for r in 0..R {
                    for c in 0..C {
                        let input = SimdVec::broadcast(simd, rows[r][c][i]);
                        for v in 0..V {
                            sums[r][c][v] = input.mul_add(weights[v], sums[r][c][v]);
                        }
                    }
                }
            }
        }
        sums
    }

    /// Writes those pixels of a tile that are inside of the stripe.
    #[inline(always)]
    fn store<S: Simd<Scalar = T>, const R: usize, const C: usize, const V: usize>(
        &mut self,
        simd: S,
        mut sums: Sums<S, R, C, V>,
        row: usize,
        col: usize,
    ) {
        if let Some(bias) = self.bias {
            let zero = SimdVec::broadcast(simd, T::zero());
            for v in 0..V {
                let bias = SimdVec::load(simd, &bias[v * S::WIDTH..]);
                for r in 0..R {
                    for c in 0..C {
                        sums[r][c][v] = (sums[r][c][v] + bias).max(zero);
                    }
                }
            }
        }
        for (sums, output) in sums.iter().zip(&mut self.output.rows[row..]) {
            for (sums, output) in sums.iter().zip(&mut output[col..]) {
                for v in 0..V {
                    sums[v].store_to(output, v * S::WIDTH);
                }
            }
        }
    }
}
