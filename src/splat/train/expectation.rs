//! What a scene can be expected to give, and what it takes: for a user to know before hours of work.
//!
//! Errors are those of simulated towns (docs/accuracy.md, "Few views"), in pixels of the images, so that they hold for
//! other resolutions of alike scenes; times and memory are fitted to runs on two cores (docs/performance.md).

use crate::affine::{SiteScene, SiteView};
use crate::mvs::FEW_VIEWS;
use crate::scene::Role;
use crate::splat::train::recipe::Recipe;
use crate::stats::quantile;

/// Numbers of views and the mean absolute height error that they left, pixels, by three towns of 0.5 m each.
const ERROR_PX: [(usize, f64); 5] = [(2, 2.5), (3, 1.9), (4, 1.7), (5, 1.3), (10, 1.2)];
/// Angles between two views for which the error of a pair was measured, degrees.
const MEASURED_DEG: std::ops::RangeInclusive<f64> = 10.0..=30.0;
/// The angle at which heights are best: enough base, and the views still look alike, degrees.
pub const BEST_CONVERGENCE_DEG: f64 = 20.0;
/// Seconds of one core for an iteration with a million pixels.
const ITERATION_S: f64 = 0.18;
/// Seconds of one core to match a view's million pixels.
const MATCHING_S: f64 = 12.0;
/// Memory without images, and for a million pixels of a view, gigabytes.
const BASE_GB: f64 = 0.3;
const VIEW_GB: f64 = 0.05;
/// Memory for matching and splats of a million pixels of the area, gigabytes.
const AREA_GB: f64 = 0.6;

/// Of the angles between pairs of views the one nearest to that at which heights are best; NaN without pairs.
#[must_use]
pub fn best_convergence_deg(angles: impl Iterator<Item = f64>) -> f64 {
    let off = |deg: &f64| (deg - BEST_CONVERGENCE_DEG).abs();
    angles.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(f64::NAN)
}

/// What a scene is made of.
#[derive(Clone, Copy, Debug)]
pub struct Extent {
    /// Training views.
    pub views: usize,
    /// The convergence angle of the best pair of views, degrees: [`best_convergence_deg`].
    pub convergence_deg: f64,
    /// Ground sampling distance, metres.
    pub gsd_m: f64,
    /// Area that is trained, square metres.
    pub area_m2: f64,
}

/// What can be expected of it with recipe `best`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Mean absolute error of the heights, metres.
    pub error_m: f64,
    /// Whether the angle of a pair is one for which that was measured.
    pub is_measured: bool,
    /// Minutes with so many threads.
    pub minutes: f64,
    /// Memory, gigabytes.
    pub memory_gb: f64,
}

impl Extent {
    /// Of the training views of a scene.
    #[must_use]
    pub fn of(scene: &SiteScene) -> Self {
        let views: Vec<&SiteView> = scene.views.iter().filter(|v| v.role == Role::Train).collect();
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
        let angles = pairs.map(|(a, b)| {
            let [a, b] = [a.camera.line_of_sight_slope(), b.camera.line_of_sight_slope()];
            (a[0] - b[0]).hypot(a[1] - b[1]).atan().to_degrees()
        });
        let (west, south, east, north) = scene.area;
        Self {
            views: views.len(),
            convergence_deg: best_convergence_deg(angles),
            gsd_m: quantile(views.iter().map(|v| v.camera.gsd_m()).collect(), 0.5).unwrap_or(f64::NAN),
            area_m2: (east - west) * (north - south),
        }
    }

    /// What `satgs run` can be expected to give and take with so many threads.
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
    /// The expectation in words; `threads` are those it was made for.
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

/// The table's error, between its numbers of views in proportion; that of ten for more.
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
    fn more_views_promise_more_and_take_longer() {
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
