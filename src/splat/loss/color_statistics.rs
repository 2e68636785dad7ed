//! Mean and variance of the colours of anchored splats, which should be those of all splats (GeoProp-GS §3.3).
//!
//! For each channel of the coefficients of the zeroth spherical harmonic, with mean `m` and variance `v`, the term is
//! `(m_anchored - m_all)² + (v_anchored - v_all)²`; the values of all splats count as constants. The derivative by a coefficient `c`
//! of one of `n` anchored splats is `2 (m_anchored - m_all) / n + 4 (v_anchored - v_all) (c - m_anchored) / n`.

use super::term::{LossTerm, Rendered, TermInfo, TermScope};
use super::terms::TermInputs;
use crate::simd::SimdReal;
use crate::splat::splats::Splats;

/// One weight and one column.
pub const INFO: TermInfo =
    TermInfo { weights: &["color_statistics"], columns: &["color_statistics"], scope: TermScope::Any };

/// The term.
pub struct ColorStatistics<T> {
    /// Indices of the anchored splats.
    anchored: Vec<u32>,
    /// For each channel: the derivative by a coefficient `c` is `constant + slope c`.
    derivatives: [Derivative<T>; 3],
}

#[derive(Clone, Copy, Default)]
struct Derivative<T> {
    constant: T,
    slope: T,
}

impl<T: SimdReal> ColorStatistics<T> {
    /// The term.
    #[must_use]
    pub fn new(_: &mut TermInputs<T>) -> Self {
        Self { anchored: Vec::new(), derivatives: [Derivative::default(); 3] }
    }
}

/// Mean and variance.
fn moments(values: impl Iterator<Item = f64> + Clone) -> (f64, f64) {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (mean, values.map(|v| (v - mean).powi(2)).sum::<f64>() / count)
}

impl<T: SimdReal> LossTerm<T> for ColorStatistics<T> {
    fn evaluate(&mut self, rendered: &Rendered<T>, weights: &[f64], columns: &mut [f64]) -> f64 {
        let (weight, colors) = (weights[0], &rendered.splats.f_dc);
        self.anchored.clear();
        columns[0] = 0.0;
        if weight == 0.0 || rendered.anchored.is_empty() {
            return 0.0;
        }
        self.anchored.extend(rendered.anchored.iter().map(|a| a.splat));
        let n = self.anchored.len() as f64;
        for (channel, derivative) in self.derivatives.iter_mut().enumerate() {
            let value = |color: &[T; 3]| color[channel].as_f64();
            let (mean, variance) = moments(self.anchored.iter().map(|i| value(&colors[*i as usize])));
            let (of_all, variance_of_all) = moments(colors.iter().map(value));
            let (by_mean, by_variance) = (mean - of_all, variance - variance_of_all);
            columns[0] += by_mean * by_mean + by_variance * by_variance;
            let slope = weight * 4.0 * by_variance / n;
            let constant = weight * 2.0 * by_mean / n - slope * mean;
            *derivative = Derivative { constant: T::from_f64(constant), slope: T::from_f64(slope) };
        }
        weight * columns[0]
    }

    fn add_by_splats(&self, splats: &Splats<T>, by: &mut Splats<T>) {
        for i in self.anchored.iter().map(|i| *i as usize) {
            for (k, Derivative { constant, slope }) in self.derivatives.iter().enumerate() {
                by.f_dc[i][k] = by.f_dc[i][k] + *constant + *slope * splats.f_dc[i][k];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::splat::anchored::Anchoring;
    use crate::splat::raster::Image;

    fn evaluate(splats: &Splats<f64>, anchored: &[Anchoring]) -> (f64, Splats<f64>) {
        let nothing = Image::default();
        let rendered = Rendered { anchored, ..Rendered::of_splats(splats, &nothing) };
        let mut term = ColorStatistics::new(&mut TermInputs::default());
        let value = term.evaluate(&rendered, &[0.7], &mut [0.0]);
        let mut by = Splats::zeros(splats.len());
        term.add_by_splats(splats, &mut by);
        (value, by)
    }

    #[test]
    fn anchored_splats_are_drawn_to_mean_and_variance_of_all() {
        let mut splats = Splats::<f64>::default();
        for i in 0..9 {
            let v = f64::from(i);
            splats.push([v; 3], 1.0, 0.5, [0.1 * v, 0.5 + 0.3 * v.sin(), 0.9 - 0.05 * v]);
        }
        let anchored: Vec<Anchoring> = [5, 7, 8].map(|splat| Anchoring { splat, anchor: 0 }).into();
        let (found, by) = evaluate(&splats, &anchored);
        let of_all: Vec<(f64, f64)> = (0..3).map(|k| moments(splats.f_dc.iter().map(|c| c[k]))).collect();
        let value = |splats: &Splats<f64>| {
            let of = |k: usize| {
                let (mean, variance) = moments([5, 7, 8].iter().map(|i| splats.f_dc[*i][k]));
                (mean - of_all[k].0).powi(2) + (variance - of_all[k].1).powi(2)
            };
            0.7 * (0..3).map(of).sum::<f64>()
        };
        assert!((found - value(&splats)).abs() < 1e-12);
        for (i, k) in (0..9).flat_map(|i| (0..3).map(move |k| (i, k))) {
            let moved = |by: f64| {
                let mut splats = splats.clone();
                splats.f_dc[i][k] += by;
                value(&splats)
            };
            let quotient = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!((by.f_dc[i][k] - quotient).abs() < 1e-8, "{i} {k}: {} {quotient}", by.f_dc[i][k]);
        }
        assert!(evaluate(&splats, &[]).0 == 0.0);
    }
}
