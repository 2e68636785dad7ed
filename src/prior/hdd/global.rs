//! The fit of one scale and one shift to a whole view.

use super::super::fit::{Alignment, align};
use crate::random::CounterRng;
use crate::stats::quantile;

/// Number of pairs of points that are tried.
const DRAWS: u64 = 500;
/// A pair agrees if it is off by at most this share of the median known value.
const AGREES: f64 = 0.1;
/// Purpose of the random numbers.
const DRAW_PAIR: u64 = 22;

/// Fits pairs (value of the prior, known value): by least squares to the largest set that agrees with a line through two of them
/// (RANSAC), because outliers are often all too far or all too near; of all pairs if there is no such set with half of them. None
/// if fewer than half of the pairs agree or the scale is not positive.
///
/// It is the prior that errs, so the sum of squares is of its values. The sum for known values, as equation 1 of the paper has it, is
/// least for too small a scale: what is far becomes too near, above all walls that have no points of their own.
pub(super) fn global_fit(pairs: &[(f64, f64)]) -> Option<Alignment> {
    let prior_of_known =
        |pairs: &[(f64, f64)]| align(&pairs.iter().map(|(x, y)| (*y, *x)).collect::<Vec<_>>());
    let fitted = agreeing(pairs).and_then(|set| prior_of_known(&set)).or_else(|| prior_of_known(pairs))?;
    Some(fitted.inverse())
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

    #[test]
    fn errors_of_the_prior_do_not_make_the_scale_smaller() {
        let pair = |i: u64| {
            let mut draw = CounterRng::new(5, 0, 0, i);
            let known = 0.4 + 0.2 * draw.uniform();
            (2.0 * known + 0.1 + 0.04 * draw.normal(), known)
        };
        let found = global_fit(&(0..3000).map(pair).collect::<Vec<_>>()).unwrap();
        assert!((found.scale / 0.5 - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.apply(1.1) - 0.5).abs() < 2e-3, "{found:?}");
    }
}
