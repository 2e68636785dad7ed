//! Scores of renders against photographs that were held back from training.

use super::super::PipelineError;
use super::super::nvs_scores::{NvsScores, SeenScores, ViewScore};
use super::super::photographs::read_view;
use super::super::run_folder::perspective_cameras::PerspectiveCameras;
use super::super::run_folder::perspective_manifest::PerspectiveManifest;
use super::start_pictures::read_unseen;
use crate::io::{Grid2, write_json};
use crate::nn::lpips::Lpips;
use crate::progress::{Event, Progress};
use crate::run_files::{NVS_PICTURES, NVS_SCORES};
use crate::scene::Role;
use crate::splat::image_score::{photograph_pair, psnr_db_where};
use crate::splat::pinhole::comparison;
use std::path::Path;

/// Largest number of comparisons that are written for the report.
const PICTURES: usize = 12;

/// Renders views of a trained run and compares them with their images: those of these names, else all test views. With
/// `written`, scores and comparisons are written into the run for the report.
pub fn nvs_eval(
    run: &Path,
    names: &[String],
    lpips: Option<&Lpips<f32>>,
    written: bool,
    progress: &dyn Progress,
) -> Result<NvsScores, PipelineError> {
    let scene = PerspectiveManifest::read(run)?.read_scene()?;
    let cameras = PerspectiveCameras::read(run)?;
    let views = if names.is_empty() {
        cameras.views.iter().filter(|v| v.role == Role::Test).collect()
    } else {
        names.iter().map(|name| cameras.find(name)).collect::<Result<Vec<_>, _>>()?
    };
    if views.is_empty() {
        return Err(PipelineError::NoTestView);
    }
    let splats = PerspectiveCameras::read_splats(run)?;
    let mut scores = Vec::new();
    let step = views.len().div_ceil(PICTURES).max(1);
    progress.event(Event::Started { stage: "scoring views", total: views.len() as u64 });
    for (i, view) in views.iter().enumerate() {
        progress.check()?;
        let name = || view.name.clone();
        let source = view.view_of(&scene, run)?;
        let truth = source.read_image()?.planes;
        let picture = cameras.picture(&splats, &view.camera());
        let score = photograph_pair(&picture.colors, &truth).score_with(lpips)?;
        let score = score.ok_or_else(|| PipelineError::NothingToScore { name: name() })?;
        if written && i % step == 0 {
            let shown = comparison(&read_view(source)?, &picture);
            shown.write(&run.join(format!("{NVS_PICTURES}/{i:04}.png")))?;
        }
        let unseen = read_unseen(run, &view.name);
        let parts = unseen.and_then(|unseen| part_scores(&picture.colors, &truth, &unseen));
        scores.push(ViewScore { view: name(), score, parts });
        progress.event(Event::Advanced { done: scores.len() as u64, status: String::new() });
    }
    progress.event(Event::Finished);
    let scores = NvsScores::with_mean(scores);
    if written {
        write_json(&run.join(NVS_SCORES), &scores)?;
    }
    Ok(scores)
}

/// Scores of the pixels that training views do not see, where the mask is not zero, and of the others; none if the mask is of
/// another size.
fn part_scores(colors: &[Grid2; 3], truth: &[Grid2; 3], unseen: &Grid2) -> Option<SeenScores> {
    if (unseen.width, unseen.height) != (truth[0].width, truth[0].height) {
        return None;
    }
    let is_unseen = |i: usize| unseen.data[i] > 0.0;
    let count = (0..unseen.data.len()).filter(|i| is_unseen(*i)).count();
    Some(SeenScores {
        unseen_share: count as f64 / unseen.data.len().max(1) as f64,
        unseen_psnr_db: psnr_db_where(colors, truth, is_unseen),
        seen_psnr_db: psnr_db_where(colors, truth, |i| !is_unseen(i)),
    })
}
