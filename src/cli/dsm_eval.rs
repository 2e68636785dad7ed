//! `satgs dsm-eval`: a surface model against the truth, in a table, a JSON file, an error map and figures.

use super::{Failure, Ui};
use crate::metrics::{
    Evaluation, Method, Scores, Surface, Truth, TruthOptions, error_picture, error_style, evaluate,
};
use crate::raster::{Cog, Vertical, write_file, write_png_rgb};
use crate::report::{FIGURES, figures};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What `-o` receives, beside the figures.
const METRICS: &str = "metrics.json";
const ERROR_MAP: &str = "error.tif";
const ERROR_STYLE: &str = "error.qml";
const ERROR_PICTURE: &str = "error.png";

/// Score a surface model against lidar: errors after three registrations, by class, at edges, on slopes; error map
#[derive(clap::Args)]
#[command(after_help = "\
Registrations: z adds the median height offset (MAE_reg of the BAEOGS paper), ncc shifts by whole cells to the
best correlation and adds the mean offset (EOGS), xyz is the shift and offset of the smallest MAE.
dx, dy: where the prediction is sampled, in cells; east, north, dz: how far it is moved by that, in metres.
Without classes water is scored like land. No MAE counts below a completeness of 0.99.

Examples:
  satgs dsm-eval run/dsm.tif JAX_068_DSM.tif         finds JAX_068_DSM.txt and JAX_068_CLS.tif by name
  satgs dsm-eval dsm.tif lidar.laz -o eval           the highest point of every cell; writes map and figures
  satgs dsm-eval dsm.tif lidar.tif --mask roofs.gpkg --truth-vertical us_nga_egm96_15.tif")]
pub struct Args {
    /// The surface model: a raster with a map grid in metres
    dsm: PathBuf,
    #[command(flatten)]
    truth: TruthArgs,
    /// Folder for metrics.json, error.tif with its QGIS style, error.png and figures (errors after xyz)
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Replace files that are in the output folder
    #[arg(long)]
    overwrite: bool,
}

/// The truth and what it is divided by.
#[derive(clap::Args)]
struct TruthArgs {
    /// The truth: a raster with a map grid, DFC2019's X_DSM.tif with X_DSM.txt beside it, or points (.las, .laz)
    truth: PathBuf,
    /// Class raster on the truth's grid, class 9 is water [default: X_CLS.tif beside X_DSM.tif, or the points' classes]
    #[arg(long, value_name = "CLS.tif")]
    classes: Option<PathBuf>,
    /// Score inside and outside of this apart: polygons (any vector file), or a raster on the truth's grid, not 0 inside
    #[arg(long, value_name = "FILE")]
    mask: Option<PathBuf>,
    /// What the truth's heights count from: `ellipsoid`, or a geoid grid (.gtx, .tif of PROJ) that is added to them
    #[arg(long, value_name = "ellipsoid|GRID")]
    truth_vertical: Option<String>,
    /// EPSG code of the truth's points, where their file does not tell
    #[arg(long, value_name = "EPSG")]
    truth_crs: Option<u32>,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    if let Some(folder) = &args.output {
        refuse_to_replace(folder, args.overwrite)?;
    }
    let options = TruthOptions {
        classes: args.truth.classes.as_deref(),
        mask: args.truth.mask.as_deref(),
        vertical: args.truth.truth_vertical.as_deref().map(Vertical::read).transpose()?,
        epsg: args.truth.truth_crs,
    };
    score(&args.dsm, &args.truth.truth, &options, args.output.as_deref(), ui)
}

/// Scores a surface model, shows the table, and writes the files into `output`.
pub(super) fn score(
    dsm: &Path,
    truth: &Path,
    options: &TruthOptions,
    output: Option<&Path>,
    ui: &Ui,
) -> Result<(), Failure> {
    let prediction = Surface::read(dsm)?;
    let truth = Truth::read(truth, options, &prediction.grid)?;
    let evaluation = evaluate(prediction, truth)?;
    for note in &evaluation.notes {
        ui.note(note);
    }
    if let Some(folder) = output {
        write_files(&evaluation, folder)?;
    }
    ui.summary("dsm-eval", &table(&evaluation), json(&evaluation)?);
    Ok(())
}

fn refuse_to_replace(folder: &Path, overwrite: bool) -> Result<(), Failure> {
    if overwrite {
        return Ok(());
    }
    for name in [METRICS, ERROR_MAP, ERROR_STYLE, ERROR_PICTURE].into_iter().chain(FIGURES) {
        let path = folder.join(name);
        if path.exists() {
            return Err(Failure::input(
                format!("`{}` exists", path.display()),
                "--overwrite replaces it, another -o keeps both",
            ));
        }
    }
    Ok(())
}

