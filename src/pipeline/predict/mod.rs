//! Splats predicted from points in one pass: `satgs predict`.

mod photographs;
mod points;
mod satellites;
mod splats;

use super::stage::{Fingerprint, Outcome, Stage, hash_file, or_none};
use super::{PipelineError, RunLock, perspective};
use crate::frame::SiteGrid;
use crate::io::{read_georeference, read_json, remove_if_there};
use crate::perspective::{PerspectiveOptions, PerspectiveScene};
use crate::predict::{CleanUp, Predictor};
use crate::progress::{Event, Progress};
use crate::run_files::{CAMERAS, PREDICT_STAGE, PREDICTED, PREDICTED_LIGHTS, SCENE, SPLATS, STAGE};
use crate::splat::appearance::Appearance;
use crate::splat::ply;
use crate::splat::splats::Splats;
pub use points::ENDINGS;
pub(super) use points::of_surface;
use serde::{Deserialize, Serialize};
pub(super) use splats::{of_photographed_points, of_points};
use std::path::{Path, PathBuf};

/// How to predict.
#[derive(Clone, Debug, Default)]
pub struct PredictOptions {
    /// File of points; by default those of the run: its matched surface, else its sparse points; of a perspective scene its points.
    pub points: Option<PathBuf>,
    /// File of a model; by default the one of the program.
    pub model: Option<PathBuf>,
    /// Make splats without a network, to compare with.
    pub without_network: Option<Untrained>,
    /// How a perspective scene is read.
    pub perspective: PerspectiveOptions,
    /// Replace a prediction that was made from other things.
    pub overwrite: bool,
}

/// Splats of points without a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Untrained {
    /// An isotropic one for each point.
    Isotropic,
    /// A flat one along the surface for each point.
    Flat,
}

/// Figures of a prediction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Predicted {
    /// Where the points come from.
    pub points: String,
    /// What clean-up left of them.
    pub clean_up: CleanUp,
    /// Typical distance of the points, metres.
    pub spacing_m: f64,
    /// Number of splats.
    pub splats: usize,
    /// Seconds from the points to the splats.
    pub seconds: f64,
}

/// Predicts the splats of an adjusted run, of the run of a perspective scene or of such a scene, from points in one pass. Writes them
/// to the run folder `out`, which all commands take that work on trained runs; `train` goes on from them.
///
/// # Errors
/// [`PipelineError`]: the run is not adjusted or is in use, the images are gone, there are too few points in the area, the model
/// or a file of points cannot be used, a file cannot be written, or `progress` asks to stop.
pub fn predict(
    run: &Path,
    out: &Path,
    options: &PredictOptions,
    progress: &dyn Progress,
) -> Result<Outcome<Predicted>, PipelineError> {
    if PerspectiveScene::is_one(run) && !run.join(SCENE).exists() {
        return photographs::predict_scene(run, out, options, progress);
    }
    let _lock = RunLock::existing(run)?;
    if perspective::is_run(run) {
        photographs::predict_run(run, out, options, progress)
    } else {
        satellites::predict(run, out, options, progress)
    }
}

/// The folder of a prediction, locked.
struct Output<'a> {
    folder: &'a Path,
    stage: Stage,
    _lock: RunLock,
}

impl<'a> Output<'a> {
    /// Locks the folder for a prediction that is made from these things and the options. The second value is the summary of the
    /// same prediction, if it is complete.
    fn open(
        folder: &'a Path,
        made_from: Fingerprint,
        options: &PredictOptions,
        progress: &dyn Progress,
    ) -> Result<(Self, Option<Outcome<Predicted>>), PipelineError> {
        let lock = RunLock::make(folder)?;
        let mut made_from = made_from;
        let model = options.model.as_deref().map_or_else(|| "the model of the program".into(), hash_file);
        let untrained = options.without_network.map(|kind| match kind {
            Untrained::Isotropic => "isotropic",
            Untrained::Flat => "flat",
        });
        made_from.insert("--model".into(), model);
        made_from.insert("--without-network".into(), or_none(untrained));
        let outputs = [SPLATS, CAMERAS, PREDICTED].map(|name| folder.join(name)).into();
        let stage = Stage::new(folder, PREDICT_STAGE, outputs, made_from);
        if stage.is_done(options.overwrite)? {
            progress.event(Event::Note(format!("`{}` is predicted already", folder.display())));
            let kept = Outcome::Kept(stage.summary()?);
            return Ok((Self { folder, stage, _lock: lock }, Some(kept)));
        }
        if folder.join(SCENE).exists() && !folder.join(PREDICTED).exists() {
            return Err(PipelineError::OtherRun { run: folder.into() });
        }
        stage.require_writable()?;
        // What was trained from an earlier prediction is replaced.
        remove_if_there(&folder.join("train").join(STAGE))?;
        Ok((Self { folder, stage, _lock: lock }, None))
    }

    /// Records the prediction, whose other files are written.
    fn complete(&self, predicted: Predicted) -> Result<Outcome<Predicted>, PipelineError> {
        self.stage.complete(&predicted)?;
        Ok(Outcome::Made(predicted))
    }
}

/// The model that is asked for.
fn read_model(options: &PredictOptions) -> Result<Predictor, PipelineError> {
    Ok(match &options.model {
        Some(path) => Predictor::read(path)?,
        None => Predictor::built_in()?,
    })
}

/// The splats that a training of this run begins with if it was predicted, and the colour models of its views, which photographs do
/// not have; none if it was not. `site` is the frame of the training, which a later alignment may have moved against that of the
/// splats.
pub(super) fn read_predicted(
    run: &Path,
    site: Option<&SiteGrid>,
) -> Result<Option<(Splats, Vec<Appearance>)>, PipelineError> {
    if !run.join(PREDICTED).exists() {
        return Ok(None);
    }
    let made_by = "`satgs predict RUN -o RUN2 --overwrite` makes it";
    let lights: Vec<(String, Appearance)> = read_json(&run.join(PREDICTED_LIGHTS))
        .map_err(|source| PipelineError::RunFile { source, made_by })?;
    let mut splats = ply::read(&run.join(PREDICTED))?;
    let own = read_georeference(&run.join(PREDICTED))
        .map_err(|source| PipelineError::RunFile { source, made_by })?;
    if let Some((own, site)) = own.zip(site) {
        let [x, y, z] = (own.origin - site.origin).xyz().map(|v| v as f32);
        splats.position.iter_mut().for_each(|p| *p = [p[0] + x, p[1] + y, p[2] + z]);
    }
    Ok(Some((splats, lights.into_iter().map(|(_, light)| light).collect())))
}
