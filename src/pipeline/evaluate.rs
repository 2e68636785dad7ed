//! Scores of a surface model against a reference: `satgs dsm-eval`.

use super::PipelineError;
use super::product_lists::list_products;
use crate::dsm::{EXPECTED_ERROR_BAND, VIEWS_BAND, is_confirmed};
use crate::io::{Cog, ImageFile, VerticalReference, check_writable, write_file};
use crate::metrics::{
    self, Evaluation, Evidence, HeightRaster, Method, Truth, TruthOptions, error_figure, error_style,
};
use crate::progress::{Event, Progress};
use crate::report::{FIGURES, figures};
use crate::run_files::{CONFIDENCE, DSM, ERROR_MAP, EVALUATION, METRICS};
use std::path::{Path, PathBuf};

/// Files of an evaluation besides the scores, the error map and the figures.
const ERROR_STYLE: &str = "error.qml";
const ERROR_PICTURE: &str = "error.png";
/// Largest difference of the grids of a surface model and its confidence, cells.
const SAME_GRID: f64 = 1e-3;

/// How the truth is read, and which parts of it are scored.
#[derive(Clone, Debug, Default)]
pub struct EvaluateOptions {
    /// Class raster on the truth's grid; by default DFC2019's `X_CLS.tif` beside `X_DSM.tif`, or the classes of points.
    pub classes: Option<PathBuf>,
    /// Polygons, or a raster on the truth's grid that is not 0 inside: inside and outside are scored separately.
    pub mask: Option<PathBuf>,
    /// Vertical reference of the truth's heights: `ellipsoid`, a geoid model or a geoid's grid; by default what the file
    /// says.
    pub vertical: Option<String>,
    /// EPSG code of a point cloud that does not state its own.
    pub epsg: Option<u32>,
    /// The confidence of the surface model, as `satgs dsm` writes it; by default `confidence.tif` beside the surface model
    /// if it has the same cells. With it, confirmed and filled cells are scored separately.
    pub confidence: Option<PathBuf>,
    /// Replace files of an earlier evaluation.
    pub overwrite: bool,
}

impl EvaluateOptions {
    /// As [`Truth::read`] takes them.
    pub(crate) fn truth_options(&self) -> Result<TruthOptions<'_>, PipelineError> {
        Ok(TruthOptions {
            classes: self.classes.as_deref(),
            mask: self.mask.as_deref(),
            vertical: self.vertical.as_deref().map(VerticalReference::read).transpose()?,
            epsg: self.epsg,
        })
    }
}

/// Scores a surface model against a truth, both rasters on a map grid in metres, or points for the truth. With a folder
/// `output`, writes scores, error map and figures there.
///
/// # Errors
/// [`PipelineError`]: a file cannot be read, has no place on the map or no ground in common with the other, an output
/// exists or cannot be written.
pub fn evaluate(
    dsm: &Path,
    truth: &Path,
    options: &EvaluateOptions,
    output: Option<&Path>,
    progress: &dyn Progress,
) -> Result<Evaluation, PipelineError> {
    if let Some(folder) = output {
        refuse_to_replace(folder, options.overwrite)?;
    }
    let truth_options = options.truth_options()?;
    let inputs = format!("{}, {}", dsm.display(), truth.display());
    let prediction = HeightRaster::read(dsm)?;
    let truth = Truth::read(truth, &truth_options, &prediction.grid)?;
    if let Some(folder) = output {
        check_writable(&folder.join(METRICS))?;
    }
    progress.check()?;
    let evidence = evidence(&prediction, options.confidence.as_deref())?;
    let evaluation = metrics::evaluate(prediction, evidence, truth)?;
    for note in &evaluation.notes {
        progress.event(Event::Note(note.clone()));
    }
    if let Some(folder) = output {
        write_files(&evaluation, &inputs, folder)?;
        let is_of_run = folder.file_name().is_some_and(|name| name == EVALUATION);
        if let Some(run) = folder.parent().filter(|run| is_of_run && run.join(DSM).exists()) {
            // The layers of the run have the error map.
            list_products(run)?;
        }
    }
    Ok(evaluation)
}

/// What the confidence of a surface model says of its cells; none without one, or if its views are not counted. A file that
/// was not asked for is passed over unless it is a confidence of the same cells.
pub(super) fn evidence(
    prediction: &HeightRaster,
    asked: Option<&Path>,
) -> Result<Option<Evidence>, PipelineError> {
    let beside = prediction.path.with_file_name(CONFIDENCE);
    if asked.is_none() && !beside.exists() {
        return Ok(None);
    }
    let path = asked.unwrap_or(&beside);
    let bands = ImageFile::open(path).and_then(|file| {
        let is_same = file.map_grid()?.is_same(&prediction.grid, SAME_GRID);
        let band = |band| (is_same && file.bands() >= band).then(|| file.read(band)).transpose();
        Ok(band(VIEWS_BAND)?.map(|views| (views, band(EXPECTED_ERROR_BAND))))
    });
    match (bands, asked) {
        (Ok(Some((views, expected_error))), _) => {
            let are_counted = views.valid().next().is_some();
            let confirmed = views.data.iter().map(|views| is_confirmed(*views)).collect();
            let expected_error =
                if asked.is_some() { expected_error? } else { expected_error.ok().flatten() };
            Ok(are_counted.then_some(Evidence { confirmed, expected_error }))
        }
        (Err(source), Some(_)) => Err(source.into()),
        (Ok(None), Some(_)) => {
            Err(PipelineError::OtherCells { path: path.into(), dsm: prediction.path.clone() })
        }
        (_, None) => Ok(None),
    }
}

/// Names of the files of an evaluation.
pub(super) fn files() -> impl Iterator<Item = &'static str> {
    [METRICS, ERROR_MAP, ERROR_STYLE, ERROR_PICTURE].into_iter().chain(FIGURES)
}

fn refuse_to_replace(folder: &Path, overwrite: bool) -> Result<(), PipelineError> {
    if overwrite {
        return Ok(());
    }
    for name in files() {
        let path = folder.join(name);
        if path.exists() {
            return Err(PipelineError::Exists { path });
        }
    }
    Ok(())
}

/// Writes the scores, and the errors after `xyz` as a map and figures.
fn write_files(evaluation: &Evaluation, inputs: &str, folder: &Path) -> Result<(), PipelineError> {
    // As a value first, so that its keys are in the order of those that --json prints.
    let not_json = |source| PipelineError::Json { what: "the scores", source };
    let json = serde_json::to_value(evaluation).map_err(not_json)?;
    let text = serde_json::to_string_pretty(&json).map_err(not_json)?;
    write_file(&folder.join(METRICS), text + "\n")?;
    let Some(scores) = evaluation.registered_scores(Method::Xyz) else { return Ok(()) };
    let errors = evaluation.error_map(&scores.registration)?;
    let r = scores.registration;
    let moved = format!("{:.3} m east, {:.3} m north, {:.3} m up", scores.east_m, scores.north_m, r.dz_m);
    let metadata = [
        ("INPUTS", inputs.to_owned()),
        ("TIFFTAG_IMAGEDESCRIPTION", "registered prediction minus truth".to_owned()),
        ("PREDICTION_MOVED", moved),
    ];
    let cog = Cog { grid: evaluation.grid, metadata: &metadata, heights_from: None };
    cog.write_f32(&folder.join(ERROR_MAP), &[("error", "m", &errors)])?;
    write_file(&folder.join(ERROR_STYLE), error_style())?;
    let picture = error_figure(&errors, evaluation.cell_m, &metrics::ERRORS);
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
