//! Test-time optimisation: the embedding of a view that was not trained on (SatGS, algorithm 1).
//!
//! Splats and networks do not change; only the view's own parameters do, by the photometric loss.

use super::objective::{Gradient, SatelliteObjective, SatelliteStep};
use crate::nn::adam::{Adam, AdamRule};
use crate::progress::{Interrupted, Progress};
use crate::splat::appearance::{AppearanceModel, ModelParameters};
use crate::splat::loss::{LossWeights, TermInputs, terms};
use crate::splat::splats::Splats;
use crate::splat::stopwatch::Stopwatch;

/// Number of steps, and the learning rate of the first of them (WildGaussians); the rate falls linearly to zero. SatGS takes
/// 5000 steps, at a rate that it does not state.
const STEPS: u32 = 128;
const RATE: f64 = 0.1;

/// The parameters of a view that reproduce an image best, searched from those of `start`. `input` holds the image, with a
/// mask of the pixels that count.
///
/// # Errors
/// [`Interrupted`] if the caller asks to stop.
pub fn fit_view(
    splats: &Splats,
    model: Box<dyn AppearanceModel<f32>>,
    start: ModelParameters<f32>,
    input: &SatelliteStep<f32>,
    progress: &dyn Progress,
) -> Result<Vec<f32>, Interrupted> {
    let mut objective = SatelliteObjective::new(splats.primitive(), model, terms(TermInputs::default()));
    let (mut values, mut adam, mut gradient) = (start.view.to_vec(), Adam::default(), Gradient::default());
    let mut best = (f64::INFINITY, values.clone());
    for step in 0..STEPS {
        progress.check()?;
        let parameters = ModelParameters { view: &values, ..start };
        let watch = &mut Stopwatch::default();
        let losses =
            objective.evaluate(splats, parameters, input, &LossWeights::default(), &mut gradient, watch);
        if losses.total < best.0 {
            best = (losses.total, values.clone());
        }
        let rate = RATE * f64::from(STEPS - step) / f64::from(STEPS);
        adam.step(AdamRule::DEFAULT, &mut values, &gradient.appearance, rate);
    }
    Ok(best.1)
}
