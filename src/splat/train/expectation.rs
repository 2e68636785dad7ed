//! The height error, time and memory to expect of a scene, before it is processed.
//!
//! Errors were measured on simulated towns (docs/accuracy.md, "Few views"). They are in pixels of the images, so that they
//! apply to similar scenes at other resolutions. Times and memory are fitted to runs on two cores (docs/performance.md).

use crate::affine::{SiteScene, SiteView};
use crate::mvs::FEW_VIEWS;
use crate::scene::Role;
use crate::splat::recipe::Recipe;
use crate::stats::quantile;

/// Numbers of views, and the mean absolute height error with them in pixels, averaged over three towns with pixels of
/// 0.5 m.
const ERROR_PX: [(usize, f64); 5] = [(2, 2.5), (3, 1.9), (4, 1.7), (5, 1.3), (10, 1.2)];
/// Convergence angles for which the error of a pair was measured, degrees.
const MEASURED_DEG: std::ops::RangeInclusive<f64> = 10.0..=30.0;
/// The convergence angle with the best heights, degrees: the base is long enough, and the images are still similar.
pub const BEST_CONVERGENCE_DEG: f64 = 20.0;
/// Seconds of one core for an iteration with a view of a million pixels.
const ITERATION_S: f64 = 0.18;
/// Seconds of one core for the dense matching of a view of a million pixels.
const MATCHING_S: f64 = 12.0;
/// Memory without images, and for a million pixels of each view, gigabytes.
const BASE_GB: f64 = 0.3;
const VIEW_GB: f64 = 0.05;
/// Memory of dense matching and splats for an area of a million pixels, gigabytes.
const AREA_GB: f64 = 0.6;

/// The convergence angle, of those of all pairs of views, that is nearest to [`BEST_CONVERGENCE_DEG`]; NaN without pairs.
#[must_use]
pub fn best_convergence_deg(angles: impl Iterator<Item = f64>) -> f64 {
    let off = |deg: &f64| (deg - BEST_CONVERGENCE_DEG).abs();
    angles.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(f64::NAN)
}

/// The size of a scene.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Number of training views.
    pub views: usize,
    /// The convergence angle of the best pair of views, degrees: [`best_convergence_deg`].
    pub convergence_deg: f64,
    /// Median ground sampling distance of the training views, metres.
    pub gsd_m: f64,
    /// Area of the scene, square metres.
    pub area_m2: f64,
}

/// What to expect of a scene with recipe `best`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Mean absolute height error, metres.
    pub error_m: f64,
    /// Whether the error was measured for this convergence angle; always true for more than two views.
    pub is_measured: bool,
    /// Minutes with the given number of threads.
    pub minutes: f64,
    /// Memory, gigabytes.
    pub memory_gb: f64,
}

impl Extent {
    /// The extent of a scene with its training views.
    #[must_use]
    pub fn of(scene: &SiteScene) -> Self {
        let views: Vec<&SiteView> = scene.views.iter().filter(|v| v.role == Role::Train).collect();
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
        let angles = pairs.map(|(a, b)| a.camera.parallax(&b.camera).atan().to_degrees());
        let (west, south, east, north) = scene.area;
        Self {
            views: views.len(),
            convergence_deg: best_convergence_deg(angles),
            gsd_m: quantile(views.iter().map(|v| v.camera.gsd_m()).collect(), 0.5).unwrap_or(f64::NAN),
            area_m2: (east - west) * (north - south),
        }
    }

    /// What to expect of `satgs run` with this number of threads.
    #[must_use]
    pub fn expectation(&self, recipe: &Recipe, threads: usize) -> Expectation {
        let megapixels = self.area_m2 / self.gsd_m.powi(2) / 1e6;
        let iterations = f64::from(recipe.clone().for_views(self.views).iterations);
        let core_s = megapixels * (iterations * ITERATION_S + self.views as f64 * MATCHING_S);
        Expectation {
            error_m: error_px(self.views) * self.gsd_m,
            is_measured: self.views > 2 || MEASURED_DEG.contains(&self.convergence_deg),
            minutes: core_s / threads.max(1) as f64 / 60.0,
            memory_gb: BASE_GB + megapixels * (AREA_GB + VIEW_GB * self.views as f64),
        }
    }
}

impl Expectation {
    /// The expectation as a sentence; `threads` is the number that it was computed for.
    #[must_use]
    pub fn text(&self, extent: &Extent, threads: usize) -> String {
        let Self { error_m, minutes, memory_gb, .. } = self;
        let views = extent.views;
        let error = if self.is_measured {
            format!(
                "a mean height error of about {error_m:.1} m for a town that changes little, as simulated"
            )
        } else {
            let (low, high) = (MEASURED_DEG.start(), MEASURED_DEG.end());
            format!(
                "the error of a pair that converges by {:.1}° was not measured: {low:.0}° to {high:.0}° are good",
                extent.convergence_deg
            )
        };
        let time =
            if *minutes < 1.0 { "less than a minute".into() } else { format!("about {minutes:.0} minutes") };
        let mut out = format!(
            "expected of recipe `best` with {views} views: {error}; {time} with {threads} threads, {memory_gb:.1} GB of memory"
        );
        if views <= FEW_VIEWS {
            out += "; what no two views show is filled from around and has 0 views in confidence.tif";
        }
        out
    }
}

/// Error in pixels, interpolated linearly in [`ERROR_PX`]; that of ten views for more.
fn error_px(views: usize) -> f64 {
    let last = ERROR_PX[ERROR_PX.len() - 1].1;
    let pair = ERROR_PX.windows(2).find(|pair| views <= pair[1].0);
    pair.map_or(last, |pair| {
        let [(low, from), (high, to)] = [pair[0], pair[1]];
        from + (to - from) * (views.max(low) - low) as f64 / (high - low) as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn with_more_views_the_expected_error_falls_and_the_time_rises() {
        let of = |views: usize| {
            let extent = Extent { views, convergence_deg: 18.0, gsd_m: 0.5, area_m2: 250_000.0 };
            extent.expectation(&Recipe::named("best").unwrap(), 2)
        };
        let all = [2, 3, 4, 6, 8, 12].map(of);
        for pair in all.windows(2) {
            assert!(pair[1].error_m <= pair[0].error_m && pair[1].minutes >= pair[0].minutes, "{pair:?}");
        }
        assert!((error_px(7) - (1.3 - 0.1 * 2.0 / 5.0)).abs() < 1e-12 && error_px(30) == error_px(10));
        let narrow = Extent { views: 2, convergence_deg: 5.0, gsd_m: 0.5, area_m2: 1.0 };
        assert!(!narrow.expectation(&Recipe::named("best").unwrap(), 2).is_measured);
    }
}
