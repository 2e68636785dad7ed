//! Which pairs of views are matched.

use super::error::BundleError;
use super::network::{LEAST_ANGLE_DEG, Network};
use super::used_view::UsedView;
use crate::frame::SiteGrid;
use crate::scene::{Footprints, angle_between_deg};

/// Two views are matched when their footprints share at least this fraction of the smaller one.
const MIN_OVERLAP: f64 = 0.2;
/// Largest angle between the lines of sight of views that are matched, degrees.
const MAX_VIEW_ANGLE_DEG: f64 = 60.0;
/// Largest angle between the sun directions of views that are matched, degrees: shadows that moved make wrong matches,
/// and the season, which changes the vegetation, goes with the sun. Every view is matched with at least
/// [`NEAREST_SUNS`] others all the same, those whose suns are nearest.
const MAX_SUN_ANGLE_DEG: f64 = 20.0;
const NEAREST_SUNS: usize = 4;

/// Pairs of views whose footprints overlap at some height and whose lines of sight are at most [`MAX_VIEW_ANGLE_DEG`] apart.
///
/// # Errors
/// [`BundleError::NoOverlap`] or [`BundleError::TooOblique`] when there is none, [`BundleError::NoBaseline`] when no pair has an
/// angle wide enough to measure heights.
pub(super) fn overlapping_pairs(
    views: &[UsedView],
    network: &Network,
) -> Result<Vec<(usize, usize)>, BundleError> {
    let grid = SiteGrid::at(network.center).map_err(crate::scene::SceneError::from)?;
    let cameras = network.rpcs.iter().zip(views).map(|(rpc, view)| (*rpc, view.size())).collect();
    let footprints = Footprints::new(cameras, &grid, network.heights);
    let all = (0..views.len()).flat_map(|i| (i + 1..views.len()).map(move |j| (i, j)));
    let shares: Vec<_> =
        all.map(|(i, j)| ((i, j), footprints.shared(i, j).map_or(0.0, |s| s.of_smaller()))).collect();
    let overlapping = shares.iter().filter(|(_, share)| *share >= MIN_OVERLAP).map(|(pair, _)| *pair);
    let overlapping: Vec<(usize, usize)> = overlapping.collect();
    if overlapping.is_empty() {
        let ((i, j), share) = shares.into_iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or(((0, 0), 0.0));
        return Err(BundleError::NoOverlap {
            first: views[i].view.name.clone(),
            second: views[j].view.name.clone(),
            percent: 100.0 * share,
            needed_percent: 100.0 * MIN_OVERLAP,
            low_m: network.heights.0,
            high_m: network.heights.1,
        });
    }
    let angle = |&(i, j): &(usize, usize)| angle_between_deg(network.directions[i], network.directions[j]);
    let narrowest_deg = overlapping.iter().map(angle).fold(f64::INFINITY, f64::min);
    let pairs: Vec<(usize, usize)> =
        overlapping.into_iter().filter(|pair| angle(pair) <= MAX_VIEW_ANGLE_DEG).collect();
    if pairs.is_empty() {
        return Err(BundleError::TooOblique { most_deg: MAX_VIEW_ANGLE_DEG, narrowest_deg });
    }
    let widest_deg = pairs.iter().map(angle).fold(0.0, f64::max);
    if widest_deg < LEAST_ANGLE_DEG {
        return Err(BundleError::NoBaseline { needed_deg: LEAST_ANGLE_DEG, widest_deg });
    }
    Ok(pairs)
}

/// Pairs of views with similar sun directions; a view without a known sun counts as similar to all others.
pub(super) fn with_similar_suns(views: &[UsedView], pairs: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let direction = |v: usize| views[v].view.sun.map(|s| (s.azimuth_deg, 90.0 - s.elevation_deg));
    let apart_deg =
        |(i, j): (usize, usize)| direction(i).zip(direction(j)).map_or(0.0, |(a, b)| angle_between_deg(a, b));
    let mut by_sun = pairs.to_vec();
    by_sun.sort_by(|a, b| apart_deg(*a).total_cmp(&apart_deg(*b)));
    let mut taken = vec![0; views.len()];
    by_sun.retain(|(i, j)| {
        let is_among_nearest = taken[*i].min(taken[*j]) < NEAREST_SUNS;
        let is_kept = apart_deg((*i, *j)) <= MAX_SUN_ANGLE_DEG || is_among_nearest;
        for v in [i, j] {
            taken[*v] += usize::from(is_kept);
        }
        is_kept
    });
    by_sun.sort_unstable();
    by_sun
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Role, Sun, View};
    use std::path::PathBuf;

    #[test]
    fn pairs_with_dissimilar_suns_are_left_out_where_enough_similar_ones_exist() {
        let rpc = crate::rpc::test_camera();
        let view = |i: usize| View {
            name: format!("{i}"),
            image: PathBuf::new(),
            width: 1000,
            height: 1000,
            window: None,
            bands: vec![1],
            stretch_percent: None,
            stretch: None,
            mask: None,
            nodata: None,
            rpc: rpc.clone(),
            rpc_source: String::new(),
            // Six in the morning, six in the afternoon: 40 degrees apart.
            sun: Sun::new([100.0, 170.0][i / 6] + (i % 6) as f64, 50.0),
            acquired: None,
            role: Role::Train,
            height_range: None,
        };
        let views: Vec<View> = (0..12).map(view).collect();
        let views: Vec<UsedView> = views.iter().map(|view| UsedView { view, keypoints: &[] }).collect();
        let pairs: Vec<(usize, usize)> = (0..12).flat_map(|i| (i + 1..12).map(move |j| (i, j))).collect();
        let kept = with_similar_suns(&views, &pairs);
        assert_eq!(kept.len(), 2 * 15);
        assert!(kept.iter().all(|(i, j)| i / 6 == j / 6), "{kept:?}");
    }
}
