//! Minimisation over two coordinates by pattern search (Hooke & Jeeves 1961).

use rayon::prelude::*;

/// Step lengths of a pattern search and its limit.
pub(crate) struct PatternSearch {
    /// First step.
    pub first_step: f64,
    /// The search ends when the step becomes smaller than this.
    pub last_step: f64,
    /// Largest number of moves with one step. A limit is needed where the comparison of candidates is not transitive.
    pub max_moves: usize,
}

impl PatternSearch {
    /// Moves from `start` to the best of the eight neighbours while one is better, then halves the step.
    ///
    /// `position` gives the coordinates of a candidate and `evaluate` makes the candidate of a position. `best_of` gets
    /// the present candidate and its neighbours, row by row, and returns the best neighbour if it is better.
    pub fn run<C: Send>(
        &self,
        start: C,
        position: impl Fn(&C) -> [f64; 2],
        evaluate: impl Fn([f64; 2]) -> C + Sync,
        best_of: impl Fn(&C, Vec<C>) -> Option<C>,
    ) -> C {
        let (mut best, mut step, mut moves) = (start, self.first_step, 0);
        while step >= self.last_step {
            let [x, y] = position(&best);
            let neighbours: Vec<[f64; 2]> = (0..9)
                .filter(|k| *k != 4)
                .map(|k| [k % 3 - 1, k / 3 - 1].map(f64::from))
                .map(|[i, j]| [x + step * i, y + step * j])
                .collect();
            let candidates = neighbours.into_par_iter().map(&evaluate).collect();
            match best_of(&best, candidates) {
                Some(better) if moves < self.max_moves => (best, moves) = (better, moves + 1),
                _ => (step, moves) = (0.5 * step, 0),
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_minimum_of_a_bowl_is_found_to_the_last_step() {
        let search = PatternSearch { first_step: 0.5, last_step: 1e-3, max_moves: usize::MAX };
        let evaluate = |p: [f64; 2]| (p, (p[0] - 1.2).powi(2) + (p[1] + 3.4).powi(2));
        let best_of = |best: &([f64; 2], f64), all: Vec<([f64; 2], f64)>| {
            all.into_iter().filter(|c| c.1 < best.1).min_by(|a, b| a.1.total_cmp(&b.1))
        };
        let (found, _) = search.run(evaluate([0.0; 2]), |c| c.0, evaluate, best_of);
        assert!((found[0] - 1.2).abs() < 1e-3 && (found[1] + 3.4).abs() < 1e-3, "{found:?}");
    }
}
