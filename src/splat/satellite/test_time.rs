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

/// Number of steps. SatGS takes 5000, at a rate that it does not state, and WildGaussians 128.
const STEPS: u32 = 500;
/// Learning rate of the first step (WildGaussians); it falls linearly to zero.
const RATE: f64 = 0.1;

/// The parameters of a view that reproduce an image best, searched from those of `starts` that do so best; none without a start.
/// `input` holds the image, with a mask of the pixels that count.
///
/// # Errors
/// [`Interrupted`] if the caller asks to stop.
pub fn fit_view(
    splats: &Splats,
    model: Box<dyn AppearanceModel<f32>>,
    starts: &[ModelParameters<f32>],
    input: &SatelliteStep<f32>,
    progress: &dyn Progress,
) -> Result<Option<Vec<f32>>, Interrupted> {
    let mut objective = SatelliteObjective::new(splats.primitive(), model, terms(TermInputs::default()));
    let mut gradient = Gradient::default();
    let mut loss = |parameters: ModelParameters<f32>, gradient: &mut Gradient<f32>| {
        let watch = &mut Stopwatch::default();
        objective.evaluate(splats, parameters, input, &LossWeights::default(), gradient, watch).total
    };
    let mut best_start = None;
    for start in starts {
        progress.check()?;
        let found = loss(*start, &mut gradient);
        if best_start.is_none_or(|(least, _)| found < least) {
            best_start = Some((found, *start));
        }
    }
    let Some((least, start)) = best_start else { return Ok(None) };
    let (mut values, mut adam) = (start.view.to_vec(), Adam::default());
    let mut best = (least, values.clone());
    for step in 0..STEPS {
        progress.check()?;
        let found = loss(ModelParameters { view: &values, ..start }, &mut gradient);
        if found < best.0 {
            best = (found, values.clone());
        }
        let rate = RATE * f64::from(STEPS - step) / f64::from(STEPS);
        adam.step(AdamRule::DEFAULT, &mut values, &gradient.appearance, rate);
    }
    Ok(Some(best.1))
}
