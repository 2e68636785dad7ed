//! Every stage of a scene in a row: `satgs run`.
//!
//! One call serves satellite scenes of any size and photographs: [`run`] takes [`AnyScene`] and calls the stages of
//! [`pipeline`](crate::pipeline); an area larger than one training goes through [`tiles`](crate::tiles).

mod any_scene;
mod error;
mod options;
mod photographs;
mod satellites;
mod stage_result;

pub use any_scene::{AnyScene, ReadPhotographs};
pub use error::RunError;
pub use options::RunOptions;
pub use stage_result::StageResult;

use crate::progress::Progress;
use std::path::Path;

/// Runs all stages of a scene and writes a report. `completed` receives the result of each stage as soon as it is complete. Stages in
/// the folder `run` that were made from the same input and options are kept.
///
/// Satellite scenes are adjusted and trained, their surface model is rendered, and scored if there is a truth. An area with a side of
/// more than 1.5 times [`RunOptions::core_m`] is cut into tiles, which are trained one after the other and blended. Photographs are
/// trained; held-back views are scored, and a surface model is rendered if the scene has a georeference.
///
/// # Errors
/// [`RunError`] of the first stage that fails; files that late stages read are opened first. A tile that fails does not stop the
/// others: [`TilesError::Partial`](crate::tiles::TilesError::Partial) lists those that did, when everything else is complete.
pub fn run(
    scene: AnyScene,
    options: &RunOptions,
    run: &Path,
    progress: &dyn Progress,
    completed: &mut dyn FnMut(StageResult),
) -> Result<(), RunError> {
    match scene {
        AnyScene::Satellites(scene) => satellites::run(&scene, options, run, progress, completed),
        AnyScene::Photographs(scene) => photographs::run(*scene, options, run, progress, completed),
    }
}
