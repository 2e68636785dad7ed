//! Derivatives against central differences, for tests.

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

#[test]
fn a_wrong_derivative_is_told_from_a_kink() {
    assert!(disagreement(4.0, 1.0, 1e-6, |d| (2.0 + d).powi(2)).unwrap() < 1e-6);
    assert!(disagreement(4.1, 1.0, 1e-6, |d| (2.0 + d).powi(2)).unwrap() > 0.09);
    assert_eq!(disagreement(0.5, 1.0, 1e-6, |d| (d - 1.5e-6).abs()), None);
}
