//! `satgs dsm-eval`: a surface model against the truth, in a table, a JSON file, an error map and figures.

use super::{CliError, Ui};
use crate::metrics::Evaluation;
use crate::pipeline::{EvaluateOptions, evaluate};
use crate::report::{SCORE_NOTE, ScoreTable, expected_error_text, score_tables};
use std::fmt::Write;
use std::path::PathBuf;

/// Score a surface model against lidar: errors after registration, by class, at edges and by slope; error map
#[derive(clap::Args)]
#[command(after_help = "\
Registrations of the surface model to the truth:
  z    adds the median height offset (MAE_reg of the BAEOGS paper)
  ncc  shifts by whole cells to the best correlation and adds the mean offset (EOGS)
  xyz  shifts in three dimensions to the smallest MAE
dx, dy: offset in cells (columns, rows) at which the surface model is sampled; east, north, dz: the
same as a shift of the surface model in metres (east = -dx cells, north = dy cells).
Without classes water is scored like land. Completeness includes cells that were filled in; the row
`confirmed` counts only cells that two views or more confirm. Compare MAEs only between surface
models with a completeness of at least 0.99.

Examples:
  satgs dsm-eval run/dsm.tif JAX_068_DSM.tif   (finds JAX_068_DSM.txt, JAX_068_CLS.tif by name)
  satgs dsm-eval dsm.tif lidar.laz -o eval     (the highest point of every cell; map and charts)
  satgs dsm-eval dsm.tif lidar.tif --mask roofs.gpkg --truth-vertical EGM96")]
pub struct Args {
    /// The surface model: a raster in a projected CRS in metres
    dsm: PathBuf,
    #[command(flatten)]
    truth: TruthArgs,
    /// Confidence of the surface model, as `satgs dsm` writes it, to score confirmed and filled cells separately
    /// [default: confidence.tif beside the surface model, if it has the same cells]
    #[arg(long, value_name = "FILE")]
    confidence: Option<PathBuf>,
    /// Folder for metrics.json, the error map after registration xyz (error.tif with a QGIS style, error.png) and charts
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replace files that are in the output folder
    #[arg(long)]
    overwrite: bool,
}

/// The truth and how it is read.
#[derive(clap::Args)]
struct TruthArgs {
    /// The truth: a raster in a projected CRS in metres, DFC2019's X_DSM.tif with X_DSM.txt beside it, or points (.las, .laz)
    truth: PathBuf,
    #[command(flatten)]
    options: TruthOptionArgs,
}

/// How the truth is to be read; `satgs run --truth` takes them too.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "scoring")]
pub(super) struct TruthOptionArgs {
    /// Class raster on the truth's grid, in which class 9 is water [default: X_CLS.tif beside X_DSM.tif, or the points' classes]
    #[arg(
        long,
        value_name = "CLS.tif",
        requires = "truth",
        hide_short_help = true,
        help_heading = "Scoring"
    )]
    classes: Option<PathBuf>,
    /// Score the inside and the outside of a mask separately: polygons (any vector file), or a raster on the truth's grid,
    /// non-zero inside
    #[arg(long, value_name = "FILE", requires = "truth", hide_short_help = true, help_heading = "Scoring")]
    mask: Option<PathBuf>,
    /// Vertical reference of the truth's heights: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says]
    #[arg(
        long,
        value_name = "REFERENCE",
        requires = "truth",
        hide_short_help = true,
        help_heading = "Scoring"
    )]
    truth_vertical: Option<String>,
    /// EPSG code of a point cloud that does not state its own
    #[arg(long, value_name = "EPSG", requires = "truth", hide_short_help = true, help_heading = "Scoring")]
    truth_crs: Option<u32>,
}

impl TruthOptionArgs {
    /// The options as the library takes them.
    pub(super) fn options(&self, overwrite: bool) -> EvaluateOptions {
        EvaluateOptions {
            classes: self.classes.clone(),
            mask: self.mask.clone(),
            vertical: self.truth_vertical.clone(),
            epsg: self.truth_crs,
            confidence: None,
            overwrite,
        }
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), CliError> {
    let options =
        EvaluateOptions { confidence: args.confidence.clone(), ..args.truth.options.options(args.overwrite) };
    show(&evaluate(&args.dsm, &args.truth.truth, &options, args.output.as_deref(), ui)?, ui)
}

/// Shows the scores.
pub(super) fn show(evaluation: &Evaluation, ui: &Ui) -> Result<(), CliError> {
    let scores = super::json(evaluation)?;
    ui.summary("dsm-eval", Some(&tables(&scores)), &scores)
}

/// The tables a user sees, their columns aligned.
fn tables(scores: &serde_json::Value) -> String {
    let mut out = String::new();
    for ScoreTable { head, rows, .. } in score_tables(scores) {
        let head = head.iter().map(|h| (*h).to_owned()).collect();
        let lines: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
        let width = |k: usize| lines.iter().map(|l| l[k].chars().count()).max().unwrap_or(0);
        for line in &lines {
            let cells: Vec<String> =
                line.iter().enumerate().map(|(k, cell)| format!("{cell:>0$}", width(k))).collect();
            let _ = writeln!(out, "{}", cells.join("  "));
        }
        out.push('\n');
    }
    if let Some(text) = expected_error_text(scores) {
        let _ = writeln!(out, "{text}\n");
    }
    let _ = writeln!(
        out,
        "{SCORE_NOTE}\n{} cells of land are scored, {} of water are not",
        scores["land_cells"], scores["water_cells"]
    );
    out
}
