//! Maps of depths or normals of all images of a perspective scene: `satgs prior`.

use super::{PipelineError, RunLock};
use crate::perspective::{PerspectiveOptions, PerspectiveScene, PerspectiveView};
use crate::prior::{
    DepthKind, ExistingMaps, MadeMaps, PriorContent, PriorDescription, PriorFolder, PriorMaker, make_maps,
};
use crate::progress::{Event, Progress};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How maps are made.
#[derive(Clone, Copy, Debug)]
pub struct PriorMapOptions {
    /// What the maps are to hold.
    pub content: PriorContent,
    /// What the values of depths are, if that is known: `prior.json` says it to those who read the folder.
    pub kind: Option<DepthKind>,
    /// Make maps that exist anew.
    pub overwrite: bool,
}

impl Default for PriorMapOptions {
    fn default() -> Self {
        Self { content: PriorContent::Depths, kind: None, overwrite: false }
    }
}

/// A folder of maps that were made.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PriorMapSummary {
    /// The folder.
    pub output: PathBuf,
    /// How many there are.
    #[serde(flatten)]
    pub maps: MadeMaps,
}

/// Makes maps of all images of a perspective scene in a folder, which training takes as a prior. Maps of the same image by the
/// same network or command are kept.
///
/// # Errors
/// [`PipelineError`]: the scene cannot be read, the network or the command fails or gives something else than maps of the
/// images, other maps are there and are not to be replaced, a file cannot be written, the caller asked to stop.
pub fn prior_maps(
    scene: &Path,
    maker: &PriorMaker,
    folder: &Path,
    options: &PriorMapOptions,
    progress: &dyn Progress,
) -> Result<PriorMapSummary, PipelineError> {
    let PriorMapOptions { content, kind, overwrite } = *options;
    if content == PriorContent::Normals
        && let Some(kind) = kind
    {
        let (option, found) = ("--kind", kind.to_string());
        return Err(PipelineError::Option { option, found, expected: "none: normals have no kinds" });
    }
    let scene = PerspectiveScene::read(scene, &PerspectiveOptions::default())?;
    for (name, reason) in &scene.skipped {
        progress.event(Event::Warning(format!("`{name}` is left out: {reason}")));
    }
    let _lock = RunLock::make(folder)?;
    // What a user has written there about maps made before holds on.
    let before = PriorFolder::open(folder)?.description().clone();
    let description = PriorDescription { kind: kind.or(before.kind), ..before };
    let existing = if overwrite { ExistingMaps::Replace } else { ExistingMaps::Keep };
    let views: Vec<&PerspectiveView> = scene.views.iter().collect();
    let maps = make_maps(maker, content, &views, folder, &description, existing, progress)?;
    Ok(PriorMapSummary { output: folder.into(), maps })
}
