//! Derivatives against central differences, for tests.

use super::splats::{GROUPS, Splats};

/// Largest difference between the derivatives of a loss and difference quotients, relative to the largest derivative of a group.
pub(in crate::splat) const TOLERANCE: f64 = 1e-6;

/// Smaller of the two steps of the parameters.
const STEP: f64 = 1e-6;

/// Difference between a derivative and the difference quotient of `value`, a function of a change of the parameter, relative to
/// `largest`.
///
/// A difference of `tolerance` or more is examined with a second step: quotients of two steps that differ are those at a kink or a
/// jump of the loss (an alpha cut-off, a median), where there is no derivative, and the answer is none.
pub(in crate::splat) fn disagreement(
    derivative: f64,
    largest: f64,
    tolerance: f64,
    mut value: impl FnMut(f64) -> f64,
) -> Option<f64> {
    let mut quotient = |step: f64| (value(step) - value(-step)) / (2.0 * step);
    let first = quotient(STEP);
    let off = (first - derivative).abs() / largest;
    let mut is_smooth = || (first - quotient(2.0 * STEP)).abs() <= 1e-6 * largest;
    (off < tolerance || is_smooth()).then_some(off)
}

/// Largest [`disagreement`] of the gradient `analytic` of a loss at `splats`; only every `every`-th parameter is compared. At least the
/// share `smooth` of these must not lie at a kink or a jump.
pub(in crate::splat) fn worst_disagreement(
    splats: &Splats<f64>,
    analytic: &Splats<f64>,
    (every, smooth): (usize, f64),
    loss: impl Fn(&Splats<f64>) -> f64,
) -> f64 {
    let mut worst: f64 = 0.0;
    let (mut asked, mut compared) = (0, 0);
    for group in 0..GROUPS {
        let derivatives = analytic.groups()[group];
        let largest = derivatives.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for (k, derivative) in derivatives.iter().enumerate().step_by(every) {
            asked += 1;
            let value = |step: f64| {
                let mut moved = splats.clone();
                moved.groups_mut()[group][k] += step;
                loss(&moved)
            };
            if let Some(off) = disagreement(*derivative, largest, TOLERANCE, value) {
                compared += 1;
                worst = worst.max(off);
            }
        }
    }
    let enough = f64::from(compared) > smooth * f64::from(asked);
    assert!(enough, "too many parameters at jumps: {compared} of {asked}");
    worst
}

#[test]
fn a_wrong_derivative_is_told_from_a_kink() {
    assert!(disagreement(4.0, 1.0, 1e-6, |d| (2.0 + d).powi(2)).unwrap() < 1e-6);
    assert!(disagreement(4.1, 1.0, 1e-6, |d| (2.0 + d).powi(2)).unwrap() > 0.09);
    assert_eq!(disagreement(0.5, 1.0, 1e-6, |d| (d - 1.5e-6).abs()), None);
}
