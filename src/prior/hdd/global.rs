//! The fit of one scale and one shift to a whole view.

use super::super::fit::{Alignment, align, is_level};
use crate::random::CounterRng;
use crate::stats::quantile;

/// Number of pairs of points that are tried.
const DRAWS: u64 = 500;
/// A pair agrees if it is off by at most this share of the median known value.
const AGREES: f64 = 0.1;
/// Least share of the variance of known values that the prior explains (squared correlation) if it alone is taken to err.
const SHARED_VARIANCE: f64 = 0.5;
/// Purpose of the random numbers.
const DRAW_PAIR: u64 = 22;

/// Fits pairs (value of the prior, known value): by least squares to the largest set that agrees with a line through two of them
/// (RANSAC), because outliers are often all too far or all too near; of all pairs if there is no such set with half of them. None
/// if fewer than half of the pairs agree or the scale is not positive.
pub(super) fn global_fit(pairs: &[(f64, f64)]) -> Option<Alignment> {
    agreeing(pairs).and_then(|set| fit_of_set(&set)).or_else(|| fit_of_set(pairs))
}

/// The fit by least squares. It is the prior that errs, so the sum of squares is of its values. The sum for known values, as equation 1 of the paper has it, is
/// least for too small a scale: what is far becomes too near, above all walls that have no points of their own. But where prior and
/// known values have little in common, the scale for its values is without bound, and that for known values is taken.
fn fit_of_set(pairs: &[(f64, f64)]) -> Option<Alignment> {
    let for_known = align(pairs)?;
    let swapped: Vec<(f64, f64)> = pairs.iter().map(|(x, y)| (*y, *x)).collect();
    let for_prior = align(&swapped).filter(|fit| {
        let has_spread = |pairs: &[(f64, f64)]| !is_level(pairs.iter().map(|pair| pair.0));
        has_spread(pairs) && has_spread(&swapped) && fit.scale * for_known.scale > SHARED_VARIANCE
    });
    Some(for_prior.map_or(for_known, |fit| fit.inverse()))
}

/// The largest set of pairs that agree with a rising line through two of them; none if it has fewer than half of all.
fn agreeing(pairs: &[(f64, f64)]) -> Option<Vec<(f64, f64)>> {
    let limit = AGREES * quantile(pairs.iter().map(|(_, y)| y.abs()).collect(), 0.5)?;
    let set = |draw: u64| {
        let mut rng = CounterRng::new(0, DRAW_PAIR, 0, draw);
        let (a, b) = (pairs[rng.below(pairs.len())], pairs[rng.below(pairs.len())]);
        let scale = (b.1 - a.1) / (b.0 - a.0);
        let agrees = |(x, y): &&(f64, f64)| (a.1 + scale * (x - a.0) - y).abs() <= limit;
        (scale > 0.0).then(|| pairs.iter().filter(agrees).copied().collect::<Vec<_>>())
    };
    let best = (0..DRAWS).filter_map(set).max_by_key(Vec::len)?;
    (2 * best.len() >= pairs.len()).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::Range;

    /// Known values in a range, and of each a value of the prior.
    fn pairs(known: Range<f64>, prior: impl Fn(f64, &mut CounterRng) -> f64) -> Vec<(f64, f64)> {
        let pair = |i: u64| {
            let mut draw = CounterRng::new(5, 0, 0, i);
            let known = known.start + (known.end - known.start) * draw.uniform();
            (prior(known, &mut draw), known)
        };
        (0..3000).map(pair).collect()
    }

    #[test]
    fn errors_of_the_prior_do_not_make_the_scale_smaller() {
        let pairs = pairs(0.4..0.6, |known, draw| 2.0 * known + 0.1 + 0.04 * draw.normal());
        let found = global_fit(&pairs).unwrap();
        assert!((found.scale / 0.5 - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.apply(1.1) - 0.5).abs() < 2e-3, "{found:?}");
    }

    #[test]
    fn a_prior_that_says_nothing_gives_the_mean_of_the_known_values() {
        let level = global_fit(&pairs(2.0..6.0, |_, _| 1.0)).unwrap();
        assert!((level.apply(1.0) - 4.0).abs() < 0.2, "{level:?}");
        // Nearly independent of the known values.
        let weak = pairs(2.0..6.0, |known, draw| 10.0 + 0.05 * known + draw.normal());
        let found = fit_of_set(&weak).unwrap();
        assert_eq!(Some(found), align(&weak));
        assert!([8.0, 12.0].iter().all(|x| (2.0..6.0).contains(&found.apply(*x))), "{found:?}");
    }

    #[test]
    fn the_scale_of_a_level_scene_is_not_that_of_the_errors() {
        let level = pairs(99.5..100.5, |known, draw| 0.5 + 0.05 * (known - 100.0) + 0.1 * draw.normal());
        let found = global_fit(&level).unwrap();
        assert!([0.2, 0.8].iter().all(|x| (found.apply(*x) - 100.0).abs() < 2.0), "{found:?}");
    }
}
