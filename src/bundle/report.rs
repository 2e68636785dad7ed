//! What an adjustment did, in figures.

use super::correction::{Model, Parameters};
use serde::{Deserialize, Serialize};

/// Bins of the histogram, and their width, pixels.
pub const HISTOGRAM_BINS: usize = 40;
const BIN_PX: f64 = 0.05;

/// One view's figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    /// The view.
    pub name: String,
    /// Observations used.
    pub observations: usize,
    /// Mean reprojection error with the cameras as delivered, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error with the cameras as written, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error with the cameras as written, pixels.
    pub rms_px: f64,
    /// `corrected = delivered + shift`: column and row, pixels; of fixed cameras what it would take.
    pub shift_px: [f64; 2],
    /// Standard deviations of the shift within the scene, its datum taken as given, pixels.
    pub shift_sigma_px: [f64; 2],
    /// What is added at the image's edge: columns by columns, rows by rows, columns by rows, rows by columns, pixels.
    pub edge_px: [f64; 4],
}

impl ViewReport {
    /// Gathers the figures from distances of the same observations, pixels.
    #[must_use]
    pub fn new(
        name: &str,
        [col, row, edge @ ..]: Parameters,
        [col_sigma, row_sigma, ..]: Parameters,
        before: &[f64],
        after: &[f64],
    ) -> Self {
        Self {
            name: name.into(),
            observations: after.len(),
            mean_before_px: mean(before),
            mean_px: mean(after),
            rms_px: rms(after),
            shift_px: [col, row],
            shift_sigma_px: [col_sigma, row_sigma],
            edge_px: edge,
        }
    }
}

/// How well an observation of a surveyed point agrees.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlReport {
    /// The view.
    pub view: String,
    /// Line of the file with the points, from 1.
    #[serde(default)]
    pub line: usize,
    /// Reprojection error, pixels.
    pub residual_px: f64,
    /// Adjusted minus surveyed place: east, north, up, metres.
    pub moved_m: [f64; 3],
    /// Whether the point is as near as its standard deviations let expect; others hardly count in the adjustment.
    #[serde(default = "yes")]
    pub agrees: bool,
}

/// Reports of earlier versions name no points that do not agree.
fn yes() -> bool {
    true
}

/// An adjustment's figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What fixes the datum.
    pub gauge: String,
    /// Independent combinations of the corrections that tie points and control leave open, so that the priors hold
    /// them; three are the translation of the whole scene: points by t, shifts by -J t, J a camera's Jacobian.
    pub rank_defect: usize,
    /// Standard deviation of an observation, after the residuals, pixels.
    pub sigma_px: f64,
    /// What was corrected.
    pub model: Model,
    /// Tracks used.
    pub tracks: usize,
    /// Observations used.
    pub observations: usize,
    /// Mean reprojection error with the cameras as delivered, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error with the cameras as written, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error with the cameras as written, pixels.
    pub rms_px: f64,
    /// Observations by reprojection error, before and after, in bins of 0.05 px; the last holds all beyond.
    pub histogram: Vec<[usize; 2]>,
    /// Each view.
    pub views: Vec<ViewReport>,
    /// Each observation of a surveyed point.
    pub control: Vec<ControlReport>,
    /// Views that were left out.
    pub left_out: Vec<LeftOut>,
}

/// The name of a view that is left out, and why.
pub type LeftOut = (String, String);

fn mean(d: &[f64]) -> f64 {
    d.iter().sum::<f64>() / d.len().max(1) as f64
}

fn rms(d: &[f64]) -> f64 {
    mean(&d.iter().map(|d| d * d).collect::<Vec<_>>()).sqrt()
}

impl Report {
    /// The figures of all observations; `before` and `after` are (view, distance in pixels) of the same ones.
    #[must_use]
    pub fn of(before: &[(usize, f64)], after: &[(usize, f64)]) -> Self {
        let [before, after] = [before, after].map(|all| all.iter().map(|d| d.1).collect::<Vec<_>>());
        let mut histogram = vec![[0; 2]; HISTOGRAM_BINS];
        for (column, distances) in [&before, &after].into_iter().enumerate() {
            for d in distances {
                histogram[((d / BIN_PX) as usize).min(HISTOGRAM_BINS - 1)][column] += 1;
            }
        }
        Self {
            histogram,
            observations: after.len(),
            mean_before_px: mean(&before),
            mean_px: mean(&after),
            rms_px: rms(&after),
            ..Self::default()
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
        let _ = writeln!(
            out,
            "datum: {}; {} combinations of corrections are open without it",
            self.gauge, self.rank_defect
        );
        if !self.control.is_empty() {
            let (good, bad): (Vec<_>, Vec<_>) = self.control.iter().partition(|c| c.agrees);
            let worst = good.iter().map(|c| c.residual_px).fold(0.0, f64::max);
            let _ = writeln!(
                out,
                "{} of {} observations of ground control agree, at most {worst:.3} px off",
                good.len(),
                self.control.len()
            );
            for c in bad {
                let [e, n, u] = c.moved_m;
                let _ = writeln!(
                    out,
                    "  line {} (`{}`) does not: {:.2} px off, its point {e:+.2} m east, {n:+.2} m north, {u:+.2} m up of \
                     the survey",
                    c.line, c.view, c.residual_px
                );
            }
        }
        out
    }
}
