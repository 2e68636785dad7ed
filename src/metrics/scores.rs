//! Scores of a registered prediction: what is left between it and the truth.

use super::{WATER, filled_by_nearest};
use crate::raster::Plane;
use serde::Serialize;
use std::collections::BTreeMap;

/// Scale from the median absolute deviation to the standard deviation of a normal distribution.
const MAD_TO_SIGMA: f64 = 1.4826;

/// Errors over the land, in metres; `e = clip(registered) - truth`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scores {
    /// Mean of |e|.
    pub mae_m: f64,
    /// Root of the mean of e².
    pub rmse_m: f64,
    /// Median of |e|.
    pub median_m: f64,
    /// 1.4826 times the median of |e - median(e)|.
    pub nmad_m: f64,
    /// |e| that 90 % of the cells do not exceed.
    pub le90_m: f64,
    /// Mean of e.
    pub bias_m: f64,
    /// Share of cells with |e| of 0.5, 1 and 2 m at most.
    pub within: [f64; 3],
    /// Predicted cells of land / cells of land.
    pub completeness: f64,
    /// MAE over all land, holes filled by the nearest valid cell.
    pub filled_mae_m: f64,
    /// Cells that were scored.
    pub cells: usize,
    /// By class code of the truth, where there are classes.
    pub by_class: BTreeMap<u8, ClassScore>,
}

/// Errors over one class.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClassScore {
    /// Mean of |e| in metres; NaN (null in JSON) where nothing is predicted.
    pub mae_m: f64,
    /// Predicted cells / cells of the class.
    pub completeness: f64,
    /// Cells of the class.
    pub cells: usize,
}

/// Scores `registered` against `land` (NaN where not scored); values are clipped to `bounds` first.
#[must_use]
pub fn score(registered: &Plane, land: &Plane, classes: Option<&[u8]>, bounds: (f32, f32)) -> Scores {
    let errors = errors(registered, land, bounds);
    let land_cells = land.valid().count();
    let mut e: Vec<f32> = errors.iter().copied().filter(|e| !e.is_nan()).collect();
    let n = e.len() as f64;
    let mean = |f: fn(f64) -> f64| e.iter().map(|v| f(f64::from(*v))).sum::<f64>() / n;
    let (mae_m, bias_m, rmse_m) = (mean(f64::abs), mean(|v| v), mean(|v| v * v).sqrt());
    let nmad_m = nmad(&mut e);
    let mut absolute: Vec<f32> = e.iter().map(|v| v.abs()).collect();
    let within =
        [0.5, 1.0, 2.0].map(|limit| absolute.iter().filter(|v| f64::from(**v) <= limit).count() as f64 / n);
    let filled = filled_by_nearest(registered);
    let filled_errors = self::errors(&filled, land, bounds);
    Scores {
        mae_m,
        rmse_m,
        median_m: quantile(&mut absolute, 0.5),
        nmad_m,
        le90_m: quantile(&mut absolute, 0.9),
        bias_m,
        within,
        completeness: n / land_cells as f64,
        filled_mae_m: mean_absolute(filled_errors.iter()),
        cells: e.len(),
        by_class: classes.map_or_else(BTreeMap::new, |c| by_class(&errors, land, c)),
    }
}

/// `clip(registered) - land`, NaN where one of them is.
pub(super) fn errors(registered: &Plane, land: &Plane, (low, high): (f32, f32)) -> Vec<f32> {
    registered.data.iter().zip(&land.data).map(|(p, t)| p.clamp(low, high) - t).collect()
}

fn by_class(errors: &[f32], land: &Plane, classes: &[u8]) -> BTreeMap<u8, ClassScore> {
    let mut errors_of: BTreeMap<u8, Vec<f32>> = BTreeMap::new();
    for ((e, t), class) in errors.iter().zip(&land.data).zip(classes) {
        if !t.is_nan() && *class != WATER {
            errors_of.entry(*class).or_default().push(*e);
        }
    }
    let score = |e: &Vec<f32>| {
        let predicted = e.iter().filter(|e| !e.is_nan()).count();
        ClassScore {
            mae_m: mean_absolute(e.iter()),
            completeness: predicted as f64 / e.len() as f64,
            cells: e.len(),
        }
    };
    errors_of.iter().map(|(class, e)| (*class, score(e))).collect()
}

