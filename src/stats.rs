//! Robust statistics of lists of numbers: quantiles; and what fits say about themselves.

mod fit;

pub use fit::FitQuality;

/// Factor from the median absolute deviation to the standard deviation of a normal distribution.
pub const MAD_TO_SIGMA: f64 = 1.4826;

/// The quantile of values at a share from 0 to 1, without interpolation: the value at the nearest rank. None
/// for an empty list.
#[must_use]
pub fn quantile(mut values: Vec<f64>, share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    let rank = (share * last as f64).round() as usize;
    Some(*values.select_nth_unstable_by(rank.min(last), f64::total_cmp).1)
}

/// Lowest and highest of values; none for an empty list.
#[must_use]
pub fn bounds(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    values.map(|v| (v, v)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)))
}

/// The median of values, of an even number the mean of the two in the middle. None for an empty list.
#[must_use]
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    values.sort_unstable_by(f64::total_cmp);
    Some(0.5 * (values[last / 2] + values[values.len() / 2]))
}

/// The quantile of values at a share `q` from 0 to 1, interpolated linearly between neighbours as
/// `numpy.quantile` does by default; NaN for an empty list. The values must not contain NaN.
#[must_use]
pub fn interpolated_quantile(values: &[f32], q: f64) -> f64 {
    interpolated_quantile_in_place(&mut values.to_vec(), q)
}

/// [`interpolated_quantile`] without a copy of the values, whose order changes.
pub fn interpolated_quantile_in_place(values: &mut [f32], q: f64) -> f64 {
    let Some(last) = values.len().checked_sub(1) else { return f64::NAN };
    let position = q * last as f64;
    let index = position.floor() as usize;
    let (_, &mut low, above) = values.select_nth_unstable_by(index, f32::total_cmp);
    let next = above.iter().copied().min_by(f32::total_cmp).unwrap_or(low);
    let (low, next) = (f64::from(low), f64::from(next));
    low + (next - low) * (position - index as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_an_even_number_lies_between_the_two_in_the_middle() {
        assert_eq!(median(vec![4.0, 1.0, 3.0, 9.0]), Some(3.5));
        assert_eq!(median(vec![4.0, 1.0, 9.0]), Some(4.0));
        assert_eq!(median(Vec::new()), None);
    }

    #[test]
    fn interpolated_quantiles_are_those_of_numpy() {
        let v = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(interpolated_quantile(&v, 0.5), 2.5);
        assert_eq!(interpolated_quantile(&v, 0.0), 1.0);
        assert_eq!(interpolated_quantile(&v, 1.0), 4.0);
        assert!((interpolated_quantile(&v, 0.9) - 3.7).abs() < 1e-6);
        assert!(interpolated_quantile(&[], 0.5).is_nan());
        assert_eq!(interpolated_quantile(&[-3.0], 0.5), -3.0);
    }

    #[test]
    fn interpolated_quantiles_at_ranks_are_the_sorted_values() {
        // 7919 and 1001 have no common divisor, so that every number from 0 to 1000 occurs once.
        let values: Vec<f32> = (0..1001).map(|i| (i * 7919 % 1001) as f32 - 300.5).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f32::total_cmp);
        for (k, v) in sorted.iter().enumerate() {
            assert!((interpolated_quantile(&values, k as f64 / 1000.0) - f64::from(*v)).abs() < 1e-6, "{k}");
        }
    }
}
