//! Whether depths of priors agree with the points of a scene.
//!
//! They are compared by Pearson's correlation of the values at the points that a view sees with their depths, or of a disparity
//! with their inverse depths: a sign that is wrong makes it negative.

use super::map::DepthPrior;
use super::seen::SeenPoint;

/// Fewest points of a view that say something.
pub(super) const FEWEST_POINTS: usize = 50;

/// Pearson's correlation of the values of a prior with the depths of points, of a disparity with their inverse depths; none with
/// too few points.
pub(super) fn correlation(prior: &DepthPrior, seen: &[SeenPoint]) -> Option<f64> {
    let known =
        seen.iter().map(|p| (f64::from(p.nearest(&prior.values)), p.depth)).filter(|(v, _)| v.is_finite());
    let pairs: Vec<(f64, f64)> = known.map(|(value, depth)| (value, prior.kind.of_depth(depth))).collect();
    if pairs.len() < FEWEST_POINTS {
        return None;
    }
    let n = pairs.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (x, y) = (mean(|p| p.0), mean(|p| p.1));
    let sum = |of: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| of(p.0 - x, p.1 - y)).sum::<f64>();
    let norm = (sum(&|a, _| a * a) * sum(&|_, b| b * b)).sqrt();
    (norm > 0.0).then(|| sum(&|a, b| a * b) / norm)
}
