//! What an adjustment did, in figures.

use serde::{Deserialize, Serialize};

/// One view's figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    /// The view.
    pub name: String,
    /// Observations used.
    pub observations: usize,
    /// Mean reprojection error with the cameras as delivered, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error after the adjustment, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error after the adjustment, pixels.
    pub rms_px: f64,
    /// `corrected = delivered + shift`: column and row, pixels.
    pub shift_px: [f64; 2],
}

/// An adjustment's figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What fixes the datum.
    pub gauge: String,
    /// Tracks used.
    pub tracks: usize,
    /// Observations used.
    pub observations: usize,
    /// Mean reprojection error with the cameras as delivered, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error after the adjustment, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error after the adjustment, pixels.
    pub rms_px: f64,
    /// Each view.
    pub views: Vec<ViewReport>,
    /// Views that were left out, and why.
    pub left_out: Vec<(String, String)>,
}

impl Report {
    /// Gathers the figures; `before` and `after` are (view, distance in pixels) of the same observations.
    #[must_use]
    pub fn new(
        gauge: &str,
        names: &[String],
        shifts: &[[f64; 2]],
        tracks: usize,
        before: &[(usize, f64)],
        after: &[(usize, f64)],
        left_out: Vec<(String, String)>,
    ) -> Self {
        let of = |all: &[(usize, f64)], view: Option<usize>| -> Vec<f64> {
            all.iter().filter(|(v, _)| view.is_none_or(|w| w == *v)).map(|(_, d)| *d).collect()
        };
        let mean = |d: &[f64]| d.iter().sum::<f64>() / d.len().max(1) as f64;
        let rms = |d: &[f64]| (d.iter().map(|d| d * d).sum::<f64>() / d.len().max(1) as f64).sqrt();
        let views = names
            .iter()
            .enumerate()
            .map(|(v, name)| {
                let own = of(after, Some(v));
                ViewReport {
                    name: name.clone(),
                    observations: own.len(),
                    mean_before_px: mean(&of(before, Some(v))),
                    mean_px: mean(&own),
                    rms_px: rms(&own),
                    shift_px: shifts[v],
                }
            })
            .collect();
        let all = of(after, None);
        Self {
            gauge: gauge.into(),
            tracks,
            observations: all.len(),
            mean_before_px: mean(&of(before, None)),
            mean_px: mean(&all),
            rms_px: rms(&all),
            views,
            left_out,
        }
    }

    /// A table for people.
    #[must_use]
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut out = String::new();
        let width = self.views.iter().map(|v| v.name.len()).max().unwrap_or(4).max(4);
        let _ = writeln!(
            out,
            "{:width$} {:>7} {:>10} {:>9} {:>8} {:>9} {:>9}",
            "view", "points", "before px", "after px", "rms px", "d col px", "d row px"
        );
        for v in &self.views {
            let _ = writeln!(
                out,
                "{:width$} {:>7} {:>10.3} {:>9.3} {:>8.3} {:>9.3} {:>9.3}",
                v.name, v.observations, v.mean_before_px, v.mean_px, v.rms_px, v.shift_px[0], v.shift_px[1]
            );
        }
        let _ = writeln!(
            out,
            "{} tracks, {} observations, mean reprojection {:.3} -> {:.3} px",
            self.tracks, self.observations, self.mean_before_px, self.mean_px
        );
        out
    }
}