/// Writes the scores, and the errors after `xyz` as a map and figures.
fn write_files(evaluation: &Evaluation, folder: &Path) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(&json(evaluation)?).map_err(not_json)?;
    write_file(&folder.join(METRICS), text + "\n")?;
    let Some(verdict) = evaluation.verdict(Method::Xyz) else { return Ok(()) };
    let errors = evaluation.error_map(&verdict.registration)?;
    let r = verdict.registration;
    let moved = format!("{:.3} m east, {:.3} m north, {:.3} m up", verdict.east_m, verdict.north_m, r.dz_m);
    let metadata = [
        ("TIFFTAG_SOFTWARE", format!("satgs {}", env!("CARGO_PKG_VERSION"))),
        ("TIFFTAG_IMAGEDESCRIPTION", "registered prediction minus truth".to_owned()),
        ("PREDICTION_MOVED", moved),
    ];
    let cog = Cog { grid: evaluation.grid, metadata: &metadata, heights_from: None };
    cog.write_f32(&folder.join(ERROR_MAP), &[("error", "m", &errors)])?;
    write_file(&folder.join(ERROR_STYLE), error_style())?;
    let picture = error_picture(&errors);
    write_png_rgb(&folder.join(ERROR_PICTURE), picture.width, picture.height, &picture.rgb)?;
    for name in FIGURES {
        // Figures of an earlier truth that had classes would stay.
        let _ = std::fs::remove_file(folder.join(name));
    }
    for (name, svg) in figures(evaluation, &errors) {
        write_file(&folder.join(name), svg)?;
    }
    Ok(())
}

/// The evaluation as the JSON object of `--json` and metrics.json.
fn json(evaluation: &Evaluation) -> Result<serde_json::Value, Failure> {
    serde_json::to_value(evaluation).map_err(not_json)
}

fn not_json(e: serde_json::Error) -> Failure {
    Failure { message: format!("the scores do not fit JSON: {e}"), hint: None, exit_code: 1 }
}

/// The table a user sees: the registrations, the scores after each, and after the last those of parts of the land.
fn table(evaluation: &Evaluation) -> String {
    let mut out = format!(
        "{:>12} {:>8} {:>8} {:>8} {:>8} {:>8}\n",
        "registration", "dx cells", "dy cells", "east m", "north m", "dz m"
    );
    for v in &evaluation.verdicts {
        let r = &v.registration;
        let _ = writeln!(
            out,
            "{:>12} {:>8.2} {:>8.2} {:>+8.2} {:>+8.2} {:>+8.3}",
            r.method.name(),
            r.dx_cells,
            r.dy_cells,
            v.east_m,
            v.north_m,
            r.dz_m
        );
    }
    let _ = writeln!(
        out,
        "\n{:>27} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>6} {:>5} {:>5} {:>5} {:>8} {:>9}",
        "metres",
        "MAE",
        "filled",
        "RMSE",
        "bias",
        "median",
        "NMAD",
        "LE90",
        "LE95",
        "<0.5m",
        "<1m",
        "<2m",
        "complete",
        "cells"
    );
    for v in &evaluation.verdicts {
        row(&mut out, &format!("all, {}", v.registration.method.name()), &v.scores);
    }
    let last = evaluation.verdicts.last();
    for stratum in last.into_iter().flat_map(|v| &v.strata) {
        row(&mut out, &stratum.name, &stratum.scores);
    }
    let _ = writeln!(
        out,
        "filled: MAE with holes filled by the nearest cell; median: of |error|; <: % of cells; parts: after xyz\n\
         {} cells of land, {} of water left out",
        evaluation.land_cells, evaluation.water_cells
    );
    out
}

fn row(out: &mut String, name: &str, s: &Scores) {
    let [half, one, two] = s.within.map(|share| 100.0 * share);
    let _ = writeln!(
        out,
        "{name:>27} {:>6.3} {:>6.3} {:>6.3} {:>+6.2} {:>6.3} {:>6.3} {:>6.3} {:>6.3} {half:>5.1} {one:>5.1} {two:>5.1} \
         {:>8.4} {:>9}",
        s.mae_m,
        s.filled_mae_m,
        s.rmse_m,
        s.bias_m,
        s.median_m,
        s.nmad_m,
        s.le90_m,
        s.le95_m,
        s.completeness,
        s.cells
    );
}
