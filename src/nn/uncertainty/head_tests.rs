//! Tests of the uncertainty head.

use super::{HeadState, UncertaintyError, UncertaintyHead, UncertaintyLoss};
use crate::io::Grid2;
use crate::nn::features::FeatureMap;
use crate::random::CounterRng;
use crate::simd::Real;

const CHANNELS: usize = 12;

/// Features whose first channel is large where the dissimilarity is, with a mean far from 0.
fn image(image: u64) -> (FeatureMap, Grid2) {
    let (width, height) = (9, 7);
    let mut draw = CounterRng::new(8, 0, image, 0);
    let d = Grid2::from_fn(width, height, |_, _| draw.uniform() as f32);
    let vector = |d: &f32| -> Vec<f32> {
        let noise: Vec<f32> = (0..CHANNELS).map(|_| 5.0 + draw.normal() as f32).collect();
        [vec![5.0 + 3.0 * d], noise[1..].to_vec()].concat()
    };
    let data = d.data.iter().flat_map(vector).collect();
    (FeatureMap { width, height, channels: CHANNELS, data }, d)
}

/// A head whose parameters are all far from 0, and uncertainties on both sides of the least one.
fn head() -> UncertaintyHead<f64> {
    let mut head = UncertaintyHead::new(CHANNELS, 3);
    for (k, p) in head.parameters_mut().iter_mut().enumerate() {
        *p += 0.5 * CounterRng::new(4, 0, 0, k as u64).normal();
    }
    head
}

/// A step of gradient descent.
fn descend<T: Real>(head: &mut UncertaintyHead<T>, rate: f64) {
    let (parameters, gradient) = head.parameters_and_gradient();
    for (p, g) in parameters.iter_mut().zip(gradient) {
        *p = *p - T::from_f64(rate) * *g;
    }
}

#[test]
fn gradients_of_all_parameters_agree_with_central_differences() {
    let ((features, d), loss) = (image(0), UncertaintyLoss::default());
    let mut trained = head();
    trained.train(&features, &d, &loss, 1, 2).unwrap();
    let value = |k: usize, step: f64| {
        let mut head = head();
        head.parameters_mut()[k] += step;
        head.train(&features, &d, &loss, 1, 2).unwrap()
    };
    let largest = trained.gradient().iter().fold(0.0, |m: f64, g| m.max(g.abs()));
    for (k, found) in trained.gradient().iter().enumerate() {
        let expected = (value(k, 1e-5) - value(k, -1e-5)) / 2e-5;
        assert!(
            (found - expected).abs() < 1e-6 * expected.abs().max(1e-2 * largest),
            "{k}: {found} {expected}"
        );
    }
    let untouched = trained.gradient()[..CHANNELS].iter().filter(|g| **g == 0.0).count();
    assert!((1..CHANNELS).contains(&untouched), "{untouched} channels are dropped");
}

#[test]
fn a_new_head_has_uncertainty_1_and_a_trained_one_approaches_the_closed_form() {
    let loss = UncertaintyLoss { prior: 0.5, visible: 0.15 };
    let mut head = UncertaintyHead::<f32>::new(CHANNELS, 0);
    let (features, d) = image(0);
    assert!(head.sigma(&features).unwrap().data.iter().all(|s| (s - 1.0).abs() < 0.2));
    for iteration in 0..4000 {
        let (features, d) = image(iteration % 5);
        head.train(&features, &d, &loss, 0, iteration).unwrap();
        descend(&mut head, 0.05);
    }
    let sigma = head.sigma(&features).unwrap();
    let of = |low: f32, high: f32| {
        let patches = sigma.data.iter().zip(&d.data).filter(|(_, d)| (low..high).contains(*d));
        let found: Vec<f32> = patches.map(|(s, _)| *s).collect();
        found.iter().sum::<f32>() / found.len() as f32
    };
    let expected = |d: f64| (0.5 / loss.stationary(d)).sqrt() as f32;
    let (low, high) = (of(0.0, 0.2), of(0.8, 1.0));
    assert!((low - expected(0.1)).abs() < 0.15, "{low} {}", expected(0.1));
    assert!((high - expected(0.9)).abs() < 0.25, "{high} {}", expected(0.9));
}

#[test]
fn a_restored_head_continues_with_the_same_numbers() {
    let loss = UncertaintyLoss::PAPER;
    let step = |head: &mut UncertaintyHead<f64>, iteration: u64| {
        let (features, d) = image(iteration);
        let value = head.train(&features, &d, &loss, 5, iteration).unwrap();
        descend(head, 0.1);
        value
    };
    let mut head = head();
    step(&mut head, 0);
    let text = serde_json::to_string(head.state()).unwrap();
    let mut restored = UncertaintyHead::from_state(serde_json::from_str(&text).unwrap()).unwrap();
    assert_eq!(step(&mut head, 1), step(&mut restored, 1));
    assert_eq!(head.sigma(&image(2).0).unwrap(), restored.sigma(&image(2).0).unwrap());
}

#[test]
fn what_does_not_fit_together_is_refused() {
    let (features, d) = image(0);
    let loss = UncertaintyLoss::default();
    let mut other = UncertaintyHead::<f64>::new(CHANNELS + 1, 0);
    assert!(matches!(other.sigma(&features), Err(UncertaintyError::Channels { found: 12, expected: 13 })));
    assert!(matches!(other.train(&features, &d, &loss, 0, 0), Err(UncertaintyError::Channels { .. })));
    let few = Grid2::filled(3, 3, 0.0);
    assert!(matches!(head().train(&features, &few, &loss, 0, 0), Err(UncertaintyError::Patches { .. })));
    let mut damaged: HeadState<f64> = head().state().clone();
    damaged.running_mean[3] = f64::NAN;
    assert!(matches!(UncertaintyHead::from_state(damaged), Err(UncertaintyError::State { found: 11, .. })));
}
