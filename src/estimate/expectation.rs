//! The height error to expect of a scene, with time and memory as a sentence.
//!
//! Errors were measured on simulated towns (docs/accuracy.md, "Few views"). They are in pixels of the images, so that they
//! apply to similar scenes at other resolutions.

use super::cost::{Cost, RunSize};
use super::machine::measured_cores;
use crate::affine::{SiteScene, SiteView};
use crate::mvs::FEW_VIEWS;
use crate::scene::Role;
use crate::splat::recipe::{OfScene, Recipe};
use crate::stats::quantile;

/// Numbers of views, and the mean absolute height error with them in pixels, averaged over three towns with pixels of
/// 0.5 m.
const ERROR_PX: [(usize, f64); 5] = [(2, 2.5), (3, 1.9), (4, 1.7), (5, 1.3), (10, 1.2)];
/// Convergence angles for which the error of a pair was measured, degrees.
const MEASURED_DEG: std::ops::RangeInclusive<f64> = 10.0..=30.0;
/// Area of a tile with its overlap and margins, as a multiple of its core.
const TILE_AND_MARGINS: f64 = 1.7;
/// Time with all threads, seconds, below which the machine is not measured.
const SMALL_S: f64 = 30.0;
/// The convergence angle with the best heights, degrees: the base is long enough, and the images are still similar.
pub const BEST_CONVERGENCE_DEG: f64 = 20.0;
/// The convergence angle, of those of all pairs of views, that is nearest to [`BEST_CONVERGENCE_DEG`]; NaN without pairs.
#[must_use]
pub fn best_convergence_deg(angles: impl Iterator<Item = f64>) -> f64 {
    let off = |deg: &f64| (deg - BEST_CONVERGENCE_DEG).abs();
    angles.min_by(|a, b| off(a).total_cmp(&off(b))).unwrap_or(f64::NAN)
}

/// How a scene was imaged.
#[derive(Clone, Copy, Debug)]
pub struct Imaging {
    /// Number of training views.
    pub views: usize,
    /// The convergence angle of the best pair of views, degrees: [`best_convergence_deg`].
    pub convergence_deg: f64,
    /// Median ground sampling distance of the training views, metres.
    pub gsd_m: f64,
}

/// The error to expect of the heights of a scene with recipe `best`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expectation {
    /// Mean absolute height error, metres.
    pub error_m: f64,
    /// Whether the error was measured for this convergence angle; always true for more than two views.
    pub is_measured: bool,
}

impl Imaging {
    /// How the training views of a scene see it.
    #[must_use]
    pub fn of(scene: &SiteScene) -> Self {
        let views: Vec<&SiteView> = scene.views.iter().filter(|v| v.role == Role::Train).collect();
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
        let angles = pairs.map(|(a, b)| a.camera.parallax(&b.camera).atan().to_degrees());
        Self {
            views: views.len(),
            convergence_deg: best_convergence_deg(angles),
            gsd_m: quantile(views.iter().map(|v| v.camera.gsd_m()).collect(), 0.5).unwrap_or(f64::NAN),
        }
    }

    /// The size of a run of an area of this size by a recipe, whose views show all of it; `height_m` is the range of heights,
    /// and `cell_m` the size of the cells of its surface model, metres.
    #[must_use]
    pub fn run_size(
        &self,
        recipe: &Recipe<impl OfScene>,
        area_m2: f64,
        height_m: f64,
        cell_m: f64,
    ) -> RunSize {
        RunSize {
            area_m2,
            surface_cells: area_m2 / cell_m.powi(2),
            height_m,
            gsd_m: self.gsd_m,
            views: self.views,
            pixels: (self.views as f64 * area_m2 / self.gsd_m.powi(2)) as usize,
            iterations: recipe.clone().for_views(self.views).iterations,
        }
    }

    /// The cost of an area that is trained in so many tiles of these sides, metres, one after the other; otherwise as
    /// [`Imaging::run_size`].
    #[must_use]
    pub fn cost(
        &self,
        recipe: &Recipe<impl OfScene>,
        (tiles, sides_m): (usize, [f64; 2]),
        height_m: f64,
        cell_m: f64,
    ) -> Cost {
        let larger = if tiles > 1 { TILE_AND_MARGINS } else { 1.0 };
        let area_m2 = larger * sides_m[0] * sides_m[1];
        let Cost { core_seconds, memory_mb } = self.run_size(recipe, area_m2, height_m, cell_m).cost();
        Cost { core_seconds: core_seconds * tiles as f64, memory_mb }
    }

    /// The error to expect.
    #[must_use]
    pub fn expectation(&self) -> Expectation {
        Expectation {
            error_m: error_px(self.views) * self.gsd_m,
            is_measured: self.views > 2 || MEASURED_DEG.contains(&self.convergence_deg),
        }
    }

    /// The error, time and memory to expect of a run on this machine, as a sentence; a cost that is not small is divided by the
    /// measured speed of the machine ([`measured_cores`]).
    #[must_use]
    pub fn text(&self, cost: Cost) -> String {
        let (Expectation { error_m, is_measured }, views) = (self.expectation(), self.views);
        let error = if is_measured {
            format!(
                "a mean height error of about {error_m:.1} m for a town that changes little, as simulated"
            )
        } else {
            let (low, high) = (MEASURED_DEG.start(), MEASURED_DEG.end());
            format!(
                "the error of a pair that converges by {:.1}° was not measured: {low:.0}° to {high:.0}° are good",
                self.convergence_deg
            )
        };
        let threads = rayon::current_num_threads();
        let time = match cost.core_seconds / threads as f64 {
            small if small < SMALL_S => "less than a minute".into(),
            _ => {
                let cores = measured_cores().unwrap_or(threads as f64);
                match (cost.core_seconds / cores / 60.0).round() {
                    few if few <= 1.0 => "about a minute".into(),
                    minutes => format!("about {minutes:.0} minutes"),
                }
            }
        };
        let gigabytes = cost.memory_mb / 1e3;
        let mut out = format!(
            "expected of recipe `best` with {views} views: {error}; {time} with {threads} threads, {gigabytes:.1} GB of memory"
        );
        if views <= FEW_VIEWS {
            out += "; what no two views show is filled in and has 0 views in confidence.tif";
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
        let recipe = Recipe::named("best").unwrap();
        let of = |views: usize| {
            let imaging = Imaging { views, convergence_deg: 18.0, gsd_m: 0.5 };
            (
                imaging.expectation().error_m,
                imaging.run_size(&recipe, 250_000.0, 60.0, 0.5).cost().core_seconds,
            )
        };
        let all = [2, 3, 4, 6, 8, 12].map(of);
        for pair in all.windows(2) {
            assert!(pair[1].0 <= pair[0].0 && pair[1].1 >= pair[0].1, "{pair:?}");
        }
        assert!((error_px(7) - (1.3 - 0.1 * 2.0 / 5.0)).abs() < 1e-12 && error_px(30) == error_px(10));
        let narrow = Imaging { views: 2, convergence_deg: 5.0, gsd_m: 0.5 };
        assert!(!narrow.expectation().is_measured);
    }
}
