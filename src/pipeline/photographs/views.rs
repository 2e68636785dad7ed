//! The images of a perspective scene, read for training.

use super::super::PipelineError;
use crate::affine::SiteSceneError;
use crate::perspective::{PerspectiveScene, PerspectiveView};
use crate::progress::{Event, Progress};
use crate::scene::Role;
use crate::splat::pinhole::PinholeView;
use rayon::prelude::*;

/// Reads the images of the training views.
pub fn read_views(
    scene: &PerspectiveScene,
    progress: &dyn Progress,
) -> Result<Vec<PinholeView>, PipelineError> {
    let training: Vec<&PerspectiveView> = scene.training().collect();
    if training.is_empty() {
        return Err(SiteSceneError::NoViews.into());
    }
    let held_back: Vec<&PerspectiveView> = scene.views.iter().filter(|v| v.role == Role::Test).collect();
    let total = (training.len() + held_back.len()) as u64;
    progress.event(Event::Started { stage: "reading images", total });
    let mut views = Vec::with_capacity(training.len());
    // As many at a time as there are threads: an undistorted image is several times as large as what is kept of it.
    let at_a_time = rayon::current_num_threads().max(1);
    // What is wrong with a view to be scored shows before the training.
    for (k, some) in held_back.chunks(at_a_time).enumerate() {
        progress.check()?;
        some.par_iter()
            .map(|view| view.read_image().map(drop))
            .collect::<Vec<_>>()
            .into_iter()
            .collect::<Result<(), _>>()?;
        let done = held_back.len().min((k + 1) * at_a_time) as u64;
        progress.event(Event::Advanced { done, status: String::new() });
    }
    for some in training.chunks(at_a_time) {
        progress.check()?;
        let read: Vec<Result<PinholeView, PipelineError>> =
            some.par_iter().map(|view| read_view(view)).collect();
        for view in read {
            views.push(view?);
        }
        let done = (held_back.len() + views.len()) as u64;
        progress.event(Event::Advanced { done, status: String::new() });
    }
    progress.event(Event::Finished);
    Ok(views)
}

/// A view with its pixels.
pub fn read_view(view: &PerspectiveView) -> Result<PinholeView, PipelineError> {
    Ok(PinholeView::of_image(view.name.clone(), view.camera, &view.read_image()?))
}
