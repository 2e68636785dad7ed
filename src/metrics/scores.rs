//! Scores of a registered prediction: statistics of its errors against the truth.

use crate::io::Grid2;
use crate::stats::MAD_TO_SIGMA;
use rayon::prelude::*;
use serde::Serialize;

/// Statistics of the errors over some cells of land, in metres; an error is `e = clip(registered) - truth`.
///
/// Without predicted cells they are NaN, which is null in JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// Mean of |e|.
    pub mae_m: f64,
    /// Root of the mean of e².
    pub rmse_m: f64,
    /// Mean of e.
    pub bias_m: f64,
    /// Median of |e|.
    pub median_m: f64,
    /// Normalised median absolute deviation: 1.4826 times the median of |e - median(e)|.
    pub nmad_m: f64,
    /// |e| that 90 % of the cells do not exceed.
    pub le90_m: f64,
    /// |e| that 95 % of the cells do not exceed.
    pub le95_m: f64,
    /// Fractions of the cells with |e| of at most 0.5, 1 and 2 m.
    pub within: [f64; 3],
    /// Completeness: predicted cells divided by all cells.
    pub completeness: f64,
    /// MAE over all cells after holes are filled with the nearest predicted cell.
    pub filled_mae_m: f64,
    /// Number of cells of land.
    pub cells: usize,
    /// Number of cells of land that are predicted.
    pub predicted: usize,
}

/// Limits of [`Scores::within`], metres.
const WITHIN_M: [f32; 3] = [0.5, 1.0, 2.0];

/// Number of cells that are sorted together; it must not depend on the number of threads.
pub(super) const PIECE: usize = 1 << 20;

impl Scores {
    /// Scores of all land: errors are NaN where they are not known, before and after holes are filled.
    pub(super) fn of_land(land: &Grid2, errors: &Grid2, without_holes: &Grid2) -> Self {
        let of_piece = |first: usize| {
            let mut sample = Sample::default();
            for i in (first..(first + PIECE).min(land.data.len())).filter(|i| !land.data[*i].is_nan()) {
                sample.add(errors.data[i], without_holes.data[i]);
            }
            sample.sort();
            sample
        };
        let pieces: Vec<Sample> = (0..land.data.len()).into_par_iter().step_by(PIECE).map(of_piece).collect();
        Self::of(&pieces.iter().collect::<Vec<_>>())
    }

    /// Scores of all cells of some samples.
    pub(super) fn of(samples: &[&Sample]) -> Self {
        let total = |of: fn(&Sample) -> f64| samples.iter().map(|s| of(s)).sum::<f64>();
        let count = |of: fn(&Sample) -> usize| samples.iter().map(|s| of(s)).sum::<usize>();
        let predicted = count(|s| s.errors.len());
        let n = predicted as f64;
        let up_to = |limit: f32| samples.iter().map(|s| s.errors.partition_point(|e| *e <= limit)).sum();
        let median = quantile_of(0.5, predicted, up_to);
        let deviation = |centre: f64, q: f64| {
            let within = |limit: f32| samples.iter().map(|s| s.within(centre, limit)).sum();
            quantile_of(q, predicted, within)
        };
        Self {
            mae_m: total(|s| s.absolute) / n,
            rmse_m: (total(|s| s.squares) / n).sqrt(),
            bias_m: total(|s| s.sum) / n,
            median_m: deviation(0.0, 0.5),
            nmad_m: MAD_TO_SIGMA * deviation(median, 0.5),
            le90_m: deviation(0.0, 0.9),
            le95_m: deviation(0.0, 0.95),
            within: WITHIN_M.map(|m| samples.iter().map(|s| s.within(0.0, m)).sum::<usize>() as f64 / n),
            completeness: n / count(|s| s.cells) as f64,
            filled_mae_m: total(|s| s.filled) / count(|s| s.filled_cells) as f64,
            cells: count(|s| s.cells),
            predicted,
        }
    }
}

/// The sorted errors of some cells of land, from which quantiles of several samples together are found by bisection.
#[derive(Clone, Default)]
pub(super) struct Sample {
    cells: usize,
    errors: Vec<f32>,
    sum: f64,
    absolute: f64,
    squares: f64,
    filled: f64,
    filled_cells: usize,
}

impl Sample {
    /// Adds a cell: its error, NaN where it is not predicted, and its error after holes are filled.
    pub(super) fn add(&mut self, error: f32, filled: f32) {
        self.cells += 1;
        if !error.is_nan() {
            self.errors.push(error);
            let e = f64::from(error);
            self.sum += e;
            self.absolute += e.abs();
            self.squares += e * e;
        }
        if !filled.is_nan() {
            self.filled += f64::from(filled.abs());
            self.filled_cells += 1;
        }
    }

