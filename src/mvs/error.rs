//! Why the views of a scene cannot be matched.

use super::{PARALLAX, parallax};
use crate::affine::TrainingView;

/// Why no surface can be matched.
#[derive(Debug, thiserror::Error, miette::Diagnostic)]
#[non_exhaustive]
pub enum MatchError {
    /// One view shows no heights.
    #[error("{found} training views can not be matched, at least two are needed")]
    #[diagnostic(help(
        "`test.txt` holds views back, `train.txt` lists those to train on; `--recipe baeogs` matches nothing"
    ))]
    FewViews {
        /// Training views there are.
        found: usize,
    },
    /// No two views see heights differently enough, or alike enough, to be matched.
    #[error(
        "no two training views make a stereo pair: they converge by {least_deg:.1}° to {most_deg:.1}°, where {} can be \
         matched",
        matched_angles()
    )]
    #[diagnostic(help(
        "`satgs info` lists the angles of all pairs; another view is needed, or `--recipe baeogs`, which matches nothing"
    ))]
    NoPair {
        /// The smallest angle of convergence.
        least_deg: f64,
        /// The largest.
        most_deg: f64,
    },
}

impl MatchError {
    /// What is wrong with views of which no two can be matched.
    #[must_use]
    pub fn no_pair(views: &[TrainingView]) -> Self {
        let found = views.len();
        if found < 2 {
            return Self::FewViews { found };
        }
        let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
        let angles = pairs.map(|(a, b)| parallax(a, b).atan().to_degrees());
        let (least_deg, most_deg) = angles
            .fold((f64::INFINITY, 0.0), |(least, most), deg| (f64::min(least, deg), f64::max(most, deg)));
        Self::NoPair { least_deg, most_deg }
    }
}

fn matched_angles() -> String {
    let deg = |parallax: f64| parallax.atan().to_degrees();
    format!("{:.0}° to {:.0}°", deg(PARALLAX.start), deg(PARALLAX.end))
}
