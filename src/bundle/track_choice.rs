//! Which tracks of a cell are kept: few, spread over the cell, of all views, with small residuals.

use super::problem::SIGMA_PX;

/// Number of squares along each side of a cell over which tracks are spread.
const SQUARES: usize = 5;

/// A track that may be kept.
pub(super) struct Candidate {
    /// Position in the cell: each coordinate is in [0, 1).
    pub(super) position: [f64; 2],
    /// Index and weight of each of its observations' views.
    pub(super) views: Vec<(usize, f64)>,
    /// Root mean square residual of its observations, pixels.
    pub(super) rms_px: f64,
}

/// Indices of at most `most` tracks, in increasing order.
///
/// The squares of the cell take turns, and each gives the track that adds most. An observation counts the less, the more
/// observations of its view are chosen already, so that tracks of many views come first, and views with few tracks are
/// not passed over.
pub(super) fn choose(candidates: &[Candidate], most: usize) -> Vec<usize> {
    let mut squares = vec![Vec::new(); SQUARES * SQUARES];
    for (i, candidate) in candidates.iter().enumerate() {
        let [column, row] = candidate.position.map(|p| ((p * SQUARES as f64) as usize).min(SQUARES - 1));
        squares[row * SQUARES + column].push(i);
    }
    let views = candidates.iter().flat_map(|c| &c.views).map(|v| v.0 + 1).max().unwrap_or(0);
    let mut chosen_of_view = vec![0.0; views];
    let mut chosen = Vec::new();
    while squares.iter().any(|square| !square.is_empty()) {
        for square in squares.iter_mut().filter(|square| !square.is_empty()) {
            if chosen.len() == most {
                chosen.sort_unstable();
                return chosen;
            }
            let gain = |i: usize| {
                let Candidate { views, rms_px, .. } = &candidates[i];
                let observed: f64 =
                    views.iter().map(|(v, weight): &(usize, f64)| weight / (1.0 + chosen_of_view[*v])).sum();
                observed / (1.0 + (rms_px / SIGMA_PX).powi(2))
            };
            // Of equal ones the first.
            let gains = square.iter().map(|i| gain(*i)).enumerate();
            let best = gains.reduce(|a, b| if b.1 > a.1 { b } else { a }).map_or(0, |b| b.0);
            let i = square.remove(best);
            candidates[i].views.iter().for_each(|(v, _)| chosen_of_view[*v] += 1.0);
            chosen.push(i);
        }
    }
    chosen.sort_unstable();
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(position: [f64; 2], views: &[usize], rms_px: f64) -> Candidate {
        Candidate { position, views: views.iter().map(|v| (*v, 1.0)).collect(), rms_px }
    }

    #[test]
    fn few_tracks_are_all_kept_and_of_many_every_square_keeps_the_same_number() {
        let spread = |i: usize| {
            let inner = [(i % 3) as f64 * 0.1, (i / 25) as f64 * 0.05];
            [(i % 5) as f64 * 0.2 + 0.2 * inner[0], (i / 5 % 5) as f64 * 0.2 + 0.2 * inner[1]]
        };
        let all: Vec<Candidate> = (0..500).map(|i| candidate(spread(i), &[0, 1], 0.1)).collect();
        assert_eq!(choose(&all[..40], 50), (0..40).collect::<Vec<_>>());
        let kept = choose(&all, 50);
        let mut of_square = [0; 25];
        kept.iter().for_each(|i| of_square[i % 25] += 1);
        assert_eq!(of_square, [2; 25]);
        assert!(choose(&[], 50).is_empty());
    }

    #[test]
    fn tracks_of_many_views_and_small_residuals_come_first_and_rare_views_are_not_passed_over() {
        let here = [0.5, 0.5];
        let all = [
            candidate(here, &[0, 1], 0.1),
            candidate(here, &[0, 1, 2], 0.4),
            candidate(here, &[0, 1, 2], 0.1),
        ];
        assert_eq!(choose(&all, 1), [2]);
        let mut all: Vec<Candidate> = (0..100).map(|_| candidate(here, &[0, 1, 2], 0.1)).collect();
        all.extend((0..5).map(|_| candidate(here, &[0, 3], 0.1)));
        let kept = choose(&all, 20);
        assert!((100..105).all(|i| kept.contains(&i)), "{kept:?}");
    }
}