    /// Sorts the errors; to be called after the last [`Sample::add`].
    pub(super) fn sort(&mut self) {
        self.errors.sort_unstable_by(f32::total_cmp);
    }

    /// Number of errors that differ from `centre` by at most `limit`.
    fn within(&self, centre: f64, limit: f32) -> usize {
        let distance = |e: f32| (f64::from(e) - centre).abs() as f32;
        let is_below = |e: f32| f64::from(e) < centre;
        let end = self.errors.partition_point(|e| is_below(*e) || distance(*e) <= limit);
        end - self.errors.partition_point(|e| is_below(*e) && distance(*e) > limit)
    }
}

/// The `q` quantile, interpolated between neighbours, of `n` numbers; `up_to` gives how many of them do not exceed a
/// limit.
fn quantile_of(q: f64, n: usize, up_to: impl Fn(f32) -> usize) -> f64 {
    let nth = |index: usize| {
        // The smallest number, in the order of all numbers, that enough others do not exceed.
        let (mut low, mut high) = (0, u32::MAX);
        while low < high {
            let middle = low + (high - low) / 2;
            if up_to(number(middle)) > index { high = middle } else { low = middle + 1 }
        }
        f64::from(number(low))
    };
    let Some(last) = n.checked_sub(1) else { return f64::NAN };
    let position = q * last as f64;
    let index = position.floor() as usize;
    let (low, next) = (nth(index), nth((index + 1).min(last)));
    low + (next - low) * (position - index as f64)
}

/// The f32 of a rank in the total order of all f32 values.
fn number(place: u32) -> f32 {
    f32::from_bits(if place >> 31 == 1 { place ^ 1 << 31 } else { !place })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;
    use crate::stats::interpolated_quantile;

    /// Normal deviates with a standard deviation.
    fn normal(n: usize, sigma: f64) -> Vec<f32> {
        (0..n as u64).map(|i| (sigma * CounterRng::new(0, 0, 0, i).normal()) as f32).collect()
    }

    fn sample(cells: impl Iterator<Item = (f32, f32)>) -> Sample {
        let mut sample = Sample::default();
        cells.for_each(|(error, filled)| sample.add(error, filled));
        sample.sort();
        sample
    }

    #[test]
    fn scores_of_normal_noise_are_those_of_the_distribution() {
        let sigma = 0.7;
        let errors = normal(400 * 400, sigma);
        let s = Scores::of(&[&sample(errors.iter().map(|e| (*e, *e)))]);
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        near(s.nmad_m, sigma);
        near(s.rmse_m, sigma);
        near(s.mae_m, sigma * (2.0 / std::f64::consts::PI).sqrt());
        near(s.le90_m, sigma * 1.644_854);
        near(s.le95_m, sigma * 1.959_964);
        near(s.median_m, sigma * 0.674_49);
        // erf(limit / (sigma √2))
        near(s.within[0], 0.524_95);
        near(s.within[1], 0.846_87);
        near(s.within[2], 0.995_73);
        assert!(s.bias_m.abs() < 0.01);
        assert_eq!((s.completeness, s.cells, s.predicted), (1.0, 160_000, 160_000));
        assert_eq!(s.filled_mae_m, s.mae_m);
    }

    #[test]
    fn several_samples_are_scored_as_one() {
        let values = normal(4001, 2.0);
        let (left, right) = values.split_at(1234);
        let of = |values: &[f32]| sample(values.iter().map(|e| (*e, *e)));
        let (parts, whole) = (Scores::of(&[&of(left), &of(right)]), Scores::of(&[&of(&values)]));
        let median = interpolated_quantile(&values, 0.5);
        let deviations: Vec<f32> = values.iter().map(|v| (f64::from(*v) - median).abs() as f32).collect();
        assert_eq!(parts.nmad_m, MAD_TO_SIGMA * interpolated_quantile(&deviations, 0.5));
        assert_eq!((parts.le95_m, parts.within, parts.cells), (whole.le95_m, whole.within, whole.cells));
        assert!((parts.rmse_m - whole.rmse_m).abs() < 1e-12);
        let mut sizes: Vec<f32> = values.iter().map(|e| e.abs()).collect();
        sizes.sort_by(f32::total_cmp);
        assert_eq!((parts.median_m, parts.le90_m), (f64::from(sizes[2000]), f64::from(sizes[3600])));
    }

    #[test]
    fn holes_count_against_completeness_and_are_filled_from_beside() {
        let s = Scores::of(&[&sample((0..10).map(|i| if i == 9 { (f32::NAN, -1.0) } else { (0.0, 0.0) }))]);
        assert_eq!((s.mae_m, s.completeness, s.cells, s.predicted), (0.0, 0.9, 10, 9));
        assert!((s.filled_mae_m - 0.1).abs() < 1e-9);
    }
}
