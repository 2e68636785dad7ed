//! Which pairs of views can be matched.

use crate::affine::TrainingView;
use crate::fault::ErrorKind;
use crate::io::WriteError;
use crate::progress::Interrupted;
use std::ops::Range;

/// Parallaxes (ground displacement per metre of height, see
/// [`ViewCamera::parallax`](crate::affine::ViewCamera::parallax)) of views that can be matched. With less, the heights
/// are too uncertain; with more, the views see different walls.
const PARALLAX: Range<f64> = 0.08..0.9;
/// Parallaxes that are matched where no two views have a better one.
const POSSIBLE_PARALLAX: Range<f64> = 0.05..1.6;
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
        angles(&POSSIBLE_PARALLAX)
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
    /// What is matched could not be stored.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Write(#[from] WriteError),
    /// The caller's [`Progress`](crate::progress::Progress) asked to stop.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Interrupted(#[from] Interrupted),
}

impl MatchError {
    /// Whose fault the failure is.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::FewViews { .. } | Self::NoPair { .. } => ErrorKind::Input,
            Self::Write(e) => e.kind(),
            Self::Interrupted(_) => ErrorKind::Interrupted,
        }
    }

    /// The error for views of which no two can be matched.
    #[must_use]
    pub fn no_pair(views: &[TrainingView]) -> Self {
        let found = views.len();
        if found < 2 {
            return Self::FewViews { found };
        }
        let (least_deg, most_deg) = extreme_angles(parallaxes(views));
        Self::NoPair { least_deg, most_deg }
    }
}

/// A warning if no two views have a good angle, so that pairs are matched whose angle is only possible.
#[must_use]
pub fn angle_warning(views: &[TrainingView]) -> Option<String> {
    if parallaxes(views).any(|parallax| PARALLAX.contains(&parallax)) {
        return None;
    }
    let (least_deg, most_deg) = extreme_angles(parallaxes(views).filter(|p| POSSIBLE_PARALLAX.contains(p)));
    (least_deg <= most_deg).then(|| {
        format!(
            "the views that are matched differ by {least_deg:.1}° to {most_deg:.1}° in direction; with {} heights are more exact and \
             more cells are confirmed",
            angles(&PARALLAX)
        )
    })
}

/// The parallaxes of all pairs of views.
fn parallaxes(views: &[TrainingView]) -> impl Iterator<Item = f64> + '_ {
    let pairs = views.iter().enumerate().flat_map(|(i, a)| views[i + 1..].iter().map(move |b| (a, b)));
    pairs.map(|(a, b)| a.camera.parallax(&b.camera))
}

/// The smallest and the largest angle of convergence of some parallaxes, degrees.
fn extreme_angles(parallaxes: impl Iterator<Item = f64>) -> (f64, f64) {
    let none = (f64::INFINITY, 0.0);
    parallaxes
        .map(|parallax| parallax.atan().to_degrees())
        .fold(none, |(least, most), deg| (f64::min(least, deg), f64::max(most, deg)))
}

/// A range of parallaxes as angles of convergence, for messages.
fn angles(parallax: &Range<f64>) -> String {
    let deg = |parallax: f64| parallax.atan().to_degrees();
    format!("{:.0}° to {:.0}°", deg(parallax.start), deg(parallax.end))
}

/// Pairs of views (indices) whose parallax is within [`PARALLAX`], or at least possible if there is none. Pairs with similar
/// suns are preferred, because their shadows fall alike.
pub(super) fn stereo_pairs(views: &[TrainingView]) -> Vec<(usize, usize)> {
    let good = pairs_within(&PARALLAX, views);
    if good.is_empty() { pairs_within(&POSSIBLE_PARALLAX, views) } else { good }
}

fn pairs_within(range: &Range<f64>, views: &[TrainingView]) -> Vec<(usize, usize)> {
    let sun = |i: usize| views[i].sun_shear.map(|s| views[i].camera.sheared(s));
    let mut rated = Vec::new();
    for i in 0..views.len() {
        for j in i + 1..views.len() {
            let parallax = views[i].camera.parallax(&views[j].camera);
            if range.contains(&parallax) {
                let suns = sun(i).zip(sun(j)).map_or(0.0, |(a, b)| a.parallax(&b));
                rated.push((suns + PARALLAX_WEIGHT * (parallax - BEST_PARALLAX).abs(), i, j));
            }
        }
    }
    rated.sort_by(|a, b| a.0.total_cmp(&b.0));
    rated.truncate(PAIRS_PER_VIEW * views.len());
    rated.into_iter().map(|(_, i, j)| (i, j)).collect()
}
