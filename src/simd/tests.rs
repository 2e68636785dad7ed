use super::f64_array::F64Array;
use super::registers::{Compiled, Registers};
use super::*;
use num_traits::Zero;

/// Compares functions of vectors with those of the standard library.
struct Functions;

fn lane<L: Simd>(vector: SimdVec<L>, k: usize) -> L::Scalar {
    let mut values = [L::Scalar::zero(); MAX_LANES];
    vector.store_to(&mut values, 0);
    values[k]
}

impl SimdKernel<f32> for Functions {
    fn run<L: Simd<Scalar = f32>>(self, simd: L) {
        for i in -1200..1200 {
            let x = i as f32 * 0.01;
            let exact = f64::from(x).exp2();
            let power = SimdVec::broadcast(simd, x).exp2();
            assert!((f64::from(lane(power, 3)) - exact).abs() < 3e-7 * exact, "{x}");
            let y = lane(power, 5);
            let error = (f64::from(lane(power.log2(), 7)) - f64::from(y).log2()).abs();
            assert!(error < 3e-7 * f64::from(x.abs().max(1.0)), "{x}: {error:e}");
        }
        for x in [1e-6, 0.3, 2.0, 81.0, 1e5f32] {
            let root = lane(SimdVec::broadcast(simd, x).sqrt_approx(), 2);
            assert!((root - x.sqrt()).abs() < 4e-4 * x.sqrt(), "{x}: {root}");
        }
        for (x, sign) in [(1.5, 1.0), (0.0, 0.0), (-0.25, -1.0), (f32::NAN, 0.0)] {
            let vector = SimdVec::broadcast(simd, x);
            assert_eq!(lane(vector.sign(), 1), sign);
            assert!(x.is_nan() || lane(vector.abs(), 4) == x.abs());
            let positive = vector.greater_than(SimdVec::broadcast(simd, 0.0));
            assert_eq!((lane(vector.select_or_zero(positive), 3), positive.any()), (x.max(0.0), x > 0.0));
        }
        for x in [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 7.999_999, 1e6 + 0.5, 4_194_303.5] {
            let whole = SimdVec::broadcast(simd, x).floor();
            assert_eq!(lane(whole, 2), x.floor());
            let mut places = [0; MAX_LANES];
            whole.store_u32(&mut places);
            assert_eq!(places[6], x as u32);
        }
    }
}

/// Checks the indices of the true lanes of every seventh mask.
struct Compress;

impl SimdKernel<f32> for Compress {
    fn run<L: Simd<Scalar = f32>>(self, simd: L) {
        for set in (0..1u32 << L::WIDTH).step_by(7) {
            let values: [f32; MAX_LANES] = std::array::from_fn(|i| (set >> i & 1) as f32);
            let mask = SimdVec::load(simd, &values).greater_than(SimdVec::broadcast(simd, 0.0));
            let mut places = [0; MAX_LANES];
            let first = 256 - L::WIDTH as u32;
            let count = mask.compress(first as u8, &mut places);
            let listed = (0..L::WIDTH as u32).filter(|i| set >> i & 1 == 1);
            let expected: Vec<u8> = listed.map(|i| (first + i) as u8).collect();
            assert_eq!((mask.bitmask(), &places[..count]), (set, &expected[..]));
        }
    }
}

#[test]
fn compress_lists_the_true_lanes_in_order() {
    every_instruction_set(|| Compress);
}

/// Runs a kernel with the best instruction set of the processor, with AVX2 if it has that, and without SIMD
/// instructions.
fn every_instruction_set<K: SimdKernel<f32>>(kernel: impl Fn() -> K) {
    f32::dispatch(kernel());
    #[cfg(target_arch = "x86_64")]
    if let Some(s) = pulp::x86::V3::try_new() {
        s.vectorize(Compiled::<_, _, 1>(s, kernel()));
    }
    kernel().run(Registers::<_, 8>(pulp::Scalar::new()));
}

/// Compares the rearrangements of lanes with their definitions.
struct Rearrange;

impl SimdKernel<f32> for Rearrange {
    fn run<L: Simd<Scalar = f32>>(self, simd: L) {
        let values = |row: usize| std::array::from_fn::<f32, MAX_LANES, _>(|i| (100 * row + i) as f32);
        // Pixels are numbered line by line.
        let width = L::WIDTH;
        let lines = std::array::from_fn(|k| {
            let pixels = std::array::from_fn::<f32, MAX_LANES, _>(|i| (k * width + i) as f32);
            SimdVec::load(simd, &pixels)
        });
        let blocks = blocks_of_lines(lines);
        for b in 0..4 {
            for i in 0..width {
                assert_eq!(lane(blocks[b], i), (i / 4 * 16 + b * 4 + i % 4) as f32);
                assert_eq!(lane(lines_of_blocks(blocks)[b], i), lane(lines[b], i));
            }
        }

        let transposed = transpose_fours(std::array::from_fn(|j| SimdVec::load(simd, &values(j))));
        for k in 0..4 {
            for i in 0..width {
                assert_eq!(lane(transposed[k], i), values(i % 4)[i / 4 * 4 + k], "row {k}, lane {i}");
            }
        }

        let eights = |row: usize| [0, 8].map(|k| std::array::from_fn(|i| values(row)[k + i]));
        let rows = std::array::from_fn(|j| {
            let [a, b] = eights(j);
            SimdVec::load_eights(simd, [&a, &b])
        });
        let transposed = transpose_eights(rows);
        for k in 0..8 {
            let mut stored = [[0.0; 8]; 2];
            let [a, b] = &mut stored;
            transposed[k].store_eights([a, b]);
            for i in 0..MAX_LANES {
                let expected = if i < L::WIDTH { values(i % 8)[i / 8 * 8 + k] } else { 0.0 };
                assert_eq!(stored[i / 8][i % 8], expected, "row {k}, lane {i}");
            }
        }
    }
}

#[test]
fn lanes_are_rearranged_between_lines_and_blocks_and_transposed() {
    every_instruction_set(|| Rearrange);
}

#[test]
fn exponentials_and_logarithms_are_within_3e_7_and_other_functions_are_exact() {
    every_instruction_set(|| Functions);
}

#[test]
fn slices_are_read_and_written_up_to_their_end() {
    let values: Vec<f64> = (0..20).map(f64::from).collect();
    let tail = SimdVec::load_from(F64Array, &values, 17);
    assert_eq!([0, 1, 2, 3].map(|k| lane(tail, k)), [17.0, 18.0, 19.0, 0.0]);
    let mut out = [0.0; 18];
    tail.store_to(&mut out, 16);
    assert_eq!(out[15..], [0.0, 17.0, 18.0]);
}
