//! Tracks: sets of keypoints, at most one per view, that matches join to one point on the ground.

use super::matching::Match;

/// A keypoint of a view as part of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrackElement {
    /// Index of the view.
    pub view: u32,
    /// Index of its keypoint.
    pub keypoint: u32,
}

/// Joins the matches of all pairs into tracks, in the order of decreasing similarity. A match that would give a track
/// two keypoints of the same view is dropped.
///
/// `keypoints` is the number of keypoints of each view. Tracks are ordered by their first element.
#[must_use]
pub fn build(keypoints: &[usize], pairs: &[((usize, usize), Vec<Match>)]) -> Vec<Vec<TrackElement>> {
    let mut starts = vec![0usize];
    for n in keypoints {
        starts.push(starts[starts.len() - 1] + n);
    }
    let total = starts[keypoints.len()];
    let mut links: Vec<(f32, usize, usize)> = pairs
        .iter()
        .flat_map(|((i, j), matches)| {
            let (i, j) = (starts[*i], starts[*j]);
            matches.iter().map(move |m| (m.similarity, i + m.a as usize, j + m.b as usize))
        })
        .collect();
    links.sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));

    let view_of = |id: usize| starts.partition_point(|s| *s <= id) as u32 - 1;
    let mut parent: Vec<usize> = (0..total).collect();
    // Views of the track of each root, sorted.
    let mut views: Vec<Vec<u32>> = (0..total).map(|id| vec![view_of(id)]).collect();
    for (_, a, b) in links {
        let (a, b) = (root(&mut parent, a), root(&mut parent, b));
        if a == b || views[a].iter().any(|v| views[b].binary_search(v).is_ok()) {
            continue;
        }
        let (keep, drop) = (a.min(b), a.max(b));
        parent[drop] = keep;
        let mut joined = std::mem::take(&mut views[drop]);
        joined.append(&mut views[keep]);
        joined.sort_unstable();
        views[keep] = joined;
    }

    let mut track_of = vec![usize::MAX; total];
    let mut tracks: Vec<Vec<TrackElement>> = Vec::new();
    for id in 0..total {
        let r = root(&mut parent, id);
        if views[r].len() < 2 {
            continue;
        }
        if track_of[r] == usize::MAX {
            track_of[r] = tracks.len();
            tracks.push(Vec::new());
        }
        let view = view_of(id);
        let keypoint = (id - starts[view as usize]) as u32;
        tracks[track_of[r]].push(TrackElement { view, keypoint });
    }
    tracks
}

fn root(parent: &mut [usize], mut id: usize) -> usize {
    while parent[id] != id {
        parent[id] = parent[parent[id]];
        id = parent[id];
    }
    id
}

/// Groups of views that tracks connect, the largest group first. A track is the indices of its views.
#[must_use]
pub fn components<T: Iterator<Item = usize>>(
    views: usize,
    tracks: impl Iterator<Item = T>,
) -> Vec<Vec<usize>> {
    let mut parent: Vec<usize> = (0..views).collect();
    for mut track in tracks {
        let Some(first) = track.next() else { continue };
        for view in track {
            let (a, b) = (root(&mut parent, first), root(&mut parent, view));
            parent[a.max(b)] = a.min(b);
        }
    }
    let mut groups = vec![Vec::new(); views];
    for v in 0..views {
        groups[root(&mut parent, v)].push(v);
    }
    groups.retain(|g| !g.is_empty());
    groups.sort_by_key(|g| std::cmp::Reverse(g.len()));
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(a: u32, b: u32, similarity: f32) -> Match {
        Match { a, b, similarity }
    }

    #[test]
    fn matches_join_to_tracks_and_a_conflict_drops_the_weaker_match() {
        // Keypoint 0 of view 0 matches keypoint 1 of view 1, which matches keypoint 2 of view 2; a weaker match joins
        // keypoint 0 of view 2 too.
        let pairs = vec![
            ((0, 1), vec![link(0, 1, 0.95)]),
            ((1, 2), vec![link(1, 2, 0.9)]),
            ((0, 2), vec![link(0, 0, 0.7)]),
        ];
        let tracks = build(&[3, 3, 3], &pairs);
        let o = |view, keypoint| TrackElement { view, keypoint };
        assert_eq!(tracks, vec![vec![o(0, 0), o(1, 1), o(2, 2)]]);
    }

    #[test]
    fn the_first_keypoint_of_the_first_view_is_like_any_other() {
        let tracks = build(&[1, 1], &[((0, 1), vec![link(0, 0, 0.9)])]);
        assert_eq!(tracks.len(), 1);
    }

    #[test]
    fn views_without_common_tracks_are_components_of_their_own() {
        assert_eq!(
            components(3, [[0, 2]].map(<[usize; 2]>::into_iter).into_iter()),
            vec![vec![0, 2], vec![1]]
        );
    }
}
