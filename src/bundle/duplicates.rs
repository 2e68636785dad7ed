//! Tracks that observe the same point: features that matches did not join, whose patches are measured at the same places.
//! They would count as independent observations, which they are not.

use super::problem::{Observation, Track};
use crate::frame::Pixel;
use std::collections::{BTreeMap, HashMap};

/// Observations of a view that are no farther apart are the same, pixels: a third of the standard deviation of one.
const SAME_PX: f64 = 0.1;
/// Tracks are of the same point if they coincide in all views that both have, and in so many: two rays determine a point. Where one of
/// them lies elsewhere, it was measured independently.
const SAME_VIEWS: usize = 2;

/// Merges the tracks that observe the same point: of each group the one with the largest sum of weights stays, with the mean of
/// the group's observations in each view. Returns the indices of the tracks that stay, in their order. Ground
/// control is not merged.
pub(super) fn merge_duplicates(tracks: &mut Vec<Track>) -> Vec<usize> {
    let mut first: Vec<usize> = (0..tracks.len()).collect();
    for ((a, b), views) in coincidences(tracks) {
        if views >= SAME_VIEWS && views == common_views(&tracks[a], &tracks[b]) {
            let (a, b) = (root(&first, a), root(&first, b));
            first[a.max(b)] = a.min(b);
        }
    }
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for i in 0..tracks.len() {
        groups.entry(root(&first, i)).or_default().push(i);
    }
    let mut kept: Vec<usize> = Vec::with_capacity(groups.len());
    for group in groups.into_values() {
        let weight = |i: &usize| tracks[*i].observations.iter().map(|m| m.weight).sum::<f64>();
        // The first of those with the largest weight.
        let best = group.iter().copied().reduce(|best, i| if weight(&i) > weight(&best) { i } else { best });
        let Some(best) = best else { continue };
        if group.len() > 1 {
            tracks[best].observations = joined(group.iter().flat_map(|i| &tracks[*i].observations));
        }
        kept.push(best);
    }
    kept.sort_unstable();
    let mut is_kept = vec![false; tracks.len()];
    kept.iter().for_each(|i| is_kept[*i] = true);
    let mut of_track = is_kept.into_iter();
    tracks.retain(|_| of_track.next().unwrap_or(true));
    kept
}

/// One observation a view, in the order of the views: the weighted mean of the places, and the largest weight.
fn joined<'a>(observations: impl Iterator<Item = &'a Observation>) -> Vec<Observation> {
    let mut by_view: BTreeMap<usize, Vec<&Observation>> = BTreeMap::new();
    observations.for_each(|m| by_view.entry(m.view).or_default().push(m));
    let one = |(view, all): (usize, Vec<&Observation>)| {
        let sum = |value: fn(&Observation) -> f64| all.iter().map(|m| m.weight * value(m)).sum::<f64>();
        let total = sum(|_| 1.0);
        let px = Pixel::new(sum(|m| m.px.col) / total, sum(|m| m.px.row) / total);
        Observation { view, px, weight: all.iter().map(|m| m.weight).fold(0.0, f64::max) }
    };
    by_view.into_iter().map(one).collect()
}

/// In how many views both tracks have observations.
fn common_views(a: &Track, b: &Track) -> usize {
    a.observations.iter().filter(|m| b.observations.iter().any(|o| o.view == m.view)).count()
}

/// In how many views two tracks, by their indices in ascending order, have observations at the same place.
fn coincidences(tracks: &[Track]) -> BTreeMap<(usize, usize), usize> {
    type Place = (usize, i64, i64);
    let mut seen: HashMap<Place, Vec<(usize, Observation)>> = HashMap::new();
    let mut counts = BTreeMap::new();
    for (i, track) in tracks.iter().enumerate().filter(|(_, track)| track.prior.is_none()) {
        for m in &track.observations {
            let [col, row] = [m.px.col, m.px.row].map(|v| (v / SAME_PX).floor() as i64);
            for (d_col, d_row) in (-1..=1).flat_map(|c| (-1..=1).map(move |r| (c, r))) {
                for (other, o) in seen.get(&(m.view, col + d_col, row + d_row)).into_iter().flatten() {
                    let apart_px = (o.px.col - m.px.col).hypot(o.px.row - m.px.row);
                    if apart_px <= SAME_PX && *other != i {
                        *counts.entry((*other, i)).or_insert(0) += 1;
                    }
                }
            }
            seen.entry((m.view, col, row)).or_default().push((i, *m));
        }
    }
    counts
}

fn root(first: &[usize], mut i: usize) -> usize {
    while first[i] != i {
        i = first[i];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(observations: &[(usize, f64, f64)]) -> Track {
        let observation = |(view, col, row): &(usize, f64, f64)| Observation {
            view: *view,
            px: Pixel::new(*col, *row),
            weight: 1.0,
        };
        Track { observations: observations.iter().map(observation).collect(), ..Track::default() }
    }

    #[test]
    fn tracks_that_coincide_in_two_views_become_one_with_the_views_of_both() {
        let mut tracks = vec![
            track(&[(0, 10.0, 20.0), (1, 30.0, 40.0)]),
            // Another point that one view shows at the same place.
            track(&[(0, 10.0, 20.0), (2, 70.0, 40.0)]),
            track(&[(0, 10.06, 20.0), (1, 30.0, 39.94), (3, 5.0, 6.0)]),
            track(&[(0, 10.2, 20.0), (1, 30.0, 40.2)]),
        ];
        assert_eq!(merge_duplicates(&mut tracks), [1, 2, 3]);
        let views = |track: &Track| track.observations.iter().map(|m| m.view).collect::<Vec<_>>();
        assert_eq!(tracks.iter().map(views).collect::<Vec<_>>(), [vec![0, 2], vec![0, 1, 3], vec![0, 1]]);
        assert!((tracks[1].observations[0].px.col - 10.03).abs() < 1e-9, "the mean of both");
        assert_eq!(merge_duplicates(&mut tracks), [0, 1, 2], "nothing is left to merge");
    }

    #[test]
    fn tracks_that_coincide_one_after_another_become_one() {
        let mut tracks = vec![
            track(&[(0, 1.0, 1.0), (1, 2.0, 2.0), (4, 3.0, 3.0)]),
            track(&[(0, 1.02, 1.0), (1, 2.0, 2.03)]),
            track(&[(1, 2.0, 2.02), (4, 3.05, 3.0), (2, 8.0, 8.0)]),
        ];
        assert_eq!(merge_duplicates(&mut tracks), [0]);
        let views: Vec<usize> = tracks[0].observations.iter().map(|m| m.view).collect();
        assert_eq!(views, [0, 1, 2, 4]);
    }
}
