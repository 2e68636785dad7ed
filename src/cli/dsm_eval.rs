//! `satgs dsm-eval`: a surface model against the truth, in a table, a JSON file, an error map and figures.

use super::{Failure, Ui};
use crate::io::{Cog, VerticalReference, check_writable, write_file};
use crate::metrics::{
    Evaluation, HeightRaster, Method, Truth, TruthOptions, error_picture, error_style, evaluate,
};
use crate::report::{FIGURES, SCORE_NOTE, ScoreTable, figures, score_tables};
use crate::run_files::{ERROR_MAP, METRICS};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What `-o` receives, beside the figures.
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
  satgs dsm-eval dsm.tif lidar.tif --mask roofs.gpkg --truth-vertical EGM96")]
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
    #[command(flatten)]
    options: TruthOptionArgs,
}

/// How the truth is to be read; `satgs run --truth` takes them too.
#[derive(clap::Args, Clone, Debug)]
#[group(id = "scoring")]
pub(super) struct TruthOptionArgs {
    /// Class raster on the truth's grid, class 9 is water [default: X_CLS.tif beside X_DSM.tif, or the points' classes]
    #[arg(long, value_name = "CLS.tif", requires = "truth")]
    classes: Option<PathBuf>,
    /// Score inside and outside of this apart: polygons (any vector file), or a raster on the truth's grid, not 0 inside
    #[arg(long, value_name = "FILE", requires = "truth")]
    mask: Option<PathBuf>,
    /// What the truth's heights count from: `ellipsoid`, EGM84, EGM96, EGM2008 or a geoid grid (.gtx, .tif of PROJ)
    /// [default: as its CRS or VERTICAL_REFERENCE says]
    #[arg(long, value_name = "REFERENCE", requires = "truth")]
    truth_vertical: Option<String>,
    /// EPSG code of the truth's points, where their file does not tell
    #[arg(long, value_name = "EPSG", requires = "truth")]
    truth_crs: Option<u32>,
}

impl TruthOptionArgs {
    /// As the library takes them.
    pub(super) fn options(&self) -> Result<TruthOptions<'_>, Failure> {
        Ok(TruthOptions {
            classes: self.classes.as_deref(),
            mask: self.mask.as_deref(),
            vertical: self.truth_vertical.as_deref().map(VerticalReference::read).transpose()?,
            epsg: self.truth_crs,
        })
    }
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    if let Some(folder) = &args.output {
        refuse_to_replace(folder, args.overwrite)?;
    }
    let options = args.truth.options.options()?;
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
    let inputs = format!("{}, {}", dsm.display(), truth.display());
    let prediction = HeightRaster::read(dsm)?;
    let truth = Truth::read(truth, options, &prediction.grid)?;
    if let Some(folder) = output {
        check_writable(&folder.join(METRICS))?;
    }
    let evaluation = evaluate(prediction, truth)?;
    for note in &evaluation.notes {
        ui.note(note);
    }
    if let Some(folder) = output {
        write_files(&evaluation, &inputs, folder)?;
    }
    let scores = json(&evaluation)?;
    ui.summary("dsm-eval", &tables(&scores), scores);
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
fn write_files(evaluation: &Evaluation, inputs: &str, folder: &Path) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(&json(evaluation)?).map_err(not_json)?;
    write_file(&folder.join(METRICS), text + "\n")?;
    let Some(registered_scores) = evaluation.registered_scores(Method::Xyz) else { return Ok(()) };
    let errors = evaluation.error_map(&registered_scores.registration)?;
    let r = registered_scores.registration;
    let moved = format!(
        "{:.3} m east, {:.3} m north, {:.3} m up",
        registered_scores.east_m, registered_scores.north_m, r.dz_m
    );
    let metadata = [
        ("INPUTS", inputs.to_owned()),
        ("TIFFTAG_IMAGEDESCRIPTION", "registered prediction minus truth".to_owned()),
        ("PREDICTION_MOVED", moved),
    ];
    let cog = Cog { grid: evaluation.grid, metadata: &metadata, heights_from: None };
    cog.write_f32(&folder.join(ERROR_MAP), &[("error", "m", &errors)])?;
    write_file(&folder.join(ERROR_STYLE), error_style())?;
    let picture = error_picture(&errors);
    picture.write(&folder.join(ERROR_PICTURE))?;
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
    let _ = writeln!(
        out,
        "{SCORE_NOTE}\n{} cells of land, {} of water left out",
        scores["land_cells"], scores["water_cells"]
    );
    out
}
