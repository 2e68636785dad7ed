//! Figures of an evaluation: distributions of errors, and height profiles through buildings.

use crate::io::{Chart, Grid2};
use crate::metrics::{Evaluation, Profile};
use rayon::prelude::*;

/// Largest absolute error in the figures, metres.
const LARGEST_M: f64 = 5.0;
/// Width of the bins of histogram and cumulative curve, metres.
const STEP_M: f64 = 0.1;

/// File names of the figures in the output folder of an evaluation.
pub const FIGURES: [&str; 4] =
    ["histogram.svg", "cumulative.svg", "profile_worst.svg", "profile_typical.svg"];

/// The figures of an evaluation: file names and SVG texts. Profiles are included only if the truth has classes with
/// buildings.
///
/// `errors` is the result of [`Evaluation::error_map`], in metres.
#[must_use]
pub fn figures(evaluation: &Evaluation, errors: &Grid2) -> Vec<(&'static str, String)> {
    let mut charts = vec![(FIGURES[0], histogram(errors)), (FIGURES[1], cumulative(errors))];
    if let Some([worst, typical]) = evaluation.profiles(errors) {
        charts.push((FIGURES[2], profile(&worst, "Building of the largest MAE")));
        charts.push((FIGURES[3], profile(&typical, "Building of the median MAE")));
    }
    charts.into_iter().filter_map(|(name, chart)| Some((name, chart.svg()?))).collect()
}

/// Number of errors in each of `bins` bins, and the total number of errors; `bin` gives the bin of an error.
fn counted(errors: &Grid2, bins: usize, bin: impl Fn(f64) -> f64 + Sync) -> (Vec<u64>, u64) {
    let none = || (vec![0; bins], 0);
    let count = |(mut counts, mut n): (Vec<u64>, u64), row: &[f32]| {
        for e in row.iter().filter(|e| !e.is_nan()) {
            n += 1;
            let bin = bin(f64::from(*e));
            if (0.0..bins as f64).contains(&bin) {
                counts[bin as usize] += 1;
            }
        }
        (counts, n)
    };
    let both = |(mut counts, n): (Vec<u64>, u64), (more, m): (Vec<u64>, u64)| {
        counts.iter_mut().zip(more).for_each(|(count, more)| *count += more);
        (counts, n + m)
    };
    errors.data.par_chunks(errors.width).fold(none, count).reduce(none, both)
}

/// Percentage of the cells in each bin of errors.
fn histogram(errors: &Grid2) -> Chart {
    let bins = (2.0 * LARGEST_M / STEP_M).round() as usize;
    let (counts, n) = counted(errors, bins, |e| ((e + LARGEST_M) / STEP_M).floor());
    let share = |count: u64| 100.0 * count as f64 / n.max(1) as f64;
    let shares: Vec<f64> = counts.into_iter().map(share).collect();
    let points = Chart::bars(&shares, -LARGEST_M, STEP_M);
    Chart {
        title: "Height errors after registration xyz".into(),
        x: "predicted minus true height, m".into(),
        y: format!("% of cells per {STEP_M} m"),
        lines: vec![("cells".into(), points)],
    }
}

/// Percentage of the cells whose absolute error is at most a given one.
fn cumulative(errors: &Grid2) -> Chart {
    let bins = (LARGEST_M / STEP_M).round() as usize;
    let (counts, n) = counted(errors, bins + 1, |e| (e.abs() / STEP_M).ceil());
    let mut sum = 0;
    let points = counts.iter().enumerate().map(|(i, c)| {
        sum += c;
        (i as f64 * STEP_M, 100.0 * sum as f64 / n.max(1) as f64)
    });
    Chart {
        title: "Cumulative distribution of absolute errors".into(),
        x: "absolute error, m".into(),
        y: "% of cells".into(),
        lines: vec![("cells".into(), points.collect())],
    }
}

fn profile(profile: &Profile, title: &str) -> Chart {
    let line =
        |of: fn(&(f64, f32, f32)) -> f32| profile.heights.iter().map(|h| (h.0, f64::from(of(h)))).collect();
    let (east, north) = profile.start;
    Chart {
        title: format!("{title}, {:.2} m", profile.mae_m),
        x: format!("m east of {east:.0}, {north:.0}"),
        y: "height, m".into(),
        lines: vec![("truth".into(), line(|h| h.1)), ("predicted".into(), line(|h| h.2))],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distributions_count_every_cell_once() {
        let errors = Grid2 { width: 5, height: 1, data: vec![0.25, -0.25, 4.95, 99.0, f32::NAN] };
        let points = &cumulative(&errors).lines[0].1;
        let at = |x: f64| points.iter().find(|p| (p.0 - x).abs() < 1e-9).unwrap().1;
        assert_eq!((at(0.2), at(0.3), at(5.0)), (0.0, 50.0, 75.0));
        let shares: f64 = histogram(&errors).lines[0].1.iter().map(|p| p.1).sum();
        // Every bin has two corners in the outline.
        assert!((shares - 2.0 * 75.0).abs() < 1e-9, "{shares}");
    }
}
