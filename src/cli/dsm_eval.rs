//! `satgs dsm-eval`: a surface model against the truth, in a table, a JSON file and an error map.

use super::{Failure, Ui};
use crate::metrics::{Evaluation, Method, Surface, Truth, Verdict, class_name, error_picture, evaluate};
use crate::raster::{Cog, write_file, write_png_rgb};
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What `-o` receives.
const METRICS: &str = "metrics.json";
const ERROR_MAP: &str = "error.tif";
const ERROR_PICTURE: &str = "error.png";

/// Score a surface model against lidar: errors after three registrations, completeness, error map
#[derive(clap::Args)]
#[command(after_help = "\
Registrations: z adds the median height offset (MAE_reg of the BAEOGS paper), ncc shifts by whole cells to the
best correlation and adds the mean offset (EOGS), xyz is the shift and offset of the smallest MAE.
dx, dy: where the prediction is sampled, in cells; east, north, dz: how far it is moved by that, in metres.
Without classes water is scored like land. No MAE counts below a completeness of 0.99.

Examples:
  satgs dsm-eval run/dsm.tif JAX_068_DSM.tif         finds JAX_068_DSM.txt and JAX_068_CLS.tif by name
  satgs dsm-eval dsm.tif lidar.tif -o eval --json    writes metrics.json, error.tif, error.png")]
pub struct Args {
    /// The surface model: a raster with a map grid in metres
    dsm: PathBuf,
    /// The truth: a raster with a map grid, or DFC2019's X_DSM.tif with X_DSM.txt beside it
    truth: PathBuf,
    /// Folder for metrics.json, error.tif and error.png (errors after xyz)
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Class raster on the truth's grid, class 9 is water [default: X_CLS.tif beside X_DSM.tif]
    #[arg(long, value_name = "CLS.tif")]
    classes: Option<PathBuf>,
    /// Replace files that are in the output folder
    #[arg(long)]
    overwrite: bool,
}

/// Runs the command.
pub fn run(args: &Args, ui: &Ui) -> Result<(), Failure> {
    if let Some(folder) = &args.output {
        refuse_to_replace(folder, args.overwrite)?;
    }
    score(&args.dsm, &args.truth, args.classes.as_deref(), args.output.as_deref(), ui)
}

/// Scores a surface model, shows the table, and writes the files into `output`.
pub(super) fn score(
    dsm: &Path,
    truth: &Path,
    classes: Option<&Path>,
    output: Option<&Path>,
    ui: &Ui,
) -> Result<(), Failure> {
    let evaluation = evaluation(dsm, truth, classes)?;
    for note in &evaluation.notes {
        ui.note(note);
    }
    if let Some(folder) = output {
        write_files(&evaluation, folder)?;
    }
    ui.summary("dsm-eval", &table(&evaluation), json(&evaluation)?);
    Ok(())
}

/// Reads both rasters and scores the first against the second.
fn evaluation(dsm: &Path, truth: &Path, classes: Option<&Path>) -> Result<Evaluation, Failure> {
    let prediction = Surface::read(dsm)?;
    let truth = Truth::read(truth, classes, prediction.grid.epsg)?;
    Ok(evaluate(&prediction, &truth)?)
}

fn refuse_to_replace(folder: &Path, overwrite: bool) -> Result<(), Failure> {
    if overwrite {
        return Ok(());
    }
    for name in [METRICS, ERROR_MAP, ERROR_PICTURE] {
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

/// Writes metrics.json, error.tif and error.png, the errors after `xyz`.
pub(super) fn write_files(evaluation: &Evaluation, folder: &Path) -> Result<(), Failure> {
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
    write_png_rgb(&folder.join(ERROR_PICTURE), errors.width, errors.height, &error_picture(&errors))?;
    Ok(())
}

/// The evaluation as the JSON object of `--json` and metrics.json.
pub(super) fn json(evaluation: &Evaluation) -> Result<serde_json::Value, Failure> {
    serde_json::to_value(evaluation).map_err(not_json)
}

fn not_json(e: serde_json::Error) -> Failure {
    Failure { message: format!("the scores do not fit JSON: {e}"), hint: None, exit_code: 1 }
}

/// The table a user sees: one row a registration, then MAE by class.
pub(super) fn table(evaluation: &Evaluation) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{:>8} {:>7} {:>7} {:>7} {:>7} {:>7} {:>9} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7}",
        "metres",
        "MAE",
        "RMSE",
        "NMAD",
        "median",
        "LE90",
        "complete",
        "filled",
        "dx",
        "dy",
        "east",
        "north",
        "dz"
    );
    for v in &evaluation.verdicts {
        let (r, s) = (&v.registration, &v.scores);
        let _ = writeln!(
            out,
            "{:>8} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>7.3} {:>9.4} {:>7.3} {:>7.2} {:>7.2} {:>+7.2} {:>+7.2} \
             {:>+7.3}",
            r.method.name(),
            s.mae_m,
            s.rmse_m,
            s.nmad_m,
            s.median_m,
            s.le90_m,
            s.completeness,
            s.filled_mae_m,
            r.dx_cells,
            r.dy_cells,
            v.east_m,
            v.north_m,
            r.dz_m
        );
    }
    let _ = writeln!(
        out,
        "median: of |error|; filled: MAE with holes filled by the nearest cell; dx, dy in cells\n\
         {} cells of land, {} of water left out",
        evaluation.land_cells, evaluation.water_cells
    );
    class_table(&mut out, &evaluation.verdicts);
    out
}

fn class_table(out: &mut String, verdicts: &[Verdict]) {
    let classes: BTreeSet<u8> = verdicts.iter().flat_map(|v| v.scores.by_class.keys().copied()).collect();
    if classes.is_empty() {
        return;
    }
    let _ = write!(out, "\n{:>14} {:>9}", "MAE by class", "cells");
    for v in verdicts {
        let _ = write!(out, " {:>7}", v.registration.method.name());
    }
    out.push('\n');
    for class in classes {
        let cells = verdicts[0].scores.by_class.get(&class).map_or(0, |c| c.cells);
        let _ = write!(out, "{:>14} {cells:>9}", format!("{class} {}", class_name(class)));
        for v in verdicts {
            let mae = v.scores.by_class.get(&class).map_or(f64::NAN, |c| c.mae_m);
            let _ = write!(out, " {mae:>7.3}");
        }
        out.push('\n');
    }
}
