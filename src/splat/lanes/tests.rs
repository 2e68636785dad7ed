use super::exact::Exact;
use super::registers::{Compiled, Registers};
use super::*;

struct Compare;

fn lane<L: Lanes>(row: Row<L>, k: usize) -> L::Number {
    let mut values = [L::Number::zero(); LANES];
    row.store_to(&mut values, 0);
    values[k]
}

impl Kernel<f32> for Compare {
    fn run<L: Lanes<Number = f32>>(self, lanes: L) {
        for i in -1200..1200 {
            let x = i as f32 * 0.01;
            let exact = f64::from(x).exp2();
            let power = Row::splat(lanes, x).exp2();
            assert!((f64::from(lane(power, 3)) - exact).abs() < 3e-7 * exact, "{x}");
            let y = lane(power, 5);
            let error = (f64::from(lane(power.log2(), 7)) - f64::from(y).log2()).abs();
            assert!(error < 3e-7 * f64::from(x.abs().max(1.0)), "{x}: {error:e}");
        }
        for x in [1e-6, 0.3, 2.0, 81.0, 1e5f32] {
            let root = lane(Row::splat(lanes, x).rough_sqrt(), 2);
            assert!((root - x.sqrt()).abs() < 4e-4 * x.sqrt(), "{x}: {root}");
        }
        for (x, sign) in [(1.5, 1.0), (0.0, 0.0), (-0.25, -1.0), (f32::NAN, 0.0)] {
            let row = Row::splat(lanes, x);
            assert_eq!(lane(row.sign(), 1), sign);
            assert!(x.is_nan() || lane(row.abs(), 4) == x.abs());
            let positive = row.above(Row::splat(lanes, 0.0));
            assert_eq!((lane(row.keep(positive), 3), positive.any()), (x.max(0.0), x > 0.0));
        }
        for x in [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.5, 7.999_999, 1e6 + 0.5, 4_194_303.5] {
            let whole = Row::splat(lanes, x).floor();
            assert_eq!(lane(whole, 2), x.floor());
            let mut places = [0; LANES];
            whole.store_whole(&mut places);
            assert_eq!(places[6], x as u32);
        }
    }
}

/// With the lanes at hand, AVX2's and plain numbers.
fn every_processor<K: Kernel<f32>>(kernel: impl Fn() -> K) {
    f32::dispatch(kernel());
    #[cfg(target_arch = "x86_64")]
    if let Some(s) = pulp::x86::V3::try_new() {
        s.vectorize(Compiled::<_, _, 1>(s, kernel()));
    }
    kernel().run(Registers::<_, 8>(pulp::Scalar::new()));
}

struct Rearrange;

impl Rearrange {
    /// Whole numbers, whose sums are exact in any order.
    fn sums_of<L: Lanes<Number = f32>, const C: usize>(lanes: L) {
        let values = |c: usize| std::array::from_fn::<f32, LANES, _>(|i| (100 * c + i * i) as f32);
        let sums = sum_each(std::array::from_fn::<_, C, _>(|c| Row::load(lanes, &values(c))));
        for (c, sum) in sums.into_iter().enumerate() {
            assert_eq!(sum, values(c)[..L::WIDTH].iter().sum::<f32>(), "{c} of {C}");
        }
    }
}

impl Kernel<f32> for Rearrange {
    fn run<L: Lanes<Number = f32>>(self, lanes: L) {
        Self::sums_of::<_, 1>(lanes);
        Self::sums_of::<_, 4>(lanes);
        Self::sums_of::<_, 6>(lanes);
        Self::sums_of::<_, 15>(lanes);
        let (low, high) =
            ([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], [11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0]);
        let row = Row::load_halves(lanes, &low, &high);
        let half = L::WIDTH / 2;
        assert_eq!(
            [0, half - 1, half, L::WIDTH - 1].map(|k| lane(row, k)),
            [1.0, low[half - 1], 11.0, high[half - 1]]
        );
        let mut out = [[0.0; 8]; 2];
        let [top, bottom] = &mut out;
        row.store_halves(top, bottom);
        assert_eq!([&out[0][..half], &out[1][..half]], [&low[..half], &high[..half]]);
        assert!(out.concat().iter().filter(|v| **v == 0.0).count() == 2 * (8 - half));
    }
}

#[test]
fn halves_go_where_they_came_from_and_each_row_has_its_own_sum() {
    every_processor(|| Rearrange);
}

#[test]
fn exponentials_and_logarithms_are_within_3e7_and_all_else_is_exact() {
    every_processor(|| Compare);
}

#[test]
fn slices_are_read_and_written_to_their_end() {
    let values: Vec<f64> = (0..20).map(f64::from).collect();
    let tail = Row::load_from(Exact, &values, 17);
    assert_eq!([0, 1, 2, 3].map(|k| lane(tail, k)), [17.0, 18.0, 19.0, 0.0]);
    let mut out = [0.0; 18];
    tail.store_to(&mut out, 16);
    assert_eq!(out[15..], [0.0, 17.0, 18.0]);
}
