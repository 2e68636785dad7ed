//! Outdated files of a run after a change: they are removed, with a message, or a message names the command that makes them again.
//!
//! | what changed | what was made from it |
//! |---|---|
//! | the adjustment | the training, and what follows from it: a message, because it may have taken hours |
//! | the splats | meshes and scores of views: removed; the surface model: a message |
//! | the surface model | its points, mesh, hillshade and ground: written again; its scores: removed |
//! | the place of the run | points, meshes and scores: removed |
//!
//! `report.html` is written again after each.

use super::products::Products;
use super::run_folder::stage::{Fingerprint, adjustment_fingerprint, hash_file, made_from};
use super::{PipelineError, evaluate};
use crate::io::{WriteError, read_json, remove_if_there};
use crate::progress::{Event, Progress};
use crate::run_files::{
    ABOVE_GROUND, ADJUSTMENT, CONFIDENCE, DSM, EVALUATION, GROUND, HILLSHADE, MESHES, METRICS, NVS_PICTURES,
    NVS_SCORES, ORTHO, PLAN, SPLATS, STAGE, SURFACE, TRAIN_STAGE,
};
use std::path::{Path, PathBuf};

/// Products that move with the run; other files of these names are their owner's.
pub(super) const MOVED: [&str; 3] = [ABOVE_GROUND, GROUND, HILLSHADE];
/// The place of a mesh on the map, beside it.
const MESH_GEOREFERENCE: &str = "mesh.georef.json";

/// Says what is of the adjustment that has been replaced.
pub(super) fn after_adjustment(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    if run.join(PLAN).exists() {
        progress.event(Event::Warning(format!(
            "`{PLAN}` and its tiles are of the adjustment before; `satgs plan SCENE -o RUN --overwrite` plans again"
        )));
        return Ok(());
    }
    say_outdated(run, progress)
}

/// Removes what belongs to the splats that a training or a prediction has replaced.
pub(super) fn after_training(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    let scores = run.join(NVS_PICTURES);
    if scores.exists() {
        std::fs::remove_dir_all(&scores).map_err(|e| WriteError::new(&scores, e))?;
    }
    let gone = removed(run, [NVS_SCORES].into_iter().chain(meshes()).map(PathBuf::from))?;
    say(
        &gone,
        "belong to the old splats and are removed; `satgs nvs-eval` and `satgs mesh` make them again",
        progress,
    );
    Ok(())
}

/// Removes the scores of a surface model that has been replaced.
pub(crate) fn after_surface(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    remove_scores(run, "of the surface model before", progress)
}

/// Removes what still shows where the run was before it was moved.
pub(super) fn after_move(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    let moves = |path: &PathBuf| MOVED.iter().any(|name| path == Path::new(name));
    let products = Products::all(run).into_iter().filter(|path| !moves(path));
    let gone = removed(run, products.chain(meshes().map(PathBuf::from)))?;
    let text = "show the old position and are removed; `satgs dsm RUN` and `satgs mesh RUN` make them again";
    say(&gone, text, progress);
    remove_scores(run, "from before the move", progress)
}

/// Sentences that name the stages of a run whose input has been replaced since, and the commands that make them again.
pub(super) fn outdated(run: &Path) -> Result<Vec<String>, PipelineError> {
    let mut out = Vec::new();
    let adjustment = adjustment_fingerprint(run);
    if let Some(train) = record(run, TRAIN_STAGE)?
        && run.join(ADJUSTMENT).join(STAGE).exists()
        && differs(&train, &adjustment)
    {
        out.push(format!(
            "`{SPLATS}` and all that follows from it are of another adjustment than `{ADJUSTMENT}` holds; \
             `satgs train RUN --overwrite` trains on this one"
        ));
    }
    let sources = [("splats", SPLATS), ("surface", SURFACE)];
    let sources = sources.map(|(key, name)| (key.to_owned(), hash_file(&run.join(name))));
    if let Some(dsm) = record(run, "dsm")?
        && run.join(DSM).exists()
        && differs(&dsm, &Fingerprint::from(sources))
    {
        out.push(format!(
            "`{DSM}`, `{ORTHO}`, `{CONFIDENCE}` and what was made of them are of another training than `{SPLATS}`; \
             `satgs dsm RUN --overwrite` renders this one"
        ));
    }
    Ok(out)
}

/// Says which stages are outdated.
pub(super) fn say_outdated(run: &Path, progress: &dyn Progress) -> Result<(), PipelineError> {
    outdated(run)?.into_iter().for_each(|text| progress.event(Event::Warning(text)));
    Ok(())
}

/// What a complete stage was made from.
fn record(run: &Path, stage: &str) -> Result<Option<Fingerprint>, PipelineError> {
    let path = run.join(stage).join(STAGE);
    path.exists().then(|| made_from(&path)).transpose()
}

/// Whether a stage was made from another one of the things that `present` holds.
fn differs(stage: &Fingerprint, present: &Fingerprint) -> bool {
    present.iter().any(|(key, value)| stage.get(key).is_some_and(|before| before != value))
}

/// Removes the scores of the run's surface model; those of another file in the same folder stay.
fn remove_scores(run: &Path, whose: &str, progress: &dyn Progress) -> Result<(), PipelineError> {
    let folder = run.join(EVALUATION);
    let metrics: Option<serde_json::Value> = read_json(&folder.join(METRICS)).ok();
    let scored = metrics.as_ref().and_then(|m| m["prediction"].as_str());
    let is_own = scored.is_some_and(|scored| {
        let place = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.into());
        // A relative path counts from where the command was called, which may have been elsewhere.
        let ends_alike = Path::new(scored).is_relative() && Path::new(scored).ends_with(DSM);
        ends_alike || place(Path::new(scored)) == place(&run.join(DSM))
    });
    if !is_own {
        return Ok(());
    }
    let files = evaluate::files().map(|name| Path::new(EVALUATION).join(name));
    let gone = removed(run, files)?;
    if !gone.is_empty() {
        progress.event(Event::Note(format!(
            "the scores in `{}` are {whose} and are removed; `satgs dsm-eval` scores this one",
            folder.display()
        )));
    }
    Ok(())
}

/// Removes files of a run; returns those that were there. Files outside of the run folder are left alone.
fn removed(run: &Path, names: impl Iterator<Item = PathBuf>) -> Result<Vec<PathBuf>, WriteError> {
    let mut gone = Vec::new();
    for name in names.filter(|name| name.is_relative()) {
        let path = run.join(&name);
        if path.exists() {
            remove_if_there(&path)?;
            gone.push(name);
        }
    }
    Ok(gone)
}

/// Names of the files of meshes.
fn meshes() -> impl Iterator<Item = &'static str> {
    MESHES.into_iter().chain([MESH_GEOREFERENCE])
}

/// Says what happened to files.
fn say(files: &[PathBuf], text: &str, progress: &dyn Progress) {
    let mut names: Vec<String> = files.iter().map(|path| format!("`{}`", path.display())).collect();
    names.dedup();
    if !names.is_empty() {
        progress.event(Event::Note(format!("{} {text}", names.join(", "))));
    }
}
