//! Which pairs of views can be matched.

use crate::affine::TrainingView;
use std::ops::Range;

/// Parallaxes (ground displacement per metre of height, see
/// [`ViewCamera::parallax`](crate::affine::ViewCamera::parallax)) of views that can be matched. With less, the heights
/// are too uncertain; with more, the views see different walls.
pub const PARALLAX: Range<f64> = 0.08..0.9;
/// The preferred parallax, and the weight of a deviation from it against a difference between the suns of two views.
const BEST_PARALLAX: f64 = 0.35;
const PARALLAX_WEIGHT: f64 = 0.1;
/// Number of pairs that are matched, as a multiple of the number of views.
const PAIRS_PER_VIEW: usize = 4;

/// Why no surface can be matched.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum MatchError {
    /// A single view does not determine heights.
    #[error("matching needs at least two training views, found {found}")]
    #[diagnostic(help(
        "`test.txt` holds views back and `train.txt` lists those to train on; `--recipe baeogs` trains without matching"
    ))]
    FewViews {
        /// Number of training views.
        found: usize,
    },
    /// The angles between the views are too small or too large for matching.
    #[error(
        "no two training views make a stereo pair: the angles between their lines of sight are {least_deg:.1}° to \
         {most_deg:.1}°, and {} can be matched",
        matched_angles()
    )]
    #[diagnostic(help(
        "`satgs info` lists the angles of all pairs; add a view, or use `--recipe baeogs`, which trains without matching"
    ))]
    NoPair {
        /// The smallest angle of convergence, degrees.
        least_deg: f64,
        /// The largest angle of convergence, degrees.
        most_deg: f64,
    },
}

impl MatchError {
    /// The error for views of which no two can be matched.
    #[must_use]
    pub fn no_pair(views: &[TrainingView]) -> Self {
        let found = views.len();
        if found < 2 {
            return Self::FewViews { found };
        }
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
        let angles = pairs.map(|(a, b)| a.camera.parallax(&b.camera).atan().to_degrees());
        let (least_deg, most_deg) = angles
            .fold((f64::INFINITY, 0.0), |(least, most), deg| (f64::min(least, deg), f64::max(most, deg)));
        Self::NoPair { least_deg, most_deg }
    }
}

/// [`PARALLAX`] as a range of angles of convergence, for messages.
fn matched_angles() -> String {
    let deg = |parallax: f64| parallax.atan().to_degrees();
    format!("{:.0}° to {:.0}°", deg(PARALLAX.start), deg(PARALLAX.end))
}

/// Pairs of views (indices) whose parallax is within [`PARALLAX`]. Pairs with similar suns are preferred,
/// because their shadows fall alike.
pub(super) fn stereo_pairs(views: &[TrainingView]) -> Vec<(usize, usize)> {
    let sun = |i: usize| views[i].sun_shear.map(|s| views[i].camera.sheared(s));
    let mut rated = Vec::new();
    for i in 0..views.len() {
        for j in i + 1..views.len() {
            let parallax = views[i].camera.parallax(&views[j].camera);
            if PARALLAX.contains(&parallax) {
                let suns = sun(i).zip(sun(j)).map_or(0.0, |(a, b)| a.parallax(&b));
                rated.push((suns + PARALLAX_WEIGHT * (parallax - BEST_PARALLAX).abs(), i, j));
            }
        }
    }
    rated.sort_by(|a, b| a.0.total_cmp(&b.0));
    rated.truncate(PAIRS_PER_VIEW * views.len());
    rated.into_iter().map(|(_, i, j)| (i, j)).collect()
}
