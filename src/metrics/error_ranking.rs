//! How well expected errors predict where a surface model is wrong.

use crate::io::Grid2;
use rayon::prelude::*;
use serde::Serialize;

/// Errors above this are large, metres.
const LARGE_M: f32 = 2.0;
/// Share of the cells among which large errors should be.
const LEAST_SURE: f64 = 0.2;
/// Fewer cells rank nothing.
const LEAST_CELLS: usize = 100;

/// Expected errors compared with the true ones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorRanking {
    /// Spearman's rank correlation of expected and true absolute errors.
    pub rank_correlation: f64,
    /// Share of the errors above 2 m that lie on the fifth of the cells with the largest expected errors; none without
    /// such errors.
    pub large_in_least_sure_fifth: Option<f64>,
    /// Mean of the expected errors, metres.
    pub expected_mae_m: f64,
    /// Number of cells.
    pub cells: usize,
}

impl ErrorRanking {
    /// Compares expected with true errors, both in metres on one grid; cells where one is NaN are left out. `None` for
    /// too few cells, and if all expected errors or all true ones are equal.
    #[must_use]
    pub fn of(expected: &Grid2, errors: &Grid2) -> Option<Self> {
        let both = expected.data.iter().zip(&errors.data).map(|(e, t)| (*e, t.abs()));
        let (expected, errors): (Vec<f32>, Vec<f32>) =
            both.filter(|(e, t)| !e.is_nan() && !t.is_nan()).unzip();
        let cells = expected.len();
        if cells < LEAST_CELLS {
            return None;
        }
        let (order, by_error) = (Order::of(&expected), Order::of(&errors).ranks());
        let by_expected = order.ranks();
        let middle = 0.5 * (cells as f64 - 1.0);
        let sum =
            |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - middle) * (b - middle)).sum::<f64>();
        let norm = (sum(&by_expected, &by_expected) * sum(&by_error, &by_error)).sqrt();
        let is_large = |i: &usize| errors[*i] > LARGE_M;
        let large = (0..cells).filter(is_large).count();
        let share = order.shares_of_last((1.0 - LEAST_SURE) * cells as f64);
        let found: f64 = (0..cells).filter(is_large).map(|i| share[i]).sum();
        (norm > 0.0).then(|| Self {
            rank_correlation: sum(&by_expected, &by_error) / norm,
            large_in_least_sure_fifth: (large > 0).then(|| found / large as f64),
            expected_mae_m: expected.iter().map(|e| f64::from(*e)).sum::<f64>() / cells as f64,
            cells,
        })
    }
}

/// Values in ascending order.
struct Order<'a> {
    values: &'a [f32],
    indices: Vec<usize>,
}

impl<'a> Order<'a> {
    fn of(values: &'a [f32]) -> Self {
        let mut indices: Vec<usize> = (0..values.len()).collect();
        indices.par_sort_unstable_by(|a, b| values[*a].total_cmp(&values[*b]));
        Self { values, indices }
    }

    /// A number for each value, by the first rank of those that are equal to it and by how many these are.
    fn of_equal(&self, number: impl Fn(f64, f64) -> f64) -> Vec<f64> {
        let mut out = vec![0.0; self.values.len()];
        let mut from = 0;
        for equal in self.indices.chunk_by(|a, b| self.values[*a] == self.values[*b]) {
            let number = number(from as f64, equal.len() as f64);
            equal.iter().for_each(|i| out[*i] = number);
            from += equal.len();
        }
        out
    }

    /// The rank of each value, from 0; equal values share the mean of their ranks.
    fn ranks(&self) -> Vec<f64> {
        self.of_equal(|from, count| from + 0.5 * (count - 1.0))
    }

    /// For each value, the share of it that lies among those of rank `first` and above; equal values share alike.
    fn shares_of_last(&self, first: f64) -> Vec<f64> {
        self.of_equal(|from, count| ((from + count - first) / count).clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn raster(of_cell: impl Fn(usize) -> f32) -> Grid2 {
        Grid2 { width: 100, height: 10, data: (0..1000).map(of_cell).collect() }
    }

    #[test]
    fn equal_values_share_the_mean_of_their_ranks() {
        assert_eq!(Order::of(&[3.0, 1.0, 3.0, 0.5]).ranks(), [2.5, 1.0, 2.5, 0.0]);
    }

    #[test]
    fn of_equal_expected_errors_a_part_is_among_the_largest() {
        let expected = raster(|i| if i < 300 { 5.0 } else { 0.0 });
        let errors = raster(|i| if i < 30 { 4.0 } else { 0.1 * (i % 7) as f32 });
        let share = ErrorRanking::of(&expected, &errors).unwrap().large_in_least_sure_fifth.unwrap();
        assert!((share - 2.0 / 3.0).abs() < 1e-9, "{share}");
    }

    #[test]
    fn expected_errors_in_the_order_of_the_true_ones_correlate_fully() {
        // A tenth of the errors is above 2 m, half of them below zero.
        let errors = raster(|i| if i % 2 == 0 { 1.0 } else { -1.0 } * i as f32 / 450.0);
        let right = ErrorRanking::of(&raster(|i| (i as f32).sqrt()), &errors).unwrap();
        assert!((right.rank_correlation - 1.0).abs() < 1e-12);
        assert_eq!(right.large_in_least_sure_fifth, Some(1.0));
        let wrong = ErrorRanking::of(&raster(|i| -(i as f32)), &errors).unwrap();
        assert!((wrong.rank_correlation + 1.0).abs() < 1e-12);
        assert_eq!(wrong.large_in_least_sure_fifth, Some(0.0));
    }

    #[test]
    fn equal_errors_and_unknown_ones_rank_nothing() {
        assert_eq!(ErrorRanking::of(&raster(|_| 0.1), &raster(|i| i as f32)), None);
        assert_eq!(ErrorRanking::of(&raster(|_| f32::NAN), &raster(|i| i as f32)), None);
    }
}