fn mean_absolute<'a>(errors: impl Iterator<Item = &'a f32>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for e in errors.filter(|e| !e.is_nan()) {
        sum += f64::from(e.abs());
        n += 1.0;
    }
    sum / n
}

/// The `q` quantile, linear between neighbours (numpy's default); reorders `values`; NaN of nothing.
///
/// `values` must hold no NaN.
#[must_use]
pub fn quantile(values: &mut [f32], q: f64) -> f64 {
    if values.is_empty() {
        return f64::NAN;
    }
    let position = q * (values.len() - 1) as f64;
    let index = position.floor() as usize;
    let (_, &mut low, above) = values.select_nth_unstable_by(index, f32::total_cmp);
    let next = above.iter().copied().min_by(f32::total_cmp).unwrap_or(low);
    let (low, next) = (f64::from(low), f64::from(next));
    low + (next - low) * (position - index as f64)
}

/// 1.4826 times the median absolute deviation from the median; reorders `values`.
#[must_use]
pub fn nmad(values: &mut [f32]) -> f64 {
    let median = quantile(values, 0.5);
    let mut deviations: Vec<f32> = values.iter().map(|v| (f64::from(*v) - median).abs() as f32).collect();
    MAD_TO_SIGMA * quantile(&mut deviations, 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL_HEIGHTS: (f32, f32) = (f32::MIN, f32::MAX);

    /// Normal deviates by the Box-Muller transform of a counter hashed.
    fn normal(n: usize, sigma: f64) -> Vec<f32> {
        let uniform = |i: u64| {
            let mut x = i.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
            x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let pair = |i: u64| {
            (-2.0 * (1.0 - uniform(2 * i)).ln()).sqrt() * (std::f64::consts::TAU * uniform(2 * i + 1)).cos()
        };
        (0..n as u64).map(|i| (sigma * pair(i)) as f32).collect()
    }

    #[test]
    fn scores_of_normal_noise_are_those_of_the_distribution() {
        let truth = Plane::filled(400, 400, 12.0);
        let sigma = 0.7;
        let noise = normal(400 * 400, sigma);
        let prediction = Plane { width: 400, height: 400, data: noise.iter().map(|e| e + 12.0).collect() };
        let s = score(&prediction, &truth, None, ALL_HEIGHTS);
        let near =
            |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        near(s.nmad_m, sigma);
        near(s.rmse_m, sigma);
        near(s.mae_m, sigma * (2.0 / std::f64::consts::PI).sqrt());
        near(s.le90_m, sigma * 1.644_854);
        near(s.median_m, sigma * 0.674_49);
        assert!(s.bias_m.abs() < 0.01);
        assert_eq!((s.completeness, s.cells), (1.0, 160_000));
    }

    #[test]
    fn quantiles_are_numpy_s() {
        let mut v = [4.0, 1.0, 3.0, 2.0];
        assert_eq!(quantile(&mut v, 0.5), 2.5);
        assert_eq!(quantile(&mut v, 0.0), 1.0);
        assert_eq!(quantile(&mut v, 1.0), 4.0);
        assert!((quantile(&mut v, 0.9) - 3.7).abs() < 1e-6);
        assert!(quantile(&mut [], 0.5).is_nan());
    }

    #[test]
    fn holes_count_against_completeness_and_are_filled_from_beside() {
        let truth = Plane::from_fn(10, 10, |c, _| c as f32);
        let mut prediction = truth.clone();
        for row in 0..10 {
            prediction.data[row * 10 + 9] = f32::NAN;
        }
        let s = score(&prediction, &truth, None, ALL_HEIGHTS);
        assert_eq!((s.mae_m, s.completeness), (0.0, 0.9));
        assert!((s.filled_mae_m - 0.1).abs() < 1e-9);
    }

    #[test]
    fn registered_values_are_clipped() {
        let truth = Plane::filled(10, 10, 0.0);
        let prediction = Plane::filled(10, 10, 1000.0);
        assert_eq!(score(&prediction, &truth, None, (-10.0, 10.0)).mae_m, 10.0);
    }
}
