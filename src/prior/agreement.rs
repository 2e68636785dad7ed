//! Whether priors agree with the points of a scene.
//!
//! Depths are compared by Pearson's correlation of the values at the points that a view sees with their depths, or of a disparity
//! with their inverse depths: a sign that is wrong makes it negative. For normals, each axis of the prior may have either sign: the
//! mean cosine is highest with the signs of the sums of the products of the k-th components of both normals. Such a sum, divided by
//! the root of the product of the sums of squares, is the agreement along the axis: near 1 or -1 for normals of the scene, near 0
//! for others, also along an axis in which few normals have large components.

use super::map::{DepthPrior, NormalPrior};
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

/// Smallest agreement along an axis, in absolute value, of normals that are of the scene.
const LEAST_AGREEMENT: f64 = 0.4;
/// Mean square of the components of the points' normals along an axis below which nothing can be told along it: they are errors
/// of the normals. Below `SURE_MEAN_SQUARE` they may be, and disagreement says nothing.
const LEAST_MEAN_SQUARE: f64 = 0.01;
const SURE_MEAN_SQUARE: f64 = 0.1;

/// Sums over points of the products of the components of two normals, in camera axes.
#[derive(Clone, Copy, Default)]
pub(super) struct NormalProducts {
    /// Of the prior's and the point's.
    mixed: DVec3,
    /// Of the prior's with themselves.
    prior: DVec3,
    /// Of the points' with themselves.
    points: DVec3,
    /// Number of points.
    pub count: usize,
}

impl NormalProducts {
    /// The sums over the points of both.
    pub fn with(self, more: Self) -> Self {
        Self {
            mixed: self.mixed + more.mixed,
            prior: self.prior + more.prior,
            points: self.points + more.points,
            count: self.count + more.count,
        }
    }

    /// The signs of the axes of the prior, positive where nothing can be told.
    ///
    /// # Errors
    /// The number of an axis along which the normals do not agree, and the agreement along it.
    pub fn signs(self) -> Result<[f32; 3], (usize, f64)> {
        let mut signs = [1.0; 3];
        for (k, sign) in signs.iter_mut().enumerate() {
            let norm = (self.prior[k] * self.points[k]).sqrt();
            let agreement = if norm > 0.0 { self.mixed[k] / norm } else { 0.0 };
            let mean_square = self.points[k] / self.count.max(1) as f64;
            if agreement.abs() >= LEAST_AGREEMENT && mean_square >= LEAST_MEAN_SQUARE {
                *sign = agreement.signum() as f32;
            } else if mean_square >= SURE_MEAN_SQUARE {
                return Err((k, agreement));
            }
        }
        Ok(signs)
    }
}

/// The products of the normals that a prior and the points of the scene have at the points that a view sees.
pub(super) fn normal_products(
    prior: &NormalPrior,
    seen: &[SeenPoint],
    points: &[Point<Site>],
    normals: &[DVec3],
    camera: &PinholeCamera,
) -> NormalProducts {
    seen.iter().fold(NormalProducts::default(), |sums, p| {
        let [x, y, z] = prior.planes.each_ref().map(|plane| f64::from(p.nearest(plane)));
        let given = DVec3::new(x, y, z);
        let towards = camera.center - DVec3::from_array(points[p.index].xyz());
        let normal = normals[p.index] * normals[p.index].dot(towards).signum();
        let own = camera.cam_from_site * normal;
        let products =
            NormalProducts { mixed: given * own, prior: given * given, points: own * own, count: 1 };
        if products.mixed.is_finite() { sums.with(products) } else { sums }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::CounterRng;

    /// Products of normals of points with those of a prior, which has errors of 6 degrees and is `seen` in another way.
    fn products(normal: impl Fn(u64) -> DVec3, seen: impl Fn(DVec3) -> DVec3) -> NormalProducts {
        let error = |k| DVec3::from_array(CounterRng::new(5, 0, 0, k).direction()) * 0.1;
        (0..400).fold(NormalProducts::default(), |sums, k| {
            let (given, own) = (seen(normal(k)) + error(k), normal(k) + error(k + 1000));
            sums.with(NormalProducts {
                mixed: given * own,
                prior: given * given,
                points: own * own,
                count: 1,
            })
        })
    }

    fn of_room(k: u64) -> DVec3 {
        let walls = [DVec3::X, DVec3::NEG_X, DVec3::Z, DVec3::NEG_Z];
        walls[k as usize % 4]
    }

    #[test]
    fn signs_are_found_and_an_axis_without_components_keeps_its_own() {
        assert_eq!(products(of_room, |n| n).signs(), Ok([1.0; 3]));
        assert_eq!(products(of_room, |n| n * DVec3::new(-1.0, 1.0, -1.0)).signs(), Ok([-1.0, 1.0, -1.0]));
        assert_eq!(
            products(|_| DVec3::NEG_Z, |n| n).signs(),
            Ok([1.0; 3]),
            "a level scene from straight above"
        );
    }

    #[test]
    fn normals_of_another_scene_are_refused() {
        let (axis, agreement) = products(of_room, |n| DVec3::new(n.z, n.y, n.x)).signs().unwrap_err();
        assert!(axis == 0 && agreement.abs() < 0.2, "{axis} {agreement}");
    }
}
