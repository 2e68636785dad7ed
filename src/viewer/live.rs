//! How far the training of a run is that is watched while it trains.

use serde::Serialize;

/// Most losses that a page gets.
const MOST_LOSSES: usize = 200;

/// How far a training is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LiveState {
    /// A number that changes with the page.
    pub version: u64,
    /// Iterations that are done.
    pub iteration: u32,
    /// Iterations in all.
    pub iterations: u32,
    /// The loss from the first iteration on, averaged over equally many iterations each; empty of a complete training.
    pub losses: Vec<f64>,
}

impl LiveState {
    /// After these losses, one an iteration.
    #[must_use]
    pub fn new(version: u64, iterations: u32, losses: &[f64]) -> Self {
        let each = losses.len().div_ceil(MOST_LOSSES).max(1);
        let mean = |some: &[f64]| some.iter().sum::<f64>() / some.len() as f64;
        let iteration = u32::try_from(losses.len()).unwrap_or(u32::MAX);
        Self { version, iteration, iterations, losses: losses.chunks(each).map(mean).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_are_averaged_to_few() {
        let state = LiveState::new(3, 5000, &(0..1000).map(f64::from).collect::<Vec<_>>());
        assert_eq!((state.iteration, state.losses.len()), (1000, 200));
        assert_eq!((state.losses[0], state.losses[199]), (2.0, 997.0));
        assert!(LiveState::new(1, 10, &[]).losses.is_empty());
    }
}
