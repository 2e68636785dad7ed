//! Conjugate gradients for the sparse systems of views, whose matrices are only known by their products.

/// When to stop.
pub(super) struct Limits {
    /// Number of steps at most.
    pub steps: usize,
    /// Residual as a share of the right-hand side, both divided by the root of the diagonal.
    pub residual: f64,
}

/// Improves the solution `x` of `A x = right` with a symmetric positive definite matrix; `product` writes `A` times its first argument
/// to the second one. Residuals are divided by `diagonal`: that of `A`, or ones.
pub(super) fn solve(
    product: impl Fn(&[f64], &mut Vec<f64>),
    diagonal: &[f64],
    right: &[f64],
    x: &mut [f64],
    limits: &Limits,
) {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let size_of = |r: &[f64]| r.iter().zip(diagonal).map(|(r, d)| r * (r / d)).sum::<f64>();
    let mut image = Vec::new();
    product(x, &mut image);
    let mut residual: Vec<f64> = right.iter().zip(&image).map(|(b, a)| b - a).collect();
    let mut direction: Vec<f64> = residual.iter().zip(diagonal).map(|(r, d)| r / d).collect();
    let (mut size, least) = (size_of(&residual), limits.residual * limits.residual * size_of(right));
    for _ in 0..limits.steps {
        if size <= least {
            break;
        }
        product(&direction, &mut image);
        let step = size / dot(&direction, &image);
        x.iter_mut().zip(&direction).for_each(|(x, d)| *x += step * d);
        residual.iter_mut().zip(&image).for_each(|(r, i)| *r -= step * i);
        let next = size_of(&residual);
        let scaled = residual.iter().zip(diagonal).map(|(r, d)| r / d);
        direction.iter_mut().zip(scaled).for_each(|(d, r)| *d = r + next / size * *d);
        size = next;
    }
}
