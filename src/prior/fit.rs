//! The scale and shift that bring the values of a prior to known ones (IndoorSplat, equation 9), without outliers.
//!
//! `s` and `t` minimise the sum of `(s x + t - y)^2` over pairs of a prior's value `x` and a known `y`. Pairs farther away than
//! three standard deviations, estimated as 1.4826 times the median of the absolute residuals, are left out, and the rest is fitted
//! again until they stay the same. Where all `x` are nearly equal, scale and shift cannot be told apart: then `t` is zero.

use crate::stats::quantile;

/// Most rounds of leaving out pairs.
const MOST_ROUNDS: usize = 10;
/// Pairs farther away than this many standard deviations are left out.
const DEVIATIONS: f64 = 3.0;
/// Standard deviation of a normal distribution over the median of absolute values.
const OF_MEDIAN: f64 = 1.4826;
/// Least share of the pairs that must stay.
const LEAST_INLIERS: f64 = 0.5;
/// Least difference of the greatest and the smallest `x`, as a share of the mean, with which a shift is fitted.
const LEAST_SPREAD: f64 = 0.02;

/// A fit of `y = scale x + shift`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Alignment {
    pub scale: f64,
    pub shift: f64,
    /// Median of the absolute residuals, as a share of the median of `y`.
    pub residual: f64,
}

impl Alignment {
    /// Of values that need none.
    pub const IDENTITY: Self = Self { scale: 1.0, shift: 0.0, residual: 0.0 };

    pub fn apply(&self, x: f64) -> f64 {
        self.scale * x + self.shift
    }

    /// The map from `y` to `x`. The residual stays a share of the median of what was fitted.
    pub fn inverse(&self) -> Self {
        Self { scale: self.scale.recip(), shift: -self.shift / self.scale, residual: self.residual }
    }
}

/// Fits pairs (x, y); none if the fit has no positive scale or leaves out more than half of the pairs.
pub(super) fn align(pairs: &[(f64, f64)]) -> Option<Alignment> {
    let mut kept = pairs.to_vec();
    let mut fitted = least_squares(&kept)?;
    for _ in 0..MOST_ROUNDS {
        let residual = |(x, y): &(f64, f64)| (fitted.0 * x + fitted.1 - y).abs();
        let deviation = OF_MEDIAN * quantile(kept.iter().map(residual).collect(), 0.5)?;
        let inliers: Vec<_> =
            pairs.iter().filter(|pair| residual(pair) <= DEVIATIONS * deviation).copied().collect();
        if inliers == kept || deviation == 0.0 {
            break;
        }
        kept = inliers;
        fitted = least_squares(&kept)?;
    }
    let (scale, shift) = fitted;
    let residual = quantile(kept.iter().map(|(x, y)| (scale * x + shift - y).abs()).collect(), 0.5)?
        / quantile(kept.iter().map(|(_, y)| *y).collect(), 0.5)?;
    let is_good = scale > 0.0 && kept.len() as f64 >= LEAST_INLIERS * pairs.len() as f64;
    is_good.then_some(Alignment { scale, shift, residual })
}

/// Whether values are so nearly equal that they tell no scale.
pub(super) fn is_level(values: impl Iterator<Item = f64> + Clone) -> bool {
    let (low, high) = values.clone().fold((f64::MAX, f64::MIN), |range, x| (range.0.min(x), range.1.max(x)));
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    high - low < LEAST_SPREAD * (sum / count).abs()
}

/// Scale and shift.
fn least_squares(pairs: &[(f64, f64)]) -> Option<(f64, f64)> {
    let n = pairs.len() as f64;
    let mean = pairs.iter().fold((0.0, 0.0), |sum, (x, y)| (sum.0 + x / n, sum.1 + y / n));
    let sum = |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|(x, y)| of(*x, *y)).sum::<f64>();
    let fitted = if is_level(pairs.iter().map(|pair| pair.0)) {
        (sum(&|x, y| x * y) / sum(&|x, _| x * x), 0.0)
    } else {
        let scale = sum(&|x, y| (x - mean.0) * (y - mean.1)) / sum(&|x, _| (x - mean.0).powi(2));
        (scale, mean.1 - scale * mean.0)
    };
    (fitted.0.is_finite() && fitted.1.is_finite()).then_some(fitted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    #[test]
    fn scale_and_shift_are_found_among_a_fifth_of_outliers() {
        let pair = |i: u64| {
            let mut draw = CounterRng::new(1, 0, 0, i);
            let x = 1.0 + 3.0 * draw.uniform();
            let y = 0.7 * x + 0.4 + 0.005 * draw.normal();
            (x, if i.is_multiple_of(5) { y + 1.0 + draw.uniform() } else { y })
        };
        let found = align(&(0..200).map(pair).collect::<Vec<_>>()).unwrap();
        assert!(
            (found.scale / 0.7 - 1.0).abs() < 0.01 && (found.shift / 0.4 - 1.0).abs() < 0.01,
            "{found:?}"
        );
        assert!(found.residual < 0.004);
    }

    #[test]
    fn values_that_are_nearly_equal_are_scaled_only() {
        let pairs: Vec<_> = (0..50).map(|i| (2.0 + 1e-4 * f64::from(i % 7), 3.0)).collect();
        let found = align(&pairs).unwrap();
        assert!(found.shift == 0.0 && (found.scale - 1.5).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn values_that_do_not_follow_are_refused() {
        let fall: Vec<_> = (0..50).map(|i| (1.0 + f64::from(i), 100.0 - f64::from(i))).collect();
        assert_eq!(align(&fall), None);
        assert_eq!(align(&[]), None);
    }
}
