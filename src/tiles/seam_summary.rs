//! What the seams say of a mosaic.

use super::colour::{ColorStep, TileColors};
use super::seams::Seam;
use crate::stats::quantile;
use serde::{Deserialize, Serialize};

/// Differences at the seams of a mosaic; none where there is no seam.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SeamSummary {
    /// Number of seams.
    pub seams: usize,
    /// Median over the seams of the absolute median difference of heights, metres.
    pub step_m: Option<f64>,
    /// 95th percentile of the same, metres.
    pub step_p95_m: Option<f64>,
    /// Share of the cells of all strips that differ by more than 1 m.
    pub over_1m: Option<f64>,
    /// Median over the seams of the absolute median difference of grey values, of 255, before colours are corrected.
    pub ortho_before: Option<f64>,
    /// The same after the correction.
    pub ortho_after: Option<f64>,
    /// Median over the seams of the median absolute difference of grey values after the correction: with what two trainings
    /// of the same ground differ by in each cell.
    pub ortho_spread: Option<f64>,
}

impl SeamSummary {
    /// Summarises seams.
    #[must_use]
    pub fn of(seams: &[Seam], colors: &TileColors) -> Self {
        let steps: Vec<f64> = seams.iter().filter_map(|s| s.median_m).map(f64::abs).collect();
        let cells: usize = seams.iter().map(|s| s.cells).sum();
        let gross: f64 = seams.iter().filter_map(|s| Some(s.over_1m? * s.cells as f64)).sum();
        let ortho: Vec<ColorStep> = seams.iter().filter_map(|s| colors.step(s)).collect();
        let median = |of: fn(&ColorStep) -> f64| quantile(ortho.iter().map(of).collect(), 0.5);
        Self {
            seams: seams.len(),
            step_m: quantile(steps.clone(), 0.5),
            step_p95_m: quantile(steps, 0.95),
            over_1m: (cells > 0).then(|| gross / cells as f64),
            ortho_before: median(|o| o.before),
            ortho_after: median(|o| o.after),
            ortho_spread: median(|o| o.spread),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::seams::tests::seam;
    use super::*;

    #[test]
    fn strips_without_common_cells_do_not_count() {
        let empty = seam(|_| f32::NAN);
        assert_eq!((empty.median_m, empty.over_1m, empty.cells), (None, None, 0));
        let none = SeamSummary::of(std::slice::from_ref(&empty), &TileColors::default());
        assert_eq!((none.seams, none.step_m, none.over_1m, none.ortho_before), (1, None, None, None));
        let three = [empty, seam(|_| 9.9), seam(|_| 10.3)];
        let summary = SeamSummary::of(&three, &TileColors::default());
        assert!((summary.step_p95_m.unwrap() - 0.3).abs() < 1e-5);
    }

    #[test]
    fn the_step_of_the_orthophoto_is_that_of_grey_values() {
        let step = TileColors::default().step(&seam(|_| 10.25)).unwrap();
        assert_eq!((step.before, step.after, step.spread), (4.0, 4.0, 4.0));
    }
}
