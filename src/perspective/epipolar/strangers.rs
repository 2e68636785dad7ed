//! Views that fit the poses of other views.

use super::super::pose::Pose;
use super::features::ViewFeatures;
use super::matched_pair::MatchedPair;

/// Largest number of views that are tried at each other's poses.
const MOST: usize = 8;
/// Number of views near a pose with which an image is compared that may belong there.
const COMPARED: usize = 3;

/// What is known of all views.
pub(super) struct Views<'a> {
    pub(super) features: &'a [Option<ViewFeatures>],
    pub(super) poses: &'a [Pose],
    /// Whether a reconstruction says which of its points the view shows.
    pub(super) is_reconstructed: &'a [bool],
    /// Views beside each one, the best first.
    pub(super) neighbours: &'a [Vec<usize>],
}

impl Views<'_> {
    /// Whether the image of view `i` fits the pose of view `at`, by views that are not in doubt.
    fn fits_at(&self, i: usize, at: usize, doubted: &[usize]) -> bool {
        let beside = self.neighbours[at].iter().filter(|k| !doubted.contains(k) && **k != i).take(COMPARED);
        let agrees = |k: &usize| {
            let features = [self.features[i].as_ref()?, self.features[*k].as_ref()?];
            let pair = MatchedPair::of(features, [i, *k])?;
            Some(pair.agrees(pair.residual_px([&self.poses[at], &self.poses[*k]])?))
        };
        let found: Vec<bool> = beside.filter_map(agrees).collect();
        !found.is_empty() && 2 * found.iter().filter(|agrees| **agrees).count() > found.len()
    }

    /// Pairs of doubted views of which each fits the pose of the other.
    pub(super) fn exchanged(&self, doubted: &[usize]) -> Vec<[usize; 2]> {
        let some = &doubted[..doubted.len().min(MOST)];
        let pairs = (0..some.len()).flat_map(|a| (a + 1..some.len()).map(move |b| [some[a], some[b]]));
        let exchanged = pairs.filter(|[a, b]| self.fits_at(*a, *b, doubted) && self.fits_at(*b, *a, doubted));
        exchanged.map(|[a, b]| [a.min(b), a.max(b)]).collect()
    }
}
