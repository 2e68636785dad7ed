//! Statistics of an adjustment.

use super::correction::{CorrectionModel, Parameters};
use serde::{Deserialize, Serialize};

/// Number of bins of the residuals' histogram, and their width, pixels.
pub const HISTOGRAM_BINS: usize = 40;
pub const BIN_PX: f64 = 0.05;
/// Unknowns of the datum that ground control determines: the translation of the network.
const DATUM_UNKNOWNS: usize = 3;

/// Statistics of a view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ViewReport {
    /// Name of the view.
    pub name: String,
    /// Number of observations.
    pub observations: usize,
    /// Mean reprojection error of the delivered cameras, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error of the corrected cameras, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error of the corrected cameras, pixels.
    pub rms_px: f64,
    /// Correction of the view's shift (columns, rows), corrected minus delivered, pixels; for fixed cameras the
    /// correction that an adjustment would make.
    pub shift_px: [f64; 2],
    /// Standard deviations of the shift for a given datum, pixels.
    pub shift_sigma_px: [f64; 2],
    /// Corrections at the edge of the image, pixels: columns by columns, rows by rows, columns by rows, rows by
    /// columns.
    pub edge_px: [f64; 4],
}

impl ViewReport {
    /// Statistics from residuals of the same observations before and after the adjustment, pixels.
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

/// Agreement of an observation of a surveyed point.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlReport {
    /// Name of the view.
    pub view: String,
    /// Line of the ground control file, from 1.
    #[serde(default)]
    pub line: usize,
    /// Reprojection error, pixels.
    pub residual_px: f64,
    /// Adjusted minus surveyed position: east, north, up, metres.
    pub moved_m: [f64; 3],
    /// Whether the residual is compatible with the standard deviations; the robust loss gives other observations little
    /// weight.
    #[serde(default = "agrees_by_default")]
    pub agrees: bool,
}

/// Reports of earlier versions lack the field.
fn agrees_by_default() -> bool {
    true
}

/// Statistics of an adjustment.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Report {
    /// What defines the datum.
    pub gauge: String,
    /// Rank defect: number of independent combinations of corrections that tie points and ground control do not
    /// determine. It is 3 for a free network, whose translation is undetermined.
    pub rank_defect: usize,
    /// A posteriori standard deviation of an observation, pixels.
    pub sigma_px: f64,
    /// Correction model.
    pub model: CorrectionModel,
    /// Number of tracks.
    pub tracks: usize,
    /// Number of observations.
    pub observations: usize,
    /// Mean reprojection error of the delivered cameras, pixels.
    pub mean_before_px: f64,
    /// Mean reprojection error of the corrected cameras, pixels.
    pub mean_px: f64,
    /// Root mean square reprojection error of the corrected cameras, pixels.
    pub rms_px: f64,
    /// Histogram of the reprojection errors before and after the adjustment, in bins of 0.05 px; the last bin holds all
    /// larger ones.
    pub histogram: Vec<[usize; 2]>,
    /// Statistics of each view.
    pub views: Vec<ViewReport>,
    /// Agreement of each observation of a surveyed point.
    pub control: Vec<ControlReport>,
    /// Views that were left out, with the reasons.
    pub left_out: Vec<LeftOut>,
    /// Statistics of each cell of ground, where a large scene was matched by cells.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cells: Vec<CellReport>,
}

/// Statistics of a cell of ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CellReport {
    /// Column from the west and row from the south: `x003_y000`.
    pub id: String,
    /// Longitude and latitude of its middle, degrees.
    pub center_deg: [f64; 2],
    /// Number of its tracks that survived the adjustment of the whole scene.
    pub tracks: usize,
    /// Root mean square reprojection error of these; none without tracks.
    pub rms_px: Option<f64>,
    /// Why the cell has no tie points, if it has none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skipped: Option<String>,
}

impl CellReport {
    /// Statistics from the residuals of the observations of a cell's tracks, pixels.
    #[must_use]
    pub fn new(
        id: &str,
        center_deg: [f64; 2],
        tracks: usize,
        residuals_px: &[f64],
        skipped: Option<String>,
    ) -> Self {
        let rms_px = (!residuals_px.is_empty()).then(|| rms(residuals_px));
        Self { id: id.into(), center_deg, tracks, rms_px, skipped }
    }
}

/// Name of a view that is left out, and the reason.
pub type LeftOut = (String, String);

fn mean(d: &[f64]) -> f64 {
    d.iter().sum::<f64>() / d.len().max(1) as f64
}

fn rms(d: &[f64]) -> f64 {
    mean(&d.iter().map(|d| d * d).collect::<Vec<_>>()).sqrt()
}

impl Report {
    /// The statistics of all observations; `before` and `after` are (view, residual in pixels) of the same
    /// observations.
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

    /// A table for the terminal.
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
        let open = match self.rank_defect {
            0 => String::new(),
            1 => "; 1 combination of corrections is open without it".into(),
            open => format!("; tie points alone leave {open} combinations of corrections free"),
        };
        let _ = writeln!(out, "datum: {}{open}", self.gauge);
        if !self.control.is_empty() {
            let (good, bad): (Vec<_>, Vec<_>) = self.control.iter().partition(|c| c.agrees);
            let (agree, all) = (good.len(), self.control.len());
            let _ = write!(out, "{agree} of {all} observations of ground control agree");
            if let Some(worst) = good.iter().max_by(|a, b| a.residual_px.total_cmp(&b.residual_px)) {
                let rms_px = rms(&good.iter().map(|c| c.residual_px).collect::<Vec<_>>());
                let _ = write!(
                    out,
                    ", at most {:.3} px off (line {}, `{}`), RMS {rms_px:.3} px, redundancy {}",
                    worst.residual_px,
                    worst.line,
                    worst.view,
                    (2 * agree).saturating_sub(DATUM_UNKNOWNS)
                );
            }
            out.push('\n');
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
