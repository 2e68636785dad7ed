//! Scores of a registered prediction: what is left between it and the truth.

use serde::Serialize;

/// Scale from the median absolute deviation to the standard deviation of a normal distribution.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Errors over some cells of land, in metres; `e = clip(registered) - truth`.
///
/// Where nothing is predicted they are NaN, null in JSON.
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
    /// 1.4826 times the median of |e - median(e)|.
    pub nmad_m: f64,
    /// |e| that 90 % of the cells do not exceed.
    pub le90_m: f64,
    /// |e| that 95 % of the cells do not exceed.
    pub le95_m: f64,
    /// Share of cells with |e| of 0.5, 1 and 2 m at most.
    pub within: [f64; 3],
    /// Predicted cells / cells.
    pub completeness: f64,
    /// MAE over all cells, holes filled by the nearest predicted cell.
    pub filled_mae_m: f64,
    /// Cells of land.
    pub cells: usize,
    /// Cells of land that are predicted.
    pub predicted: usize,
}

/// Sizes of errors whose share is told, in metres.
const WITHIN_M: [f64; 3] = [0.5, 1.0, 2.0];

impl Scores {
    /// Scores of cells of land; each gives its error, NaN where it is not predicted, and the error once holes are
    /// filled.
    #[must_use]
    pub fn of(cells: impl Iterator<Item = (f32, f32)>) -> Self {
        let (mut errors, mut count, mut filled, mut filled_count) = (Vec::new(), 0, 0.0, 0.0);
        let (mut sum, mut absolute, mut squares, mut within) = (0.0, 0.0, 0.0, [0usize; 3]);
        for (error, filled_error) in cells {
            count += 1;
            if !error.is_nan() {
                errors.push(error);
                let e = f64::from(error);
                sum += e;
                absolute += e.abs();
                squares += e * e;
                for (n, limit) in within.iter_mut().zip(WITHIN_M) {
                    *n += usize::from(e.abs() <= limit);
                }
            }
            if !filled_error.is_nan() {
                filled += f64::from(filled_error.abs());
                filled_count += 1.0;
            }
        }
        let predicted = errors.len();
        let n = predicted as f64;
        let [median_m, le90_m, le95_m] = quantiles(&errors, f32::abs, [0.5, 0.9, 0.95]);
        Self {
            mae_m: absolute / n,
            rmse_m: (squares / n).sqrt(),
            bias_m: sum / n,
            median_m,
            nmad_m: nmad(&errors),
            le90_m,
            le95_m,
            within: within.map(|cells| cells as f64 / n),
            completeness: n / count as f64,
            filled_mae_m: filled / filled_count,
            cells: count,
            predicted,
        }
    }
}

/// The `q` quantile, linear between neighbours (numpy's default); NaN of nothing. `values` must hold no NaN.
#[must_use]
pub fn quantile(values: &[f32], q: f64) -> f64 {
    let [found] = quantiles(values, |v| v, [q]);
    found
}

/// 1.4826 times the median absolute deviation from the median.
#[must_use]
pub fn nmad(values: &[f32]) -> f64 {
    let median = quantile(values, 0.5);
    let [deviation] = quantiles(values, |v| (f64::from(v) - median).abs() as f32, [0.5]);
    MAD_TO_SIGMA * deviation
}

/// Quantiles of `of(value)`.
///
/// Values are counted by their leading bits, then sorted where a quantile lies: few passes, and no copy of them all.
fn quantiles<const N: usize>(values: &[f32], of: impl Fn(f32) -> f32, q: [f64; N]) -> [f64; N] {
    if values.is_empty() {
        return [f64::NAN; N];
    }
    let mut counts = vec![0usize; 1 << BUCKET_BITS];
    for v in values {
        counts[bucket(of(*v))] += 1;
    }
    q.map(|q| {
        let position = q * (values.len() - 1) as f64;
        let index = position.floor() as usize;
        let (mut first, mut before) = (0, 0);
        while before + counts[first] <= index {
            before += counts[first];
            first += 1;
        }
        // The next value may lie in a later bucket.
        let (mut last, mut through) = (first, before + counts[first]);
        while through < (index + 2).min(values.len()) {
            last += 1;
            through += counts[last];
        }
        let near = values.iter().map(|v| of(*v)).filter(|v| (first..=last).contains(&bucket(*v)));
        let mut near: Vec<f32> = near.collect();
        let (_, &mut low, above) = near.select_nth_unstable_by(index - before, f32::total_cmp);
        let next = above.iter().copied().min_by(f32::total_cmp).unwrap_or(low);
        let (low, next) = (f64::from(low), f64::from(next));
        low + (next - low) * (position - index as f64)
    })
}

/// Leading bits by which values are counted: 128 steps between powers of two.
const BUCKET_BITS: u32 = 16;

/// Leading bits of a number, in the order of the numbers.
fn bucket(v: f32) -> usize {
    let bits = v.to_bits();
    let ordered = if bits >> 31 == 0 { bits | 1 << 31 } else { !bits };
    (ordered >> (32 - BUCKET_BITS)) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Normal deviates by the Box-Muller transform of a counter hashed.
    fn normal(n: usize, sigma: f64) -> Vec<f32> {
        let uniform = |i: u64| {
            let mut x = i.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let pair = |i: u64| {
            (-2.0 * (1.0 - uniform(2 * i)).ln()).sqrt() * (std::f64::consts::TAU * uniform(2 * i + 1)).cos()
        };
        (0..n as u64).map(|i| (sigma * pair(i)) as f32).collect()
    }

    #[test]
    fn scores_of_normal_noise_are_those_of_the_distribution() {
        let sigma = 0.7;
        let s = Scores::of(normal(400 * 400, sigma).into_iter().map(|e| (e, e)));
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
    fn quantiles_are_numpy_s() {
        let v = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(quantile(&v, 0.5), 2.5);
        assert_eq!(quantile(&v, 0.0), 1.0);
        assert_eq!(quantile(&v, 1.0), 4.0);
        assert!((quantile(&v, 0.9) - 3.7).abs() < 1e-6);
        assert!(quantile(&[], 0.5).is_nan());
        assert_eq!(quantile(&[-3.0], 0.5), -3.0);
    }

    #[test]
    fn quantiles_are_those_of_the_sorted_values() {
        let values = normal(1001, 3.0);
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        for (k, v) in sorted.iter().enumerate() {
            assert!((quantile(&values, k as f64 / 1000.0) - f64::from(*v)).abs() < 1e-6, "{k}");
        }
    }

    #[test]
    fn holes_count_against_completeness_and_are_filled_from_beside() {
        let s = Scores::of((0..10).map(|i| if i == 9 { (f32::NAN, -1.0) } else { (0.0, 0.0) }));
        assert_eq!((s.mae_m, s.completeness, s.cells, s.predicted), (0.0, 0.9, 10, 9));
        assert!((s.filled_mae_m - 0.1).abs() < 1e-9);
    }
}
