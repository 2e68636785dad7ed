//! Maps of depths or normals of the images of a perspective scene: `satgs prior`.

use super::{PipelineError, RunLock};
use crate::perspective::{PerspectiveOptions, PerspectiveScene, PerspectiveView};
use crate::prior::{
    DepthKind, ExistingMaps, MadeMaps, PriorContent, PriorDescription, PriorFolder, PriorMaker, make_maps,
};
use crate::progress::{Event, Progress};
use crate::scene::Role;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// How maps are made.
#[derive(Clone, Debug)]
pub struct PriorMapOptions {
    /// How the scene is read. Matching uses and gives maps of the views only that are not held back.
    pub scene: PerspectiveOptions,
    /// What the maps are to hold.
    pub content: PriorContent,
    /// What the values of depth maps are, if known; written to `prior.json`.
    pub kind: Option<DepthKind>,
    /// Make maps again that exist.
    pub overwrite: bool,
}

impl Default for PriorMapOptions {
    fn default() -> Self {
        Self {
            scene: PerspectiveOptions::default(),
            content: PriorContent::Depths,
            kind: None,
            overwrite: false,
        }
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
    let PriorMapOptions { content, kind, overwrite, .. } = *options;
    if content == PriorContent::Normals
        && let Some(kind) = kind
    {
        let (option, found) = ("--kind", kind.to_string());
        return Err(PipelineError::Option { option, found, expected: "none: normals have no kinds" });
    }
    let is_stereo = *maker == PriorMaker::Stereo;
    if is_stereo && (content == PriorContent::Normals || kind.is_some()) {
        let option = if kind.is_some() { "--kind" } else { "--normals" };
        let expected = "none: --stereo gives depths in the unit of the scene";
        return Err(PipelineError::Option { option, found: "given with --stereo".into(), expected });
    }
    let scene = PerspectiveScene::read(scene, &options.scene)?;
    for (name, reason) in &scene.skipped {
        progress.event(Event::Warning(format!("`{name}` is left out: {reason}")));
    }
    let _lock = RunLock::make(folder)?;
    // What a user has written there about maps made before holds on.
    let before = PriorFolder::open(folder)?.description().clone();
    // Matching has measured its depths; what another maker gives is of another kind.
    let kept = before.kind.filter(|kind| *kind != DepthKind::Measured);
    let description = PriorDescription { kind: kind.or(kept), ..before };
    let existing = if overwrite { ExistingMaps::Replace } else { ExistingMaps::Keep };
    // Views that are held back must not help to find what the others show.
    let is_made = |view: &&PerspectiveView| !is_stereo || view.role == Role::Train;
    let views: Vec<&PerspectiveView> = scene.views.iter().filter(is_made).collect();
    let maps = make_maps(maker, content, &views, folder, &description, existing, progress)?;
    Ok(PriorMapSummary { output: folder.into(), maps })
}
