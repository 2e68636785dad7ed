//! The speed of this machine in the unit of the cost model: cores of the machine for which that was fitted.

use crate::progress::NoProgress;
use crate::splat::backend::{BackendError, CpuBackend};
use crate::splat::satellite::SatelliteViews;
use crate::splat::train::{LogLine, train};
use crate::splat::trial::{trial_recipe, trial_scene, trial_schedule, trial_start};

/// The training that is measured: columns and rows of its view, and number of splats.
const SIZE: (usize, usize) = (384, 256);
const SPLATS: u64 = 20_000;
/// The measurement ends after this time, seconds, but has so many iterations at least and at most.
const DURATION_S: f64 = 0.5;
const ITERATIONS: (usize, u32) = (4, 1000);
/// Iterations that the measured training makes in a second for each core of the machine for which the cost model was fitted.
const REFERENCE_RATE: f64 = 27.0;

/// How many cores of the machine for which the cost model was fitted do as much as this machine with all threads, by a
/// measurement of half a second; none if it fails.
#[must_use]
pub fn measured_cores() -> Option<f64> {
    let recipe = trial_recipe("eogs", ITERATIONS.1)?;
    let schedule = trial_schedule(&recipe, SPLATS);
    let state = trial_start(SIZE, SPLATS);
    let model = SatelliteViews::new(trial_scene(SIZE), &state);
    let mut backend = CpuBackend::new(model, state).ok()?;
    let mut log: Vec<LogLine> = Vec::new();
    let end_of_time = |_: &mut CpuBackend<_>, log: &[LogLine]| match log.last() {
        Some(line) if line.seconds > DURATION_S && log.len() >= ITERATIONS.0 => Err(Stop),
        _ => Ok(()),
    };
    // Either way the training has ended.
    let _: Result<(), Stop> = train(&mut backend, &schedule, &mut log, &NoProgress, |_| true, end_of_time);
    rate(&log.iter().map(|line| line.seconds).collect::<Vec<_>>()).map(|rate| rate / REFERENCE_RATE)
}

/// Iterations a second by the times of their ends, without the first half, which fills caches.
fn rate(ends: &[f64]) -> Option<f64> {
    let (first, last) = (ends.len() / 2, ends.len().checked_sub(1)?);
    (last > first).then(|| (last - first) as f64 / (ends[last] - ends[first]))
}

/// The end of the measurement.
struct Stop;

impl From<BackendError> for Stop {
    fn from(_: BackendError) -> Self {
        Self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_is_that_of_the_second_half() {
        assert_eq!(rate(&[1.0, 1.5, 2.0, 2.25, 2.5]), Some(4.0));
        assert_eq!((rate(&[]), rate(&[1.0])), (None, None));
    }

    #[test]
    fn every_machine_has_a_speed() {
        let cores = measured_cores().unwrap();
        assert!(cores.is_finite() && cores > 0.0, "{cores}");
    }
}
