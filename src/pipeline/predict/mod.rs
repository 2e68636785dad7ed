//! Splats predicted from points in one pass: `satgs predict`.

mod belonging;
mod photographs;
mod points;
mod satellites;
mod splats;
mod start;

use super::run_folder::perspective_manifest;
use super::run_folder::stage::{Fingerprint, Outcome, Stage, hash_file, or_none};
use super::{PipelineError, RunLock, outdated, relocation};
use crate::io::{WriteError, remove_if_there};
use crate::perspective::{PerspectiveOptions, PerspectiveScene};
use crate::predict::{CleanUp, ImageNetwork, Model, Predictor};
use crate::progress::{Event, Progress};
use crate::run_files::{
    ADJUSTMENT, APPEARANCE, APPEARANCE_STAGE, CAMERAS, LOCK, PREDICT_STAGE, PREDICTED, SCENE, SPLATS,
    TRAIN_STAGE,
};
pub use points::ENDINGS;
pub(super) use points::of_surface;
use serde::{Deserialize, Serialize};
pub use splats::Untrained;
pub(super) use splats::{OF_PHOTOGRAPHS, of_photographed_points, of_points};
pub(super) use start::{prediction_of, read_predicted};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// How to predict.
#[derive(Clone, Debug, Default)]
pub struct PredictOptions {
    /// File of points; by default those of the run: its matched surface, else its sparse points; of a perspective scene its points.
    pub points: Option<PathBuf>,
    /// File of a model; by default the one of the program, of photographs none.
    pub model: Option<PathBuf>,
    /// ONNX file of the network of image features that the model was trained with.
    pub image_features: Option<PathBuf>,
    /// Make splats without a network, to compare with.
    pub without_network: Option<Untrained>,
    /// Take points of a file where they are. By default they are moved onto the tie points of a satellite scene.
    pub keeps_place: bool,
    /// How a perspective scene is read.
    pub perspective: PerspectiveOptions,
    /// Replace a prediction that was made from other things.
    pub overwrite: bool,
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

/// Predicts the splats of an adjusted run, or of a perspective scene or its run, from points in one pass. Writes them to the run
/// folder `out`, which all commands take that work on trained runs; `train` continues from them.
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
    if perspective_manifest::is_run(run) {
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
        mut made_from: Fingerprint,
        options: &PredictOptions,
        progress: &dyn Progress,
    ) -> Result<(Self, Option<Outcome<Predicted>>), PipelineError> {
        let lock = RunLock::make(folder)?;
        let model = options.model.as_deref().map_or_else(Model::built_in_hash, hash_file);
        let untrained = options.without_network.map(|kind| match kind {
            Untrained::Isotropic => "isotropic",
            Untrained::Flat => "flat",
        });
        made_from.insert("--model".into(), model);
        let features = options.image_features.as_deref().map(hash_file);
        made_from.insert("--image-features".into(), or_none(features.as_deref()));
        made_from.insert("--without-network".into(), or_none(untrained));
        let outputs = [SPLATS, CAMERAS, PREDICTED].map(|name| folder.join(name)).into();
        let stage = Stage::new(folder, PREDICT_STAGE, outputs, made_from);
        let output = Self { folder, stage, _lock: lock };
        // What is to be replaced stays until there is something in its place.
        if !options.overwrite && output.stage.is_done(false)? {
            progress.event(Event::Note(format!("`{}` is predicted already", folder.display())));
            let kept = Outcome::Kept(output.stage.summary()?);
            return Ok((output, Some(kept)));
        }
        if !folder.join(PREDICTED).exists() && holds_other_files(folder)? {
            return Err(PipelineError::OtherFiles { folder: folder.into() });
        }
        output.stage.require_writable()?;
        Ok((output, None))
    }

    /// Removes what an earlier prediction has left, and what was trained from it.
    fn clear(&self) -> Result<(), PipelineError> {
        if !self.folder.join(PREDICTED).exists() {
            return Ok(());
        }
        self.stage.forget()?;
        relocation::forget(self.folder)?;
        for name in [TRAIN_STAGE, APPEARANCE_STAGE, ADJUSTMENT] {
            let path = self.folder.join(name);
            let removed = std::fs::remove_dir_all(&path);
            removed
                .or_else(|e| if e.kind() == ErrorKind::NotFound { Ok(()) } else { Err(e) })
                .map_err(|e| WriteError::new(&path, e))?;
        }
        Ok(remove_if_there(&self.folder.join(APPEARANCE))?)
    }

    /// Records the prediction, whose other files are written.
    fn complete(
        &self,
        predicted: Predicted,
        progress: &dyn Progress,
    ) -> Result<Outcome<Predicted>, PipelineError> {
        self.stage.complete(&predicted)?;
        outdated::after_training(self.folder, progress)?;
        outdated::say_outdated(self.folder, progress)?;
        Ok(Outcome::Made(predicted))
    }
}

/// Whether a folder holds anything but what a prediction that was interrupted leaves: nothing of others is ever replaced.
fn holds_other_files(folder: &Path) -> Result<bool, PipelineError> {
    let failed = |e: std::io::Error| WriteError::new(folder, e);
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let name = entry.map_err(failed)?.file_name();
        if name != LOCK && name != PREDICT_STAGE {
            return Ok(true);
        }
    }
    Ok(false)
}

/// The model that is asked for.
fn read_model(options: &PredictOptions) -> Result<Predictor, PipelineError> {
    let model = match &options.model {
        Some(path) => Predictor::read(path)?,
        None => Predictor::built_in()?,
    };
    let features = options.image_features.as_deref().map(ImageNetwork::load).transpose()?;
    Ok(model.with_image_network(features)?)
}
