//! Whether priors agree with the points of a scene.
//!
//! Depths are compared by Pearson's correlation of the values at the points that a view sees with their depths, or of a disparity
//! with their inverse depths: a sign that is wrong makes it negative. For normals, each axis of the prior may have either sign.
//! With `m_k` the mean over points of the product of the k-th components of both normals, the mean cosine with signs `s` is
//! `sum s_k m_k`: the best signs are those of `m_k`, and the second best choice has a mean cosine lower by twice the smallest
//! `|m_k|`.

use super::map::{DepthKind, DepthPrior, NormalPrior};
use super::seen::SeenPoint;
use crate::frame::{Point, Site};
use crate::perspective::PinholeCamera;
use glam::DVec3;

/// Fewest points of a view that say something.
pub(super) const FEWEST_POINTS: usize = 50;

/// Pearson's correlation of the values of a prior with the depths of points, of a disparity with their inverse depths; none with
/// too few points.
pub(super) fn correlation(prior: &DepthPrior, seen: &[SeenPoint]) -> Option<f64> {
    let known =
        seen.iter().map(|p| (f64::from(p.nearest(&prior.values)), p.depth)).filter(|(v, _)| v.is_finite());
    let compared = |depth: f64| if prior.kind == DepthKind::Disparity { depth.recip() } else { depth };
    let pairs: Vec<(f64, f64)> = known.map(|(value, depth)| (value, compared(depth))).collect();
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

/// Sums over the points of a view of the products of the components of both normals, in camera axes, and their number.
pub(super) fn normal_products(
    prior: &NormalPrior,
    seen: &[SeenPoint],
    points: &[Point<Site>],
    normals: &[DVec3],
    camera: &PinholeCamera,
) -> (DVec3, usize) {
    seen.iter().fold((DVec3::ZERO, 0), |(sum, count), p| {
        let [x, y, z] = prior.planes.each_ref().map(|plane| f64::from(p.nearest(plane)));
        let given = DVec3::new(x, y, z);
        let towards = camera.center - DVec3::from_array(points[p.index].xyz());
        let normal = normals[p.index] * normals[p.index].dot(towards).signum();
        let products = given * (camera.cam_from_site * normal);
        if products.is_finite() { (sum + products, count + 1) } else { (sum, count) }
    })
}
